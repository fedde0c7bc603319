"""The regressor against Lagrange's equations of eq. (1), whose two energies are written here as plain scalars.

Derivatives are taken by complex steps (a finite difference without cancellation), and the derivative to a velocity,
in which the kinetic energy is quadratic, by an exact central difference. Nothing is shared with elid but the
description of the robot: frames are chained here from the Denavit-Hartenberg numbers themselves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.motion import random_motion
from tests.robot.random_robots import random_robot

STEP = 1e-30


def turn(axis: str, angle: complex) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    block = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis]
    return np.block([[np.array(block), np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def shift(x: complex, z: complex) -> np.ndarray:
    matrix = np.eye(4, dtype=complex)
    matrix[0, 3], matrix[2, 3] = x, z
    return matrix


def link(joint: Joint, dh: str, q: complex) -> np.ndarray:
    theta, d = (joint.theta + q, joint.d) if joint.revolute else (joint.theta, joint.d + q)
    if dh == "standard":
        return turn("z", theta) @ shift(0, d) @ shift(joint.a, 0) @ turn("x", joint.alpha)
    return turn("x", joint.alpha) @ shift(joint.a, 0) @ turn("z", theta) @ shift(0, d)


def poses(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    found = [np.eye(4, dtype=complex)]
    for joint, value in zip(robot.joints, q, strict=True):
        found.append(found[-1] @ link(joint, robot.dh, value))
    return found


def velocities(robot: Robot, q: np.ndarray, dq: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (velocity of the origin, angular velocity) of frames 0…n in the base frame, from axes and points."""
    at = poses(robot, q)
    found = []
    for i, pose in enumerate(at):
        v, w = np.zeros(3, dtype=complex), np.zeros(3, dtype=complex)
        for k in range(i):
            joint = robot.joints[k]
            before = at[k] if robot.dh == "standard" else at[k] @ turn("x", joint.alpha) @ shift(joint.a, 0)
            axis, point = before[:3, 2], before[:3, 3]
            if joint.revolute:
                v = v + dq[k] * np.cross(axis, pose[:3, 3] - point)
                w = w + dq[k] * axis
            else:
                v = v + dq[k] * axis
        found.append((v, w))
    return found


def kinetic(robot: Robot, p: dict[str, float], q: np.ndarray, dq: np.ndarray, dtheta: np.ndarray) -> complex:
    at, moving = poses(robot, q), velocities(robot, q, dq)
    energy: complex = 0
    for i, joint in enumerate(robot.joints, start=1):
        R, (v, w) = at[i][:3, :3], moving[i]
        c = R @ np.array([p[f"c{x}{i}"] for x in "xyz"])
        upper = {x + y: p[f"I{x}{y}{i}"] for x, y in ("xx", "yy", "zz", "xy", "xz", "yz")}
        I = R @ np.array([[upper["".join(sorted(x + y))] for y in "xyz"] for x in "xyz"]) @ R.T  # noqa: E741
        energy += 0.5 * p[f"m{i}"] * v @ v + v @ np.cross(w, c) + 0.5 * w @ I @ w
        axis = at[i - 1][:3, :3] @ np.array(joint.motor_axis)
        k, Jm = joint.gear_ratio, p[f"Jm{i}"]
        energy += k * dtheta[i - 1] * Jm * axis @ moving[i - 1][1] + 0.5 * k**2 * dtheta[i - 1] ** 2 * Jm
    return energy


def potential(robot: Robot, p: dict[str, float], q: np.ndarray, theta: np.ndarray) -> complex:
    g = np.array(robot.gravity)
    energy: complex = 0
    for i, pose in enumerate(poses(robot, q)[1:], start=1):
        energy -= g @ (p[f"m{i}"] * pose[:3, 3] + pose[:3, :3] @ np.array([p[f"c{x}{i}"] for x in "xyz"]))
        energy += 0.5 * p.get(f"K{i}", 0.0) * (q[i - 1] - theta[i - 1]) ** 2
    return energy


def gradient(f: Callable[[np.ndarray], complex], x: np.ndarray) -> np.ndarray:
    steps = STEP * 1j * np.eye(len(x))
    return np.array([complex(f(x + step)).imag / STEP for step in steps])


