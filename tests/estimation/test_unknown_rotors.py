"""A written robot keeps the bodies of its file where only the rotors were unknown."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.refined_robot import representative
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Joint, Robot


def joint(mass: float, rotor: float, length: float) -> Joint:
    values = {
        "m": mass, "cx": 0.3 * mass * length, "cy": 0.01 * mass, "cz": 0.02 * mass,
        "Ixx": 0.01 * mass, "Iyy": 0.12 * mass * length**2, "Izz": 0.13 * mass * length**2,
        "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0, "Ja": rotor, "fs": 2.0, "fv": 3.0,
    }  # fmt: skip
    return Joint(f"j{mass:g}", transmission="rigid", xyz=(length, 0.0, 0.1), rpy=(0.3, 0.2, 0.0), parameters=values)


def test_unknown_rotors_move_and_not_the_bodies_that_are_known() -> None:
    """Masses took up what rotors of a URDF without inertia of theirs are: 47 kg for 8, a rotor of 0.005 for 1.1."""
    robot = Robot("arm", (joint(9.0, 1.1, 0.0), joint(8.0, 1.2, 0.4), joint(5.0, 0.7, 0.35)))
    base = find_base(Regressor(robot))
    true = robot.reference()
    names = list(robot.parameter_names())
    rotors = np.array([name.kind == "Ja" for name in names])
    masses = np.array([name.kind == "m" for name in names])
    found = representative(base, base.transform @ true, np.where(rotors, np.nan, true))
    assert found[masses] == pytest.approx(true[masses], rel=0.02)
    assert found[rotors] == pytest.approx(true[rotors], rel=0.05)
    assert base.transform @ found == pytest.approx(base.transform @ true, rel=1e-9, abs=1e-9)
