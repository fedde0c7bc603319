"""Gears that lose another part of what they transmit while the load drives the motor."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Arm, Laws, Sensors, World, log, random_arm

RATE = 500.0
TRIED = ("load_friction", "backdriving_friction", "torque_gain", "asymmetric_coulomb", "transmission_damping")


def arm_of(seed: int, n: int = 2) -> Arm:
    return random_arm(np.random.default_rng(seed), n)


def diagnosed(arm: Arm, seed: int, joint: int, driving: float, driven: float, gain: float = 0.0) -> Diagnosis:
    """Return the diagnosis of a log whose joint loses parts of its load, and whose torque is logged too large."""

    def torque(w: World) -> np.ndarray:
        total = np.zeros_like(w.q)
        load, direction = w.spring[:, joint], np.sign(w.dtheta[:, joint])
        part = np.where(load * direction > 0, driving, driven)
        total[:, joint] = part * np.abs(load) * direction
        own = arm.rotor[joint] * arm.gear[joint] ** 2 * w.ddtheta[:, joint]
        own += arm.coulomb[joint] * direction + arm.viscous[joint] * w.dtheta[:, joint]
        carried = arm.rotor[joint] * arm.gear[joint] * w.ddq[:, :joint].sum(axis=1)
        total[:, joint] += gain * (load + own + carried + total[:, joint])
        return total

    sensors = Sensors(rate=RATE, bits=19, torque=0.0005)
    recording = log(arm, seed=seed, duration=10.0, sensors=sensors, laws=Laws(motor=[torque]))
    robot = arm.described()
    return diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(RATE)), DiagnoseOptions(only=TRIED))


def check_values(found: Diagnosis, arm: Arm) -> None:
    """What can be known alone is within its errors of the truth."""
    truth = {"K": arm.stiffness, "fs": arm.coulomb, "fv": arm.viscous, "Jm": arm.rotor}
    looked = 0
    for item in found.to_dict()["base_parameters"]:
        kind, joint = item["name"][:-1], int(item["name"][-1]) - 1
        if kind in truth:
            assert abs(item["estimate"] - truth[kind][joint]) < 4 * item["std_error"], item["name"]
            looked += 1
    assert looked >= 6


def named(found: Diagnosis) -> set[tuple[str, str | None]]:
    return {(e.effect, e.joint) for e in found.effects}


def also(found: Diagnosis) -> set[tuple[str, str | None]]:
    return {(r.effect, r.joint) for r in found.also_possible}


@pytest.mark.parametrize(
    ("seed", "joint", "driving", "driven"), [(11, 0, 0.02, 0.09), (12, 1, 0.1, 0.03), (14, 0, 0.08, 0.0)]
)
def test_friction_that_differs_is_named_and_no_value_is_off(
    seed: int, joint: int, driving: float, driven: float
) -> None:
    """It was a wrong torque constant, of this or the other joint, with all that follows from it."""
    arm, name = arm_of(seed), f"joint{joint + 1}"
    found = diagnosed(arm, 5, joint, driving, driven)
    assert ("load_friction", name) in named(found)
    assert ("backdriving_friction", name) in named(found) | also(found)
    load = next(e for e in found.effects if e.effect == "load_friction")
    assert abs(load.parameters["coefficient"] - driving) < 4 * load.std_error["coefficient"]
    check_values(found, arm)


def test_a_part_that_is_not_there_while_driving_is_named_alone() -> None:
    arm = arm_of(13)
    found = diagnosed(arm, 8, 1, 0.0, 0.08)
    assert named(found) == {("backdriving_friction", "joint2")}
    assert found.effects[0].parameters["coefficient"] == pytest.approx(0.08, rel=0.01)
    check_values(found, arm)


@pytest.mark.parametrize(("seed", "loss", "gain"), [(12, 0.06, 0.05), (15, 0.04, -0.06)])
def test_a_torque_constant_beside_equal_friction_may_be_a_difference(seed: int, loss: float, gain: float) -> None:
    arm = arm_of(seed)
    found = diagnosed(arm, 6, 1, loss, loss, gain)
    told = named(found) | also(found)
    assert {("load_friction", "joint2"), ("torque_gain", "joint2")} <= told
    check_values(found, arm)


def test_load_friction_says_what_it_takes_for_granted() -> None:
    arm = arm_of(12)
    found = diagnosed(arm, 7, 1, 0.06, 0.06)
    assert named(found) == {("load_friction", "joint2")}
    (told,) = found.to_dict()["effects"]
    assert "whether the motor drives the load" in told["also"]
    check_values(found, arm)
