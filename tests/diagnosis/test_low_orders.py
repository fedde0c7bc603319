"""A gear's error of low order in a range of less than one period of it: one term with the right order."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, World, log_of, make, recorded

AMPLITUDE, JOINT = 4e-4, 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_term_with_the_right_order_is_named(seed: int) -> None:
    made = make(seed, 3, rate=500.0, duration=12.0)
    order = 0.8 * 2 * np.pi / float(np.ptp(made.q[:, JOINT]))

    def bent(world: World, through: Array) -> Array:
        turn = AMPLITUDE * np.sin(order * world.theta[:, JOINT] + 0.4)
        return np.asarray(through / world.stiffness(JOINT) - turn)

    law = Laws(spring={JOINT: bent})
    log = recorded(made, log_of(made, law), db=0.0, counts=2.0**17, torque=0.003, colour=0.0, seed=seed)
    told = diagnose(made.robot, prepare(log, made.robot))
    assert isinstance(told, Diagnosis)
    assert [(e.effect, e.joint) for e in told.effects] == [("kinematic_error", "j2")]
    (effect,) = told.effects
    assert effect.parameters["order"] == pytest.approx(order, abs=4 * effect.std_error["order"])
    assert effect.parameters["amplitude"] == pytest.approx(AMPLITUDE, rel=0.01)
    assert not told.unexplained
