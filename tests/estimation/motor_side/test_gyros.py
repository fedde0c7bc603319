"""Gyroscopes on links without position sensors: their equations, their mounting, and the stiffness that they show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from elid_cli._types import Array
from elid_cli.cli import main
from elid_cli.estimation.motor_side.estimate import motor_side
from elid_cli.estimation.motor_side.gyros import UNKNOWNS, mounting_prior, watched
from elid_cli.estimation.motor_side.result import MotorSide
from elid_cli.estimation.motor_side.setting import Setting
from elid_cli.logs import write_recording
from elid_cli.model.link_rates import LinkRates
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import Robot
from tests.estimation.motor_side.test_pieces import problem_of, setting_of
from tests.system.motor_arms import Case, motor_log, random_motor_arm, told_robot
from tests.system.plain_arms import Arm

SLOW = Case(kind="smooth", signal_to_noise=70.0)
"""Motion that ends far below the antiresonances."""


def poses(robot: Robot, q: Array) -> list[Array]:
    """Return the rotations from the frame of every link to the base's, by its placements alone."""
    found: list[Array] = []
    for k, (joint, (before, after)) in enumerate(zip(robot.joints, robot.placements(), strict=True)):
        c, s = (np.cos(q[k]), np.sin(q[k])) if joint.revolute else (1.0, 0.0)
        own = before[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ after[:3, :3]
        found.append(found[robot.parents[k]] @ own if robot.parents[k] >= 0 else own)
    return found


def test_rates_of_links_are_those_of_their_rotations() -> None:
    """By differences of the rotation matrices: Rᵀ dR/dt = [ω]×."""
    robot = read_robot("puma560")
    q, dq = np.random.default_rng(5).uniform(-1, 1, (2, robot.n))
    joints, step = (1, 4, 5), 1e-6
    found = LinkRates(robot, joints).rates(q[None], dq[None])[0]
    ahead, behind, here = (poses(robot, q + sign * step * dq) for sign in (1, -1, 0))
    for rate, k in zip(found, joints, strict=True):
        cross = here[k].T @ (ahead[k] - behind[k]) / (2 * step)
        assert rate == pytest.approx([cross[2, 1], cross[0, 2], cross[1, 0]], abs=1e-8)


def test_slopes_of_rates_are_those_of_differences() -> None:
    robot = read_robot("puma560")
    state = np.random.default_rng(6).uniform(-1, 1, (2, robot.n))
    rates = LinkRates(robot, (2, 5))
    slopes = rates.slopes(*state[:, None])[1][:, 0]
    for order in range(2):
        for joint in range(robot.n):
            step = np.zeros_like(state)
            step[order, joint] = 1e-6
            moved = (rates.rates(*(state + step)[:, None]) - rates.rates(*(state - step)[:, None]))[0] / 2e-6
            assert slopes[order, :, :, joint] == pytest.approx(moved, abs=1e-8)


def test_what_gyroscopes_measure_follows_their_mounting_bias_and_delay() -> None:
    setting = setting_of(random_motor_arm(np.random.default_rng([47, 77]), 3))
    problem, x, coefficients = problem_of(setting)
    now = problem.model(coefficients, x)
    slopes = problem.by_unknowns(now, x, problem.friction_slopes(now, x))[1]
    for place in problem.unknowns["gyro"].tolist():
        step = np.zeros_like(x)
        step[place] = 1e-6
        ahead, back = (problem.residual(coefficients, x + sign * step)[1] for sign in (1, -1))
        moved = (back - ahead) * problem.tau_noise / 2e-6
        assert slopes[:, :, place] == pytest.approx(moved, abs=1e-6 * max(1.0, np.abs(moved).max()))


def test_a_first_mounting_is_near_the_true_one() -> None:
    arm = random_motor_arm(np.random.default_rng([1, 77]), 2)
    log, robot = motor_log(arm, 1, replace(SLOW, gyros=(0, 1))), told_robot(arm, 1)
    found = motor_side(robot, log, np.zeros(2, dtype=bool))
    assert found is not None
    for gyro in found.gyroscopes:
        axis = np.array(gyro.mounting)[:, 2]  # a planar arm turns about z
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=0.04)
        assert gyro.delay == pytest.approx(2e-3, abs=2e-4)
        assert len(gyro.bias) == 3
        assert max(map(abs, gyro.bias)) < 0.1


