"""Friction that swings once per turn of a joint which never turns that far: an eccentric gear on an arm."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, make, recorded

ARM, SWINGING, RATE = 1, 1, 250.0
PHASE = 0.4


@pytest.fixture(scope="module")
def made() -> Made:
    return make(ARM, 3, rate=RATE, duration=12.0)


def diagnosed(made: Made, amplitude: float) -> Diagnosis:
    def swing(world: World) -> np.ndarray:
        torque, k = np.zeros_like(world.q), SWINGING
        torque[:, k] = amplitude * np.sign(world.dtheta[:, k]) * np.sin(world.theta[:, k] + PHASE)
        return torque

    laws = Laws(motor=[swing])
    log = recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=0.003, colour=0.0, seed=ARM)
    return diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))


def test_friction_that_swings_once_a_turn_is_named_within_a_third_of_one(made: Made) -> None:
    amplitude = 0.3 * made.truth.joints[SWINGING].parameters["fs"]
    assert 0.3 < np.ptp(made.q[:, SWINGING]) / (2 * np.pi) < 1 / 3
    found = diagnosed(made, amplitude)
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("position_friction", "j2")
    for name, true in (("amplitude", amplitude), ("order", 1.0), ("phase", PHASE)):
        assert abs(effect.parameters[name] - true) < 3.0 * effect.std_error[name]
    assert effect.std_error["order"] < 0.1
    assert found.unexplained == ()


def test_without_it_none_is_named(made: Made) -> None:
    assert diagnosed(made, 0.0).effects == ()
