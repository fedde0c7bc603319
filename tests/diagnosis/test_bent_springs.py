"""What is reported beside an effect in the transmission: a stiffness that knows of it, and units of sliding joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.diagnosis.refit import identified
from elid_cli.report.answers.inputs import effect_text
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, World, log_of, make, recorded


def test_the_stiffness_beside_a_wide_gap_is_the_fits_own() -> None:
    """A line through the raw deflection knows nothing of a gap, and gave less than half the stiffness."""
    made = make(41, 2, rate=500.0)
    size, stiffness = made.sizes[0], made.truth.joints[0].parameters["K"]

    def gap(world: World, torque: np.ndarray) -> np.ndarray:
        return torque / stiffness + 0.8 * size.deflection * np.tanh(torque / (0.01 * size.torque))

    clean = log_of(made, Laws(spring={0: gap}))
    log = recorded(made, clean, db=90.0, counts=0.0, torque=0.003, colour=0.0, seed=41)
    found = diagnose(
        made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(500.0)), DiagnoseOptions(only=("backlash",))
    )
    assert [(e.effect, e.joint) for e in found.effects] == [("backlash", "j1")]
    told = identified(found.state_after, found.after, 0)
    place = [told.base.parameters[k] for k in told.base.leaders].index("K1")
    assert told.estimate[place] == pytest.approx(stiffness, rel=0.02)
    assert "deflection against the torque" not in told.reasons.get("K1", "")


def test_a_phase_is_an_angle_at_a_sliding_joint_too() -> None:
    robot = read_robot("planar2")
    first, second = robot.joints
    slides = replace(robot, joints=(replace(first, type="prismatic"), second))
    text = effect_text(slides, "kinematic_error", first.name, {"amplitude": 2e-5, "phase": 0.5}, {})
    assert "phase 0.5 rad" in text
    assert "amplitude 2.000e-05 m," in text
