"""The elastic robot written straight from its energies: the slow, independent reference of these tests.

Kinetic energy as in the paper's eq. (1), potential energy of gravity and springs, Lagrange's equations with the
derivatives of the inertia matrix by complex steps. Shares nothing with elid's regressor but the joint placements.
"""

from __future__ import annotations

import numpy as np

from elid_cli.robot.robot import Robot

STEP = 1e-30


def parameters_by_joint(robot: Robot, values: np.ndarray) -> list[dict[str, float]]:
    named = dict(zip(robot.parameter_names(), values, strict=True))
    return [
        {name.removesuffix(str(i)): named[name] for name in named if name.rstrip("0123456789") + str(i) == name}
        for i in range(1, robot.n + 1)
    ]


def frames(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Return 4x4 poses of frames 0…n; complex where q is."""
    poses = [np.eye(4, dtype=q.dtype)]
    for joint, (before, after), angle in zip(robot.joints, robot.placements(), q, strict=True):
        motion = np.eye(4, dtype=q.dtype)
        if joint.revolute:
            c, s = np.cos(angle), np.sin(angle)
            motion[:2, :2] = [[c, -s], [s, c]]
        else:
            motion[2, 3] = angle
        poses.append(poses[-1] @ before @ motion @ after)
    return poses


def jacobians(robot: Robot, q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Return poses of frames 0…n and their (linear, angular) Jacobians in the base frame, each (3, n)."""
    poses = frames(robot, q)
    axes, points = [], []
    for pose, (before, _) in zip(poses, robot.placements(), strict=False):
        at = pose @ before
        axes.append(at[:3, 2])
        points.append(at[:3, 3])
    linear = [np.zeros((3, robot.n), dtype=q.dtype) for _ in poses]
    angular = [np.zeros((3, robot.n), dtype=q.dtype) for _ in poses]
    for i, pose in enumerate(poses):
        for j in range(i):
            if robot.joints[j].revolute:
                linear[i][:, j] = np.cross(axes[j], pose[:3, 3] - points[j])
                angular[i][:, j] = axes[j]
            else:
                linear[i][:, j] = axes[j]
    return poses, linear, angular


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def inertia_matrix(robot: Robot, values: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return B(q) of eq. (6), (2n, 2n), motors after links."""
    n = robot.n
    poses, linear, angular = jacobians(robot, q)
    matrix = np.zeros((2 * n, 2 * n), dtype=q.dtype)
    for i, (joint, p) in enumerate(zip(robot.joints, parameters_by_joint(robot, values), strict=True), start=1):
        rotation = poses[i][:3, :3]
        first = rotation @ np.array([p["cx"], p["cy"], p["cz"]])
        tensor = np.array(
            [[p["Ixx"], p["Ixy"], p["Ixz"]], [p["Ixy"], p["Iyy"], p["Iyz"]], [p["Ixz"], p["Iyz"], p["Izz"]]]
        )
        v, w = linear[i], angular[i]
        cross = -v.T @ skew(first) @ w
        matrix[:n, :n] += p["m"] * v.T @ v + cross + cross.T + w.T @ rotation @ tensor @ rotation.T @ w
        axis = poses[i - 1][:3, :3] @ np.array(joint.motor_axis)
        row = p["Jm"] * joint.gear_ratio * axis @ angular[i - 1]
        matrix[n + i - 1, :n] += row
        matrix[:n, n + i - 1] += row
        matrix[n + i - 1, n + i - 1] += p["Jm"] * joint.gear_ratio**2
    return matrix


def potential(robot: Robot, values: np.ndarray, q: np.ndarray) -> complex:
    poses = frames(robot, q)
    energy = 0.0
    for pose, p in zip(poses[1:], parameters_by_joint(robot, values), strict=True):
        moment = p["m"] * pose[:3, 3] + pose[:3, :3] @ np.array([p["cx"], p["cy"], p["cz"]])
        energy = energy - np.array(robot.gravity) @ moment
    return energy


def accelerations(
    robot: Robot, values: np.ndarray, state: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], tau: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (ddq, ddtheta) for state (q, dq, theta, dtheta) and joint-side torques; rigid joints have theta = q."""
    q, dq, theta, dtheta = state
    n = robot.n
    speeds = np.concatenate([dq, dtheta])
    matrix = inertia_matrix(robot, values, q)
    slopes = np.zeros((n, 2 * n, 2 * n))
    pull = np.zeros(2 * n)
    for k in range(n):
        aside = q.astype(complex)
        aside[k] += 1j * STEP
        slopes[k] = inertia_matrix(robot, values, aside).imag / STEP
        pull[k] = np.imag(potential(robot, values, aside)) / STEP
    coriolis = np.einsum("k,kij,j->i", dq, slopes, speeds)
    coriolis[:n] -= np.einsum("i,kij,j->k", speeds, slopes, speeds) / 2
    force = -coriolis - pull
    stiff = np.array([p.get("K", 0.0) for p in parameters_by_joint(robot, values)])
    friction = np.array([p["fv"] for p in parameters_by_joint(robot, values)]) * dtheta
    friction += np.array([p["fs"] for p in parameters_by_joint(robot, values)]) * np.sign(dtheta)
    force[:n] += stiff * (theta - q)
    force[n:] += tau - friction - stiff * (theta - q)
    # rigid joints: theta = q, so the two rows add up
    fold = np.zeros((2 * n, n + int(robot.elastic.sum())))
    fold[:n, :n] = np.eye(n)
    motors = iter(range(n, fold.shape[1]))
    for i, elastic in enumerate(robot.elastic):
        fold[n + i, next(motors) if elastic else i] = 1
    found = fold @ np.linalg.solve(fold.T @ matrix @ fold, fold.T @ force)
    return found[:n], found[n:]
