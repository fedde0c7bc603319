"""The paper's eqs. (8)-(12) and (15)-(34) as printed, one by one, in the base frame, for elastic joints.

Slow on purpose. Differences from print: (24) has J^(j) for J^(i), (25) has A_O where (10) gives A_P; (26) and (27) are
missing from it and follow from (10).
"""

from __future__ import annotations

import numpy as np

from elid_cli.robot.robot import Robot

Matrix = np.ndarray


def x_(a: Matrix) -> Matrix:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def bow(a: Matrix) -> Matrix:
    """Endnote 1: (a)_bow [sxx syy szz sxy sxz syz] = S a."""
    return np.array([[a[0], 0, 0, a[1], a[2], 0], [0, a[1], 0, a[0], 0, a[2]], [0, 0, a[2], 0, a[0], a[1]]])


class Kinematics:
    """R_i, J_P^(i), J_O^(i) for i = 0…n, their derivatives A_P,(k)^(i), A_O,(k)^(i)."""

    def __init__(self, robot: Robot, q: Matrix) -> None:
        n = self.n = robot.n
        pose = np.eye(4)
        self.R, points = [np.eye(3)], [np.zeros(3)]
        axes, origins = [], []
        for joint, (before, after), value in zip(robot.joints, robot.placements(), q, strict=True):
            at = pose @ before
            axes.append(at[:3, 2])
            origins.append(at[:3, 3])
            motion = np.eye(4)
            if joint.revolute:
                motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
            else:
                motion[2, 3] = value
            pose = at @ motion @ after
            self.R.append(pose[:3, :3])
            points.append(pose[:3, 3])
        turns = [joint.revolute for joint in robot.joints]
        self.JP, self.JO = np.zeros((n + 1, 3, n)), np.zeros((n + 1, 3, n))
        self.AP, self.AO = np.zeros((n, n + 1, 3, n)), np.zeros((n, n + 1, 3, n))
        for i in range(n + 1):
            for j in range(i):
                z, arm = axes[j], points[i] - origins[j]
                self.JP[i][:, j] = np.cross(z, arm) if turns[j] else z
                self.JO[i][:, j] = z if turns[j] else 0
                for k in range(i):
                    turned = np.cross(axes[k], z) if turns[k] and k < j else np.zeros(3)
                    if turns[k]:
                        moved = np.cross(axes[k], arm if k < j else points[i] - origins[k])
                    else:
                        moved = np.zeros(3) if k < j else axes[k]
                    if turns[j]:
                        self.AP[k, i][:, j] = np.cross(turned, arm) + np.cross(z, moved)
                        self.AO[k, i][:, j] = turned
                    else:
                        self.AP[k, i][:, j] = turned


def inertia(robot: Robot, at: Kinematics, p: dict[str, float]) -> Matrix:
    """Return B(q), eqs. (7), (8)."""
    n = robot.n
    B, Bd, BY = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    for i, joint in enumerate(robot.joints, start=1):
        R, JP, JO = at.R[i], at.JP[i], at.JO[i]
        Rc = x_(R @ np.array([p[f"c{a}{i}"] for a in "xyz"]))
        s = [p[f"I{a}{i}"] for a in ("xx", "yy", "zz", "xy", "xz", "yz")]
        tensor = R @ np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]]) @ R.T
        B += p[f"m{i}"] * JP.T @ JP + JO.T @ Rc @ JP - JP.T @ Rc @ JO + JO.T @ tensor @ JO
        Bd[:, i - 1] = p[f"Jm{i}"] * joint.gear_ratio * at.JO[i - 1].T @ at.R[i - 1] @ np.array(joint.motor_axis)
        BY[i - 1, i - 1] = p[f"Jm{i}"] * joint.gear_ratio**2
    return np.block([[B, Bd], [Bd.T, BY]])


def inertia_derivative(robot: Robot, at: Kinematics, p: dict[str, float], k: int) -> Matrix:
    """Return H^(k)(q) = dB/dq_k, eqs. (9)-(11)."""
    n = robot.n
    H, Hd = np.zeros((n, n)), np.zeros((n, n))
    for i in range(1, n + 1):
        R, JP, JO, AP, AO = at.R[i], at.JP[i], at.JO[i], at.AP[k, i], at.AO[k, i]
        w = x_(JO[:, k])
        c = R @ np.array([p[f"c{a}{i}"] for a in "xyz"])
        s = [p[f"I{a}{i}"] for a in ("xx", "yy", "zz", "xy", "xz", "yz")]
        tensor = R @ np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]]) @ R.T
        H += p[f"m{i}"] * (AP.T @ JP + JP.T @ AP)
        H += AO.T @ x_(c) @ JP + JO.T @ x_(w @ c) @ JP + JO.T @ x_(c) @ AP
        H -= AP.T @ x_(c) @ JO + JP.T @ x_(w @ c) @ JO + JP.T @ x_(c) @ AO
        H += AO.T @ tensor @ JO + JO.T @ w @ tensor @ JO - JO.T @ tensor @ w @ JO + JO.T @ tensor @ AO
        Hd[:, i - 1] = p[f"Jm{i}"] * r_a(robot, at, i, k)
    return np.block([[H, Hd], [Hd.T, np.zeros((n, n))]])