def arm_of(seed: int) -> Arm:
    return random_motor_arm(np.random.default_rng([seed, 77]), 2)


def said(seed: int, case: Case, **changed: Array) -> MotorSide:
    arm = arm_of(seed)
    log = motor_log(arm, seed, case)
    found = motor_side(told_robot(arm, seed), replace(log, gyro=log.gyro | changed), np.zeros(2, dtype=bool))
    assert found is not None
    return found


@pytest.mark.parametrize("seed", [2, 7])
def test_gyroscopes_show_stiffnesses_that_the_motors_do_not(seed: int) -> None:
    alone, together = said(seed, SLOW), said(seed, replace(SLOW, gyros=(0, 1)))
    assert any(joint.verdict != "supported" for joint in alone.joints)
    for joint in together.joints:
        assert joint.verdict == "supported"
        true = arm_of(seed).stiffness[joint.number]
        assert joint.stiffness == pytest.approx(true, rel=0.003)
        assert abs(joint.stiffness - true) < 4 * joint.std_error


def test_a_gyroscope_of_another_link_is_left_out_and_said() -> None:
    log = motor_log(arm_of(2), 2, replace(SLOW, gyros=(0, 1)))
    swapped = {axis: values[:, ::-1] for axis, values in log.gyro.items()}
    found, alone = said(2, replace(SLOW, gyros=(0, 1)), **swapped), said(2, SLOW)
    assert [bool(gyro.reason) for gyro in found.gyroscopes] == [True, True]
    assert "does not turn as its link does" in found.gyroscopes[0].reason
    assert [joint.stiffness for joint in found.joints] == pytest.approx(
        [j.stiffness for j in alone.joints], nan_ok=True
    )


def test_one_gyroscope_tells_joints_apart_only_where_their_axes_differ() -> None:
    planar, both = told_robot(arm_of(2), 2), np.ones(2, dtype=bool)
    still = np.zeros((1, 2))
    assert watched(LinkRates(planar, (1,)), both, still).tolist() == [False, False]
    assert watched(LinkRates(planar, (0,)), both, still).tolist() == [True, False]
    assert watched(LinkRates(planar, (0, 1)), both, still).tolist() == [True, True]
    assert watched(LinkRates(planar, ()), both, still).tolist() == [False, False]
    robot = read_robot("puma560")
    assert watched(LinkRates(robot, (1,)), np.arange(6) < 2, np.full((1, 6), 0.3))[:2].tolist() == [True, True]


def test_without_gyroscopes_nothing_is_added() -> None:
    setting: Setting = setting_of(random_motor_arm(np.random.default_rng([47, 77]), 3))
    mean, spread = mounting_prior(setting.samples.gyros.mounting)
    assert len(mean) == len(spread) == 2 * UNKNOWNS
    assert mounting_prior(np.zeros((0, 3, 3)))[0].size == 0


def test_the_report_and_json_say_what_was_found_of_a_gyroscope(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From a file with a topic of its own, as a program writes it."""
    arm = random_motor_arm(np.random.default_rng([21, 77]), 1)
    write_robot(told_robot(arm, 21), tmp_path / "arm.yaml")
    write_recording(motor_log(arm, 21, replace(SLOW, gyros=(0,))), tmp_path / "log.mcap")
    line = ["identify", str(tmp_path / "log.mcap"), "--robot", str(tmp_path / "arm.yaml")]
    assert main(line) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "from motor position and torque and from gyroscopes" in text
    assert "gyroscope behind joint1: used, its mounting found" in text
    assert " ms late" in text
    assert main([*line, "--json"]) == 0
    payload = json.loads(capsys.readouterr().out)
    (gyro,) = payload["motor_side"]["gyroscopes"]
    assert gyro["joint"] == "joint1"
    assert gyro["reason"] == ""
    assert np.linalg.norm(np.array(gyro["mounting"])[:, 2]) == pytest.approx(1.0, abs=0.04)
    schema = json.loads((Path(__file__).parents[3] / "docs/reference/elid-1.schema.json").read_text("utf-8"))
    own = {"$defs": schema["$defs"], "$ref": "#/$defs/motor_side"}
    Draft202012Validator(own).validate(payload["motor_side"])