def lagrange(
    robot: Robot, p: dict[str, float], x: np.ndarray, dx: np.ndarray, ddx: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the left sides of Lagrange's equations of (links, motors), friction included; states of q then θ."""
    n = robot.n

    def momentum(x: np.ndarray, dx: np.ndarray) -> np.ndarray:
        units = np.eye(2 * n)
        ahead = [kinetic(robot, p, x[:n], (dx + e)[:n], (dx + e)[n:]) for e in units]
        behind = [kinetic(robot, p, x[:n], (dx - e)[:n], (dx - e)[n:]) for e in units]
        return (np.array(ahead) - np.array(behind)) / 2

    rate = momentum(x + STEP * 1j * dx, dx + STEP * 1j * ddx).imag / STEP
    slope_T = gradient(lambda y: kinetic(robot, p, y[:n], dx[:n], dx[n:]), x)
    slope_U = gradient(lambda y: potential(robot, p, y[:n], y[n:]), x)
    rows = rate - slope_T + slope_U
    for i in range(n):
        rows[n + i] += p[f"fv{i + 1}"] * dx[n + i] + p[f"fs{i + 1}"] * np.sign(dx[n + i])
    return rows[:n], rows[n:]


ROBOTS = {
    "standard": random_robot(1, 4, "standard", own_axes=True),
    "modified": random_robot(2, 4, "modified", own_axes=True),
    "sliding": random_robot(3, 4, "standard", kinds="rpr", own_axes=True),
    "sliding, modified": random_robot(4, 4, "modified", kinds="pr", own_axes=True),
    "mixed": random_robot(5, 5, "standard", kinds="rrp", rigid=(1, 2, 4), own_axes=True),
    "rigid, modified": random_robot(6, 3, "modified", rigid=(0, 1, 2), own_axes=True),
    "planar2": read_robot("planar2"),
    "puma560": read_robot("puma560"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_regressor_is_lagranges_equations(name: str) -> None:
    robot = ROBOTS[name]
    model = Regressor(robot)
    motion = random_motion(robot.n, robot.elastic, 6, seed=11)
    values = np.random.default_rng(12).normal(size=(6, model.parameters))  # any numbers: the equations are linear
    columns = model.rows(motion, model.equations)
    for k in range(motion.samples):
        p = dict(zip(model.names, values[k].tolist(), strict=True))
        x, dx, ddx = (
            np.concatenate([link[k], motor[k]])
            for link, motor in ((motion.q, motion.theta), (motion.dq, motion.dtheta), (motion.ddq, motion.ddtheta))
        )
        links, motors = lagrange(robot, p, x, dx, ddx)
        expected = {}
        for j, joint in enumerate(robot.joints):
            if joint.elastic:
                expected |= {EstimationRow("link", j): links[j], EstimationRow("motor", j): motors[j]}
            else:
                expected[EstimationRow("sum", j)] = links[j] + motors[j]  # one coordinate: the two equations add up
        found = {plan.row: columns[plan.row][:, k] @ values[k][plan.columns] for plan in model.equations.rows}
        assert found.keys() == expected.keys()
        scale = max(abs(value) for value in expected.values())
        for row, value in expected.items():
            assert found[row] == pytest.approx(value, rel=1e-9, abs=1e-11 * scale), row


@pytest.mark.parametrize("name", ["mixed", "puma560"])
def test_estimation_rows_are_sums_of_the_equations(name: str) -> None:
    robot = ROBOTS[name]
    model = Regressor(robot)
    motion = random_motion(robot.n, robot.elastic, 20, seed=3)
    by_row = {plan.row: model.dense(motion, model.equations)[k] for k, plan in enumerate(model.equations.rows)}
    for k, plan in enumerate(model.estimation.rows):
        found = model.dense(motion)[k]
        if plan.row.kind == "sum" and robot.joints[plan.row.joint].elastic:
            expected = by_row[EstimationRow("link", plan.row.joint)] + by_row[EstimationRow("motor", plan.row.joint)]
        else:
            expected = by_row[plan.row]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
