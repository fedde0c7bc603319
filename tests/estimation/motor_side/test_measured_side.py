"""A measured log with its link positions taken away: refused, or right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli import prepare, read_recording, read_robot
from elid_cli.estimation.motor_side.estimate import motor_side

DATA = Path(__file__).parents[4] / "shared" / "data"
TRUE = 27.5
"""Stiffness of the first stage that its link encoder shows, N·m/rad."""


def test_the_two_stages_of_a_flexible_arm() -> None:
    log = DATA / "quanser_2dsfl.csv"
    if not log.exists():
        pytest.skip(f"{log} is not there: the measured logs are not part of the repository")
    robot = read_robot("quanser_2dsfl")
    recording = read_recording([log], robot, None)
    recording = replace(recording, q=np.full_like(recording.q, np.nan))
    found = motor_side(robot, recording, prepare(recording, robot).still)
    assert found is not None
    first, second = found.joints
    assert first.verdict == "refused" or first.stiffness == pytest.approx(TRUE, rel=0.05)
    assert second.verdict == "refused"
    assert all(np.isnan(joint.stiffness) for joint in found.joints if joint.verdict == "refused")
