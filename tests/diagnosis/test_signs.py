"""An effect whose sign or size contradicts its physics is never named as found."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.model.effects import effect_classes
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Laws, Sensors, World, log, random_arm

JOINT = 1


def _stribeck(w: World) -> np.ndarray:
    speed = w.dtheta[:, JOINT]
    return -3 * w.arm.coulomb[JOINT] * np.sign(speed) * np.exp(-np.abs(speed) / 0.15)


def _quadratic(w: World) -> np.ndarray:
    speed = w.dtheta[:, JOINT]
    return -3 * (w.arm.coulomb[JOINT] + w.arm.viscous[JOINT]) * np.sign(speed) * speed**2


def _driven(w: World) -> np.ndarray:
    load, direction = w.spring[:, JOINT], np.sign(w.dtheta[:, JOINT])
    return np.where(load * direction < 0, np.abs(load) * direction, 0.0)


PUSHING: dict[str, tuple[bool, Callable[[World], np.ndarray]]] = {
    "stribeck": (True, _stribeck),
    "quadratic_viscous": (True, _quadratic),
    "load_friction": (True, lambda w: -0.3 * np.abs(w.spring[:, JOINT]) * np.sign(w.dtheta[:, JOINT])),
    "backdriving_friction": (True, lambda w: -0.3 * _driven(w)),
    "asymmetric_coulomb": (True, lambda w: 3 * w.arm.coulomb[JOINT] * np.abs(np.sign(w.dtheta[:, JOINT]))),
    "asymmetric_viscous": (True, lambda w: 3 * w.arm.viscous[JOINT] * np.abs(w.dtheta[:, JOINT])),
    "position_friction": (
        True,
        lambda w: 4 * w.arm.coulomb[JOINT] * np.sin(6 * w.theta[:, JOINT]) * np.sign(w.dtheta[:, JOINT]),
    ),
    "friction_drift": (
        True,
        lambda w: -4 * w.arm.coulomb[JOINT] * (w.t / w.t[-1]) * np.sign(w.dtheta[:, JOINT]),
    ),
    "tanh_friction": (
        True,
        lambda w: 3 * w.arm.coulomb[JOINT] * (np.tanh(w.dtheta[:, JOINT] / 0.3) - np.sign(w.dtheta[:, JOINT])),
    ),
    "soft_friction": (
        True,
        lambda w: 3 * w.arm.coulomb[JOINT] * (np.clip(w.dtheta[:, JOINT] / 0.3, -1, 1) - np.sign(w.dtheta[:, JOINT])),
    ),
    "transmission_damping": (False, lambda w: -5.0 * (w.dtheta - w.dq)[:, JOINT]),
}
"""Effects that take energy, and a torque of theirs that drives the motor; whether the arm is rigid."""


@pytest.mark.parametrize("name", PUSHING)
def test_friction_that_pushes_has_no_name(name: str) -> None:
    rigid, law = PUSHING[name]
    arm = random_arm(np.random.default_rng(7), 2, (0, 1) if rigid else ())

    def torque(w: World) -> np.ndarray:
        total = np.zeros_like(w.q)
        total[:, JOINT] = law(w)
        return total

    recording = log(arm, seed=7, duration=12.0, sensors=Sensors(rate=500.0, bits=17), laws=Laws(motor=[torque]))
    robot = arm.described()
    signals = prepare(recording, robot, SignalOptions.for_diagnosis(500.0))
    found = diagnose(robot, signals, DiagnoseOptions(only=(name,)))
    assert not [effect for effect in found.effects if effect.effect == name]
    assert found.unexplained or found.nuisances


def test_all_friction_is_tried() -> None:
    assert {name for name, kind in effect_classes().items() if kind.takes_energy} <= PUSHING.keys()
