"""Commands of which a log holds every third: read as held beside what was missing, and as they are once it is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.smooth_commands import as_read, as_told
from elid_cli.logs.checks.known_masses import AGAINST
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_payload
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, OFFSET, VISCOUS, moved, robot, written

TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
SPRING = 3.0
"""N·m/rad, at the second joint."""


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
