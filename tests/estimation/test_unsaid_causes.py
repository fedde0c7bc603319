"""Values that are off by many standard errors while noise is all that a fit leaves: marked, and said why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.identify import Identification, identify
from elid_cli.estimation.validation.following import FACTOR
from elid_cli.report.answers.lacking import words_of
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, make, recorded

RATE = 250.0


def made_rigid(seed: int) -> Made:
    """Return an arm of three rigid joints with its motion."""
    made = make(seed, 3, rate=RATE, duration=12.0)
    stiff = [replace(j, parameters={**j.parameters, "K": 1e4 * j.parameters["K"]}) for j in made.truth.joints]
    bare = [replace(joint, transmission="rigid") for joint in made.robot.joints]
    return replace(made, truth=replace(made.truth, joints=tuple(stiff)), robot=replace(made.robot, joints=tuple(bare)))


def as_rigid(robot: Robot) -> Robot:
    joints = (
        replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"})
        for j in robot.joints
    )
    return replace(robot, joints=tuple(joints))


def identified(made: Made, robot: Robot, laws: Laws, *, torque: float, seed: int) -> Identification:
    log = recorded(made, log_of(made, laws), db=0.0, counts=2.0**16, torque=torque, colour=0.0, seed=seed)
    return identify(robot, prepare(log, robot))


def off(made: Made, found: Identification) -> np.ndarray:
    """Return by how many standard errors the base parameters are off."""
    true = found.base.values(as_rigid(made.truth).reference())
    return np.array([(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True)])


def scaled(joint: int, factor: float) -> Laws:
    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        signals["tau"][:, joint] *= factor

    return Laws(sensors=[read])


@pytest.mark.parametrize(("joint", "seed"), [(0, 3), (1, 2), (2, 1)])
def test_what_a_torque_that_is_off_by_a_factor_moves_is_marked(joint: int, seed: int) -> None:
    made = made_rigid(seed)
    found = identified(made, made.robot, scaled(joint, 1.05), torque=0.01, seed=1)
    far, marked = np.abs(off(made, found)), np.array([p.bias_possible for p in found.parameters])
    assert far.max() > 20.0
    assert far[~marked].max() < 3.0
    assert found.model == "insufficient"


def test_a_torque_that_is_off_by_a_factor_is_said_where_noise_is_all_that_is_left() -> None:
    """It was "Nothing", all known, with values up to twenty of their standard errors off."""
    made = made_rigid(2)
    found = identified(made, made.robot, scaled(1, 1.05), torque=0.01, seed=1)
    assert [(item.joint, item.follows) for item in found.insufficient] == [("j2", FACTOR)]
    assert "the torque of j2 looks off by a factor, which other values take up" in words_of(found)


@pytest.mark.parametrize("elastic", [False, True])
def test_torques_in_proportion_are_not_doubted(*, elastic: bool) -> None:
    for seed in range(1, 7):
        made = make(seed, 2, rate=RATE, duration=12.0) if elastic else made_rigid(seed)
        found = identified(made, made.robot, Laws(), torque=0.01, seed=seed)
        assert not [item for item in found.insufficient if item.follows == FACTOR]
        assert found.model == "sufficient"


def test_of_two_joints_either_may_have_the_factor() -> None:
    """Of the surer one alone what the other's would move was marked: a rotor's inertia stayed 32 errors off."""
    made = make(3, 2, rate=RATE, duration=12.0)
    for joint in (0, 1):
        found = identified(made, made.robot, scaled(joint, 0.96), torque=0.003, seed=3)
        true = found.base.values(made.truth.reference())
        told = [p for p in found.parameters if not p.bias_possible]
        far = [
            abs(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True) if p in told
        ]
        assert len(told) < len(found.parameters)
        assert max(far, default=0.0) < 4.0


def test_a_factor_on_all_torques_is_the_unit_of_the_parameters() -> None:
    made = made_rigid(2)

    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        signals["tau"][:] *= 1.05

    assert identified(made, made.robot, Laws(sensors=[read]), torque=0.01, seed=1).model == "sufficient"


def test_values_that_a_transmission_that_yields_bends_are_marked_where_it_counts_as_rigid() -> None:
    """It was said that the positions differ as the torque does, and no value was doubted for it."""
    made = make(7, 3, rate=RATE, duration=12.0)
    found = identified(made, as_rigid(made.robot), Laws(), torque=0.005, seed=4)
    far, marked = np.abs(off(made, found)), np.array([p.bias_possible for p in found.parameters])
    assert np.count_nonzero(far > 5.0) > 2
    assert far[~marked].max() < 3.0
    assert not any(p.bias_possible for p in identified(made, made.robot, Laws(), torque=0.005, seed=4).parameters)


@pytest.mark.parametrize(("stiffer", "bits"), [(4.0, 13), (256.0, 13), (64.0, 16)])
def test_a_deflection_near_the_encoders_step_is_no_missing_effect(stiffer: float, bits: int) -> None:
    """What the spring passes on was left, as noise had pulled its stiffness to 0, and noise with that was small."""
    made = make(1, 2, rate=RATE, duration=12.0)

    def harder(robot: Robot) -> Robot:
        joints = (replace(j, parameters={**j.parameters, "K": stiffer * j.parameters["K"]}) for j in robot.joints)
        return replace(robot, joints=tuple(joints))

    made = replace(made, truth=harder(made.truth))
    log = recorded(made, log_of(made, Laws()), db=0.0, counts=2.0**bits, torque=0.005, colour=0.0, seed=1)
    found = identify(made.robot, prepare(log, made.robot))
    assert found.model == "sufficient"
    assert not found.insufficient
