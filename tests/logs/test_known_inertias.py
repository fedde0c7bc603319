"""Time and positions of another size than the described bodies' inertia and weight make them are doubted."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.judgement import JointError
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.logs.checks.known_inertias import inertia_scales, wrong_times
from elid_cli.logs.checks.known_masses import Weighed, wrong_scales
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.position_scale import position_factor, position_words
from elid_cli.logs.mapping.language import SignalMap
from elid_cli.logs.mapping.plan import Placement, ReadPlan
from elid_cli.model.body_torques import inertial_torques
from elid_cli.model.dynamics import Dynamics
from elid_cli.report.answers.summary import trust_words
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from tests.logs.test_known_masses import DT, log, robot
from tests.robot.random_robots import random_robot
from tests.system.reproduce.newcomer import URDF

__all__ = ["log", "robot"]
PLAN = ReadPlan({"q": Placement(SignalMap("q", "q.{joint}"), (), (), "q.{joint}")}, None, (), (), {})
Log = tuple[np.ndarray, np.ndarray]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_torque_that_moves_the_bodies_is_that_of_dynamics(seed: int) -> None:
    tree = random_robot(seed, 5, "urdf", kinds="rprrp", parents=(-1, 0, 1, 0, 3), gearless=(0, 1, 2, 3, 4))
    bare = {"Ja": 0.0, "fs": 0.0, "fv": 0.0}
    joints = (replace(j, transmission="rigid", parameters={**j.parameters, **bare}) for j in tree.joints)
    tree = replace(tree, joints=tuple(joints), gravity=(0.0, 0.0, 0.0))
    q, dq, ddq = np.random.default_rng(seed).uniform(-1, 1, (3, 6, 5))
    link, _ = Dynamics(tree).feedforward(q, dq, ddq)
    np.testing.assert_allclose(inertial_torques(tree, q, dq, ddq), link, atol=1e-11)


def test_a_log_at_its_own_time_is_not_doubted(robot: Robot, log: Log) -> None:
    assert not list(wrong_times(Weighed(log[0], log[1], DT, robot), log[0]))
    assert {s.joint for s in inertia_scales(log[0], log[0], log[1], DT, robot) if 0.7 < s.ratio < 1.4} >= {1, 2}


@pytest.mark.parametrize(("factor", "way"), [(10.0, "slow"), (0.1, "fast")])
def test_time_in_another_unit_is_doubted_where_the_weight_fits(robot: Robot, log: Log, factor: float, way: str) -> None:
    (said,) = wrong_times(Weighed(log[0], log[1], factor * DT, robot), log[0])
    assert "but holds their weight: the time of the log runs about" in said
    found = re.search(rf"about ([\d.]+) times too {way}", said)
    assert found is not None
    assert abs(float(found[1]) / 10 - 1) < 0.2
    error = {"joint1": JointError(0.01, 0.001, None, None, 10.0)}
    assert trust_words(robot, error, (), (said,)).startswith("Only if the log's units")


def test_a_vertical_axis_has_no_weight_and_shows_its_torque_by_inertia(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>', 1))
    described = read_robot(tmp_path / "arm.urdf")
    driven = {"Ja": 0.1, "fs": 0.5, "fv": 0.3}
    joints = (replace(j, transmission="rigid", parameters={**j.parameters, **driven}) for j in described.joints)
    found = simulate(arm := replace(described, joints=tuple(joints)), SimulationOptions(duration=20, rate=125))
    assert not list(wrong_times(Weighed(found.q, found.tau, found.dt, arm), found.q))
    tau = found.tau * np.array([0.01, 1])
    assert not list(wrong_scales(Weighed(found.q, tau, found.dt, arm), PLAN))
    (said,) = wrong_times(Weighed(found.q, tau, found.dt, arm), found.q)
    assert f"tau of joint1 is 0.01 times what moves the described bodies, and no weight shows its size: {WRONG}" in said


def test_a_torque_of_another_size_is_no_wrong_time(robot: Robot, log: Log) -> None:
    assert not list(wrong_times(Weighed(log[0], 100 * log[1], DT, robot), log[0]))


def doubted(log: Weighed, plan: ReadPlan) -> str:
    """Return what is said of the positions."""
    found = position_factor(log)
    assert found is not None
    return position_words(found, log.robot, plan)


@pytest.mark.parametrize(
    ("factor", "size", "key"),
    [(0.1, "10 times too small", "scale: 10"), (180 / np.pi, "57.3 times too large", "unit: deg"),
     (0.5 / np.pi, "6.28 times too small", "unit: rev"), (10.0, "10 times too large", "scale: 0.1")],
)  # fmt: skip
def test_positions_of_another_size_are_doubted_and_not_the_torque(
    robot: Robot, log: Log, factor: float, size: str, key: str
) -> None:
    said = doubted(Weighed(factor * log[0], log[1], DT, robot), PLAN)
    assert said.startswith(f"positions look {size}: ")
    assert said.endswith(f'if so, map it: q: {{from: "q.{{joint}}", {key}}}')
    assert WRONG in said


@pytest.mark.parametrize("joint", [1, 2])
def test_of_one_joint_in_another_unit_that_one_is_named_and_proposed(robot: Robot, log: Log, joint: int) -> None:
    factor = np.ones(robot.n)
    factor[joint] = 180 / np.pi
    said = doubted(Weighed(factor * log[0], log[1], DT, robot), PLAN)
    name = robot.joint_names[joint]
    assert said.startswith(f"positions of {name} look 57.3 times too large: ")
    assert said.endswith(f'if so, map it: q: {{from: "q.{{joint}}", unit: {{{name}: deg}}}}')


def test_what_is_written_of_positions_stays_in_what_is_proposed(robot: Robot, log: Log) -> None:
    written = {"scale": {"joint1": 2.0}}
    spec = SignalMap("q", "q.{joint}", scale=(2.0, *[1.0] * (robot.n - 1)), written=written)
    plan = ReadPlan({"q": Placement(spec, (), (), "q.{joint}")}, None, (), (), {})
    said = doubted(Weighed(0.1 * log[0], log[1], DT, robot), plan)
    scales = ", ".join(f"{name}: {20 if k == 0 else 10}" for k, name in enumerate(robot.joint_names))
    assert said.endswith(f'if so, map it: q: {{from: "q.{{joint}}", scale: {{{scales}}}}}')


def test_positions_are_doubted_neither_as_they_are_nor_for_a_torque_of_another_size(robot: Robot, log: Log) -> None:
    for scale in (1.0, 0.01, 100.0):
        assert position_factor(Weighed(log[0], scale * log[1], DT, robot)) is None
