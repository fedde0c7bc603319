"""Forward dynamics: the inverse of the regressor's own equations, a true mass matrix, clear refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.mass_matrix import NotPositiveError, ldl_solver
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.motion import Motion
from tests.robot.random_robots import random_robot

ROBOTS = {
    "planar2": read_robot("planar2"),
    "puma560": read_robot("puma560"),
    "emps": read_robot("emps"),
    "mixed": random_robot(51, 5, "standard", kinds="rrp", rigid=(1, 4), own_axes=True),
    "rigid": random_robot(52, 4, "modified", rigid=(0, 1, 2, 3), own_axes=True),
    "urdf": random_robot(53, 3, "urdf", kinds="rp", own_axes=True),
}


def random_state(n: int, seed: int) -> tuple[list[float], ...]:
    generator = np.random.default_rng(seed)
    q, dq, dtheta, tau, links, motors = generator.normal(size=(6, n))
    theta = q + 0.01 * generator.normal(size=n)
    return tuple(v.tolist() for v in (q, dq, theta, dtheta, tau, links, motors))


@pytest.mark.parametrize("name", ROBOTS)
def test_forward_then_inverse_gives_the_torques_back(name: str) -> None:
    robot = ROBOTS[name]
    dynamics = Dynamics(robot)
    for seed in range(10):
        q, dq, theta, dtheta, tau, links, motors = random_state(robot.n, seed)
        ddq, ddtheta = dynamics.acceleration(q, dq, theta, dtheta, tau, (links, motors))
        link_rows, motor_rows = dynamics.inverse(q, dq, ddq, theta, dtheta, ddtheta)
        scale = 1e-9 * max(np.abs(dynamics.mass_matrix(q)).max() * np.abs([*ddq, *ddtheta]).max(), 1.0)
        for k, joint in enumerate(robot.joints):
            if joint.elastic:
                assert link_rows[k] == pytest.approx(-links[k], abs=scale)
                assert motor_rows[k] == pytest.approx(tau[k] - motors[k], abs=scale)
            else:
                assert motor_rows[k] == pytest.approx(tau[k] - motors[k] - links[k], abs=scale)
                assert ddtheta[k] == ddq[k]


@pytest.mark.parametrize("name", ["puma560", "mixed"])
def test_inverse_is_the_regressor_times_the_parameters(name: str) -> None:
    robot = ROBOTS[name]
    dynamics, model = Dynamics(robot, friction_width=1e-9), Regressor(robot)
    q, dq, theta, dtheta, ddq, ddtheta, _ = random_state(robot.n, 5)
    links, motors = dynamics.inverse(q, dq, ddq, theta, dtheta, ddtheta)
    rigid = ~robot.elastic
    columns = [np.array([v]) for v in (q, dq, ddq, theta, dtheta, ddtheta)]
    for k in range(3):
        columns[3 + k] = np.where(rigid, columns[k], columns[3 + k])
    dense = model.dense(Motion(np.zeros(1), *columns), model.equations)[:, 0]
    for plan, row in zip(model.equations.rows, dense, strict=True):
        found = links[plan.row.joint] if plan.row.kind == "link" else motors[plan.row.joint]
        assert found == pytest.approx(row @ dynamics.parameters, rel=1e-11)


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrix_is_symmetric_positive_definite_and_answers_unit_torques(name: str) -> None:
    robot = ROBOTS[name]
    dynamics = Dynamics(robot)
    n, elastic = robot.n, list(dynamics.elastic)
    for seed in range(4):
        q = random_state(n, seed)[0]
        M = dynamics.mass_matrix(q)
        np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-13 * np.abs(M).max())
        assert np.linalg.eigvalsh(M).min() > 0
        rest = [0.0] * n
        quiet = np.concatenate([dynamics.acceleration(q, rest, q, rest, rest)[0], np.zeros(len(elastic))])
        quiet[n:] = np.array(dynamics.acceleration(q, rest, q, rest, rest)[1])[elastic]
        for row, k in enumerate(elastic):
            pushed = [1.0 if j == k else 0.0 for j in range(n)]
            ddq, ddtheta = dynamics.acceleration(q, rest, q, rest, pushed)
            answer = np.concatenate([ddq, np.array(ddtheta)[elastic]]) - quiet
            expected = np.zeros(n + len(elastic))
            expected[n + row] = 1.0
            np.testing.assert_allclose(M @ answer, expected, atol=1e-9)


def test_gravity_feedforward_holds_the_arm_still() -> None:
    robot = ROBOTS["puma560"]
    dynamics = Dynamics(robot)
    q = np.array([[0.3, -0.7, 0.4, 0.2, -0.5, 1.0]])
    torque = dynamics.gravity(q)[0]
    theta = q[0] + torque / dynamics.stiffness
    ddq, ddtheta = dynamics.acceleration(q[0].tolist(), [0.0] * 6, theta.tolist(), [0.0] * 6, torque.tolist())
    assert np.abs([*ddq, *ddtheta]).max() < 1e-9


def test_unknown_parameters_that_matter_are_named() -> None:
    robot = read_robot("quanser_2dsfl")
    poorer = [replace(j, parameters={k: j.parameters[k] for k in ("Jm", "fv", "K")}) for j in robot.joints]
    with pytest.raises(RobotError) as caught:
        Dynamics(replace(robot, joints=tuple(poorer)))
    assert "joint1 m cx Izz fs; joint2 m cx cy Izz fs" in str(caught.value)


def test_parameters_without_influence_may_be_unknown() -> None:
    robot = read_robot("planar2")
    joints = [
        replace(
            j, parameters={k: v for k, v in j.parameters.items() if k not in ("cz", "Ixx", "Iyy", "Ixy", "Ixz", "Iyz")}
        )
        for j in robot.joints
    ]
    poorer = Dynamics(replace(robot, joints=tuple(joints)))
    full = Dynamics(robot)
    state = random_state(2, 3)[:5]
    assert poorer.acceleration(*state) == full.acceleration(*state)


def test_a_body_lighter_than_its_rotor_is_refused() -> None:
    robot = read_robot("planar2")
    first = replace(robot.joints[0], parameters={**robot.joints[0].parameters, "Izz": 1.0})  # Jm2 alone is 12.1
    dynamics = Dynamics(replace(robot, joints=(first, robot.joints[1])))
    with pytest.raises(RobotError, match="joint1: the mass matrix is not positive definite"):
        dynamics.acceleration(*[[0.1, 0.2]] * 5)


def test_a_motor_without_inertia_behind_a_spring_is_refused() -> None:
    robot = read_robot("planar2")
    second = replace(robot.joints[1], parameters={**robot.joints[1].parameters, "Jm": 0.0})
    with pytest.raises(RobotError, match="joint2: Jm = 0"):
        Dynamics(replace(robot, joints=(robot.joints[0], second)))


@pytest.mark.parametrize("n", [1, 2, 6, 9])
def test_straight_line_solver_solves(n: int) -> None:
    generator = np.random.default_rng(n)
    half = generator.normal(size=(n, n))
    A, b = half @ half.T + np.eye(n), generator.normal(size=n)
    upper = [A[i, j] for i in range(n) for j in range(i, n)]
    full = tuple(tuple(range(j + 1)) for j in range(n))
    np.testing.assert_allclose(A @ ldl_solver(full)([*b, *upper]), b, atol=1e-12)
    with pytest.raises(NotPositiveError):
        ldl_solver(full)([*b, *(-value for value in upper)])


def test_straight_line_solver_solves_a_tree() -> None:
    parents = (-1, 0, 1, 1, 0, 4, -1)
    ancestors: list[tuple[int, ...]] = []
    for k, parent in enumerate(parents):
        ancestors.append((*(ancestors[parent] if parent >= 0 else ()), k))
    generator = np.random.default_rng(0)
    L = np.eye(7)
    for k, own in enumerate(ancestors):
        L[k, own[:-1]] = generator.normal(size=len(own) - 1)
    A, b = L.T @ np.diag(generator.uniform(1, 2, 7)) @ L, generator.normal(size=7)
    upper = [A[i, j] for i in range(7) for j in range(i, 7)]
    np.testing.assert_allclose(A @ ldl_solver(tuple(ancestors))([*b, *upper]), b, atol=1e-12)
