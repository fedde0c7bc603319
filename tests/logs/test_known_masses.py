"""A torque of another size than the described bodies' weight is doubted, whatever side or unit it is of."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.drive_gains.identification import TORQUE_SIZE
from elid_cli.estimation.judgement import JointError
from elid_cli.logs.checks.known_masses import Weighed, gravity_torques, wrong_scales
from elid_cli.logs.checks.units_and_signs import _of_motors
from elid_cli.logs.mapping.language import SignalMap
from elid_cli.logs.mapping.plan import Placement, ReadPlan
from elid_cli.model.dynamics import Dynamics
from elid_cli.report.answers.summary import trust_words
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot

DT, SAMPLES = 0.004, 3000
GEARS = np.array([121.0, 101.0, 81.0, 60.0, 60.0, 50.0])
PLAN = ReadPlan({"tau": Placement(SignalMap("tau", "motor{i}_torque"), (), (), "motor{i}_torque")}, None, (), (), {})


@pytest.fixture(scope="module")
def robot() -> Robot:
    """PUMA 560 as a URDF would tell it: masses, and no gear ratio."""
    described = read_robot("puma560")
    joints = (replace(j, gear_ratio=None, transmission="rigid") for j in described.joints)
    return replace(described, joints=tuple(joints))


@pytest.fixture(scope="module")
def log() -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques at the joint of a smooth motion, with friction and noise."""
    described, rng, t = read_robot("puma560"), np.random.default_rng(3), DT * np.arange(SAMPLES)
    rates = rng.uniform(0.3, 1.2, (6, 3))
    phases, sizes = rng.uniform(0, 6, (6, 3)), rng.uniform(0.2, 0.5, (6, 3))
    waves = rates * t[:, None, None] + phases
    q, dq, ddq = ((sizes * f).sum(axis=2) for f in
                  (np.sin(waves), rates * np.cos(waves), -(rates**2) * np.sin(waves)))  # fmt: skip
    link, _ = Dynamics(described).feedforward(q, dq, ddq)
    tau = link + 2.0 * np.sign(dq) + 1.5 * dq + 3.0 * ddq
    return q + rng.normal(0, 1e-4, q.shape), tau + rng.normal(0, 0.1, tau.shape)


def test_the_weight_of_the_bodies_is_what_dynamics_makes_of_it() -> None:
    described = read_robot("puma560")
    q = np.random.default_rng(0).uniform(-2, 2, (7, 6))
    np.testing.assert_allclose(gravity_torques(described, q), Dynamics(described).gravity(q), atol=1e-12)


def test_a_torque_at_the_joint_is_not_doubted(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    assert not list(wrong_scales(Weighed(*log, DT, robot), PLAN))
    assert {scale.joint for scale in Weighed(*log, DT, robot).scales} >= {1, 2}


def test_gear_ratios_are_proposed_of_a_torque_at_the_motors_shaft(
    robot: Robot, log: tuple[np.ndarray, np.ndarray]
) -> None:
    said = next(iter(wrong_scales(Weighed(log[0], log[1] / GEARS, DT, robot), PLAN)))
    assert "the unit or the side (motor or joint) is wrong, or the masses of puma560" in said
    found = re.search(r'tau: {from: "motor{i}_torque", scale: {joint1: RATIO, joint2: (\S+), joint3: (\S+),', said)
    assert found is not None
    np.testing.assert_allclose([float(found[1]), float(found[2])], GEARS[1:3], rtol=0.15)


def test_one_factor_is_proposed_for_all_joints(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    said = next(iter(wrong_scales(Weighed(log[0], log[1] / 100.0, DT, robot), PLAN)))
    factor = re.search(r"scale: ([\d.]+)}", said)
    assert factor is not None
    assert abs(float(factor[1]) / 100.0 - 1) < 0.15


def test_millinewton_metres_are_proposed_as_a_unit(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    said = next(iter(wrong_scales(Weighed(log[0], 1000.0 * log[1], DT, robot), PLAN)))
    assert said.endswith("unit: mN.m}")


def test_known_gear_ratios_are_named_as_the_motors_side(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    geared = replace(
        robot, joints=tuple(replace(j, gear_ratio=g) for j, g in zip(robot.joints, GEARS.tolist(), strict=True))
    )
    said = next(iter(wrong_scales(Weighed(log[0], log[1] / GEARS, DT, geared), PLAN)))
    assert said.endswith('tau: {from: "motor{i}_torque", side: motor}')


def test_a_torque_of_friction_alone_is_doubted(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    speed = np.gradient(log[0], DT, axis=0)
    said = next(iter(wrong_scales(Weighed(log[0], 2.0 * np.sign(speed) + speed, DT, robot), PLAN)))
    assert said.startswith("tau of joint2 and joint3 does not follow the weight of the described bodies")


def test_unknown_masses_doubt_nothing(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    bare = replace(robot, joints=tuple(replace(j, parameters={}) for j in robot.joints))
    assert not list(wrong_scales(Weighed(log[0], log[1] / GEARS, DT, bare), PLAN))


def test_a_torque_that_pulls_with_the_weight_is_doubted(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    one = np.array([1, 1, -1, 1, 1, 1])
    for signs, key in ((-np.ones(6), "sign: -1}"), (one, "sign: {joint3: -1}}")):
        (said,) = wrong_scales(Weighed(log[0], log[1] * signs, DT, robot), PLAN)
        assert "runs against the weight of the described bodies" in said
        assert said.endswith(key)


def test_where_torques_are_computed_the_commands_are_turned(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    """A mapping of tau would have no effect."""
    told = {s: Placement(SignalMap(s, f"{s}{{i}}"), (), (), f"{s}{{i}}") for s in ("q_des", "dq_des")}
    signs = np.array([1, 1, -1, 1, 1, 1])
    (said,) = wrong_scales(Weighed(log[0], log[1] * signs, DT, robot), ReadPlan(told, None, (), (), {}), computed=True)
    assert "a sign of the commands is wrong" in said
    lines = 'q_des: {from: "q_des{i}", sign: {joint3: -1}} and dq_des: {from: "dq_des{i}", sign: {joint3: -1}}'
    assert said.endswith(f"map it: {lines}")


def test_a_motors_torque_without_gears_and_masses_is_asked_about(robot: Robot) -> None:
    bare = replace(robot, joints=tuple(replace(j, parameters={}) for j in robot.joints))
    mapped = replace(PLAN, mapped=frozenset({"tau"}))
    (said,) = _of_motors(mapped, bare)
    assert "nothing shows whether the unit or the side (motor or joint) is wrong" in said
    assert not list(_of_motors(mapped, robot))
    spec = SignalMap("tau", "motor{i}_torque", written={"from": "motor{i}_torque", "side": "joint"})
    placed = replace(mapped, placements={"tau": replace(PLAN.placements["tau"], spec=spec)})
    assert not list(_of_motors(placed, bare))


def test_trust_is_doubted_where_a_torque_runs_against_the_weight() -> None:
    error = {"joint1": JointError(0.01, 0.001, None, None, 10.0)}
    for warning, start in (
        ("", "Yes"),
        ("tau of lift runs against the weight of", "Only if the log's units and signs"),
    ):
        assert trust_words(read_robot("planar2"), error, (), (warning,)).startswith(start)


def test_a_known_payload_answers_the_doubt(robot: Robot, log: tuple[np.ndarray, np.ndarray]) -> None:
    said = next(iter(wrong_scales(Weighed(log[0], log[1] / GEARS, DT, robot), PLAN)))
    assert any(words in said for words in TORQUE_SIZE)