def r_a(robot: Robot, at: Kinematics, i: int, k: int) -> Matrix:
    """Return r_a_i^(k), eq. (11)."""
    joint = robot.joints[i - 1]
    R, JO, AO = at.R[i - 1], at.JO[i - 1], at.AO[k, i - 1]
    return joint.gear_ratio * (AO.T @ R + JO.T @ x_(JO[:, k]) @ R) @ np.array(joint.motor_axis)


def inertia_regressor(robot: Robot, at: Kinematics, ddq: Matrix, ddtheta: Matrix) -> Matrix:
    """Return Y_B, eqs. (15)-(21)."""
    n = robot.n
    Y = np.zeros((2 * n, 14 * n))
    for i, joint in enumerate(robot.joints, start=1):
        R, JP, JO = at.R[i], at.JP[i], at.JO[i]
        Y[:n, i - 1] = JP.T @ JP @ ddq
        Y[:n, n + 3 * (i - 1) : n + 3 * i] = (JP.T @ x_(JO @ ddq) - JO.T @ x_(JP @ ddq)) @ R
        Y[:n, 4 * n + 6 * (i - 1) : 4 * n + 6 * i] = JO.T @ R @ bow(R.T @ JO @ ddq)
        carrier = at.JO[i - 1].T @ at.R[i - 1] @ np.array(joint.motor_axis)
        Y[:n, 10 * n + i - 1] = ddtheta[i - 1] * joint.gear_ratio * carrier
        Y[n + i - 1, 10 * n + i - 1] = joint.gear_ratio * carrier @ ddq + joint.gear_ratio**2 * ddtheta[i - 1]
    return Y


def derivative_regressor(robot: Robot, at: Kinematics, dq: Matrix, dtheta: Matrix, k: int) -> Matrix:
    """Return Y_H^(k), eqs. (23)-(28)."""
    n = robot.n
    Y = np.zeros((2 * n, 14 * n))
    for i in range(1, n + 1):
        R, JP, JO, AP, AO = at.R[i], at.JP[i], at.JO[i], at.AP[k, i], at.AO[k, i]
        w = x_(JO[:, k])
        Y[:n, i - 1] = AP.T @ JP @ dq + JP.T @ AP @ dq
        Y[:n, n + 3 * (i - 1) : n + 3 * i] = (
            AP.T @ x_(JO @ dq)
            + JP.T @ x_(AO @ dq)
            + JP.T @ x_(JO @ dq) @ w
            - AO.T @ x_(JP @ dq)
            - JO.T @ x_(AP @ dq)
            - JO.T @ x_(JP @ dq) @ w
        ) @ R
        Y[:n, 4 * n + 6 * (i - 1) : 4 * n + 6 * i] = (AO.T @ R + JO.T @ w @ R) @ bow(R.T @ JO @ dq) + JO.T @ R @ bow(
            R.T @ (AO @ dq - w @ JO @ dq)
        )
        Y[:n, 10 * n + i - 1] = dtheta[i - 1] * r_a(robot, at, i, k)
        Y[n + i - 1, 10 * n + i - 1] = r_a(robot, at, i, k) @ dq
    return Y


def coriolis_regressor(robot: Robot, at: Kinematics, dq: Matrix, dtheta: Matrix) -> Matrix:
    """Return Y_C, eq. (22)."""
    n = robot.n
    YH = [derivative_regressor(robot, at, dq, dtheta, k) for k in range(n)]
    Y = np.sum([dq[k] * YH[k] for k in range(n)], axis=0)
    for k in range(n):
        Y[k] -= 0.5 * np.concatenate([dq, dtheta]) @ YH[k]
    return Y


def other_regressor(robot: Robot, at: Kinematics, q: Matrix, theta: Matrix, dtheta: Matrix) -> Matrix:
    """Return Y_oth, eqs. (12), (29)-(34)."""
    n, g = robot.n, np.array(robot.gravity)
    Y = np.zeros((2 * n, 14 * n))
    for i in range(1, n + 1):
        for j in range(i):
            Y[j, i - 1] = -g @ at.JP[i][:, j]
            Y[j, n + 3 * (i - 1) : n + 3 * i] = -g @ x_(at.JO[i][:, j]) @ at.R[i]
        Y[n + i - 1, 11 * n + i - 1] = np.sign(dtheta[i - 1])
        Y[n + i - 1, 12 * n + i - 1] = dtheta[i - 1]
        Y[i - 1, 13 * n + i - 1] = q[i - 1] - theta[i - 1]
        Y[n + i - 1, 13 * n + i - 1] = -(q[i - 1] - theta[i - 1])
    return Y


def regressor(
    robot: Robot, q: Matrix, dq: Matrix, ddq: Matrix, theta: Matrix, dtheta: Matrix, ddtheta: Matrix
) -> Matrix:
    """Return Y of eq. (13), shape (2n, 14n)."""
    at = Kinematics(robot, q)
    return (
        inertia_regressor(robot, at, ddq, ddtheta)
        + coriolis_regressor(robot, at, dq, dtheta)
        + other_regressor(robot, at, q, theta, dtheta)
    )
