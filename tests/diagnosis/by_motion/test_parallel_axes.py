"""A base that is not level under joints whose axes are parallel, and not along an axis of the base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import moved, robot, written

TURN = 0.05
"""rad about the pendulums' axes."""


def turned(folder: Path) -> Robot:
    """Return the pendulums as they stand on a base that is turned by 30 degrees about the vertical."""
    text = Path(str(robot(folder).source)).read_text()
    inner = text.replace("<worldbody>", '<worldbody><body name="post" euler="0 0 0.5235987755982988">').replace(
        "</worldbody>", "</body></worldbody>"
    )
    path = folder / "turned.xml"
    path.write_text(inner.replace("<worldbody>", '<compiler angle="radian"/><worldbody>', 1))
    return read_robot(path)


def test_the_turn_that_joints_feel_is_found(tmp_path: Path) -> None:
    arm, log = turned(tmp_path), moved(6, 6.0, noise=3e-5, tilt=TURN)
    signals = prepare(read_recording([written(tmp_path, "log.h5", replace(log))], arm), arm)
    found = diagnose_motion(arm, signals, None, ("gravity_direction", "encoder_zero", "link_spring"))
    (effect,) = [e for e in found.effects if e.effect == "gravity_direction"]
    size = np.hypot(effect.parameters["roll"], effect.parameters["pitch"])
    assert size == pytest.approx(TURN, rel=0.02)
    # about the pendulums' axis, which is 30 degrees from the base's y
    ratio = abs(effect.parameters["roll"] / effect.parameters["pitch"])
    assert ratio == pytest.approx(np.tan(np.pi / 6), rel=0.02)
    assert found.refined.gravity != arm.gravity
