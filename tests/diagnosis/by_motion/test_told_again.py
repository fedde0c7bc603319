"""Commands of which a log holds every third: read as held beside what was missing, and as they are once it is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.refits import with_delay
from elid_cli.diagnosis.by_motion.told_again import told_otherwise
from elid_cli.estimation.smooth_commands import as_read, as_told
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs.checks.known_masses import AGAINST
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_payload
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, OFFSET, VISCOUS, moved, robot, written

if TYPE_CHECKING:
    from elid_cli.diagnosis.by_motion.found import Found

TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
SPRING = 3.0
"""N·m/rad, at the second joint."""
LEAD = 2.5e-4
"""s, by which steps of half a millisecond make a motion ahead of its commands."""


def thinned(recording: Recording, step: int) -> Recording:
    """Return every `step`-th sample of a log."""
    signals = {name: getattr(recording, name)[::step] for name in ("t", "q", "theta", "tau", "dq")}
    commands = {name: values[::step] for name, values in recording.commands.items()}
    count = len(signals["t"])
    return replace(recording, **signals, dt=step * recording.dt, commands=commands, segments=(Segment(0, count),))


def test_commands_read_as_held_beside_what_was_missing_are_read_again(tmp_path: Path) -> None:
    spring = np.array([0.0, SPRING, 0.0])
    log = thinned(moved(5, 9.0, noise=2e-5, push=lambda q, rate, load: spring * q), 3)
    arm = robot(tmp_path)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    told = as_told(arm, signals).recording
    assert told is not None
    assert told.inferred
    wrong = as_read(replace(signals, recording=told), smooth=False)
    found = diagnose_motion(arm, wrong, None, ("link_spring", "torque_delay"))
    assert found.recording.smooth
    assert [(e.effect, e.joint) for e in found.effects] == [("link_spring", "two")]
    assert found.effects[0].parameters["stiffness"] == pytest.approx(SPRING, rel=0.01)
    np.testing.assert_allclose(found.fit_after.delays, 0.5 * DT, atol=2e-4)  # each is held for a sample of the plant
    np.testing.assert_allclose(found.fit_after.values, TRUTH, rtol=0.005)
    # a spring explains a torque against the weight, and a wrong sign would leave more than noise
    line = f"tau of two {AGAINST} of the described bodies: a sign is wrong"
    warned = replace(found, recording=replace(found.recording, warnings=(line, "clocks differ")))
    assert "clocks differ" in motion_diagnosis_payload(warned)["warnings"]
    assert line not in motion_diagnosis_payload(warned)["warnings"]
    assert line in motion_diagnosis_payload(replace(warned, effects=()))["warnings"]


def test_held_commands_of_a_motion_slightly_ahead_of_them_are_not_read_as_smooth_and_late(tmp_path: Path) -> None:
    """Half a sample's delay and smooth commands took up the lead, which held ones were not allowed: inertia was off."""
    log = moved(6, 9.0, noise=0.0, push=lambda q, rate, load: np.array([0.0, SPRING, 0.0]) * q)
    seen = CubicSpline(log.t, log.q)(log.t + LEAD)
    seen += 2e-6 * np.random.default_rng(6).standard_normal(seen.shape)
    log = replace(log, q=seen, theta=seen)
    arm = robot(tmp_path)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    recording = as_told(arm, signals).recording
    assert recording is not None
    assert not recording.smooth
    runs = commanded_runs(recording, arm)
    spring = effect_classes()["link_spring"](1)
    # as beside what was missing, where a lead does not show
    fit = fit_trajectory(arm, runs, TRUTH, [spring], [SPRING, 0.0], late=False)
    done = SimpleNamespace(after=fit, named=(spring,), limits=())
    whole = cast("Found", SimpleNamespace(done=done, changes=(), scaled=np.zeros(3, dtype=bool)))
    assert told_otherwise(replace(signals, recording=recording), runs, whole) is None
    led = with_delay(fit)
    np.testing.assert_allclose(led.delays, -LEAD, atol=2e-5)
    np.testing.assert_allclose(led.values, TRUTH, rtol=0.005)


def test_a_motion_at_its_commands_time_is_given_no_lead(tmp_path: Path) -> None:
    arm = robot(tmp_path)
    signals = prepare(read_recording([written(tmp_path, "log.h5", moved(6, 9.0, noise=2e-6))], arm), arm)
    assert signals.recording is not None
    fit = fit_trajectory(arm, commanded_runs(signals.recording, arm), TRUTH, late=False)
    assert with_delay(fit) is fit
