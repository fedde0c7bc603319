"""Of channels that may be late the one is named that is, with the others as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Sensors, log, random_arm

RATE = 500.0


def late(recording: Recording, joint: int, delay: float, *channels: str) -> Recording:
    """Return a recording in which channels of a joint are read `delay` seconds late; its ends are cut off."""
    inside = slice(25, len(recording.t) - 25)
    changed = {name: np.array(getattr(recording, name)) for name in ("q", "theta", "tau")}
    for name in channels:
        values = make_interp_spline(recording.t, changed[name][:, joint], k=5)
        changed[name][:, joint] = values(recording.t - delay)
    cut = {name: values[inside] for name, values in changed.items()}
    t = recording.t[inside]
    return replace(recording, t=t, segments=(Segment(0, len(t)),), **cut)


def diagnosed(seed: int, joint: int, delay: float, *channels: str) -> Diagnosis:
    arm = random_arm(np.random.default_rng(seed), 2)
    recording = log(arm, seed=seed, duration=10.0, sensors=Sensors(rate=RATE, bits=19, torque=0.002))
    robot = arm.described()
    signals = prepare(late(recording, joint, delay, *channels), robot, SignalOptions.for_diagnosis(RATE))
    found = diagnose(robot, signals)
    assert isinstance(found, Diagnosis)
    return found


@pytest.mark.parametrize(("seed", "joint"), [(21, 0), (22, 1)])
def test_a_skew_between_encoders_is_no_late_joint(seed: int, joint: int) -> None:
    """To first order the joint that is read late explains a part of it, and hid it."""
    found = diagnosed(seed, joint, 0.001, "q")
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("encoder_skew", f"joint{joint + 1}")
    assert effect.parameters["skew"] == pytest.approx(0.001, rel=0.05)
    assert not found.unexplained


@pytest.mark.parametrize(("seed", "joint"), [(21, 0), (21, 1), (23, 1)])
def test_a_joint_that_is_read_late_is_not_the_other_one_read_early(seed: int, joint: int) -> None:
    """With all torques as late as that, the two are the same: a shift of all clocks."""
    found = diagnosed(seed, joint, 0.004, "q", "theta")
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("position_delay", f"joint{joint + 1}")
    assert effect.parameters["delay"] == pytest.approx(0.004, rel=0.03)
    (rival,) = (r for r in found.also_possible if r.effect == "position_delay")
    assert rival.joint == f"joint{2 - joint}"
    assert rival.parameters["delay"] == pytest.approx(-0.004, rel=0.03)
    assert "how late the drives' torques are" in rival.separate
    assert not found.unexplained
