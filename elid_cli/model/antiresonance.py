"""The antiresonance that a robot file means, and what a motion and a log must reach to show it.

The link swings against the held motor at sqrt(K / Jl) / 2π, Jl its inertia while other links give way. What refuses a
stiffness and what plans the motion that shows it ask here, so that they say the same frequency.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.ranges import range_of
from elid_cli.robot.robot import Robot

PAST = 1.3
"""Highest frequency of the motion over the antiresonance."""
PER_PERIOD = 20.0
"""Least samples per period of the highest frequency."""
LOG_RATE = 1000.0
"""Samples per second to log with, at least."""
RIGID_ERROR = 0.05
"""Error of the torque up to which a rigid joint counts as a description."""
LEAST_LINK = 0.05
"""Least share of a link in all inertia that its motor moves."""
LEAST = 1e-6
"""The same of a joint that nothing is described of, in the largest inertia of all."""
LEAST_FREE = 0.002
"""Least eigenvalue of the links' mass matrix, its diagonal 1, in size: that of bodies that no real one is may be
negative."""
POSES = 20
SPREAD = 0.5
"""Share of the joints' ranges that the poses cover."""


def log_rate(top: float) -> float:
    """Return the samples per second that a log with frequencies up to `top`, Hz, needs; whole."""
    return float(np.ceil(max(LOG_RATE, round(PER_PERIOD * top, 6))))


def moved_inertias(robot: Robot) -> Array:
    """Return link and rotor inertia of every joint, joints rigid, kg·m² (kg), (n,): the mean over poses.

    Typical values stand where the robot file has none.
    """
    return np.asarray(_inertias(robot, motors_move=True).diagonal(axis1=1, axis2=2).mean(axis=0))


def _inertias(robot: Robot, *, motors_move: bool) -> Array:
    """Return the mass matrix in several poses, kg·m² (kg), (poses, n, n): of the links, or with motors that go along.

    A motor of an elastic joint that does not is held in the frame that carries it; a rigid joint's always goes along.
    """
    from elid_cli.model.consistency import consistency, prior
    from elid_cli.model.regressor import Regressor
    from elid_cli.signals.motion import Motion

    model = Regressor(robot)
    parameters = prior(robot, consistency(robot, robot.reference()).scales)
    low, high = np.array([range_of(joint) for joint in robot.joints]).T
    off = np.random.default_rng(0).uniform(-0.5, 0.5, (POSES, robot.n))
    q = (low + high) / 2 + SPREAD * (high - low) * off
    still = np.zeros_like(q)

    def torque(ddq: Array) -> Array:
        motion = Motion(np.zeros(len(q)), q, still, ddq, q, still, ddq if motors_move else still)
        whole = model.dense(motion, model.equations) @ parameters
        total = np.zeros_like(q)
        for item, values in zip(model.equations.rows, whole, strict=True):
            if motors_move or item.row.kind != "motor":
                total[:, item.row.joint] += values
        return np.asarray(total)

    rest = torque(still)
    return np.stack([torque(still + unit) - rest for unit in np.eye(robot.n)], axis=2)


def expected_antiresonance(robot: Robot, joint: int, *, others_move: bool = True) -> float:
    """Return the antiresonance of a joint that the robot file means, Hz; NaN where it gives no stiffness.

    Parameters
    ----------
    robot
        Its bodies and K; typical values stand where it has no bodies.
    joint
        Number from 0.
    others_move
        Whether the links of all other joints give way, which leaves less inertia to this spring: the highest
        antiresonance to expect. False: they are held, the lowest.
    """
    values = dict(zip(robot.parameter_names(), robot.reference().tolist(), strict=True))
    stiffness = values.get(StandardParameter("K", joint), np.nan)
    if not stiffness > 0:
        return float("nan")
    links = _inertias(robot, motors_move=False)
    whole = np.abs(moved_inertias(robot))
    least = LEAST_LINK * np.maximum(whole, LEAST * whole.max())
    held = np.maximum(links.diagonal(axis1=1, axis2=2).mean(axis=0), least)
    if not held[joint] > 0:
        return float("nan")
    if not others_move:
        return float(np.sqrt(stiffness / held[joint]) / (2 * np.pi))
    held = np.where(held > 0, held, 1.0)
    size, axes = np.linalg.eigh(links / np.sqrt(np.outer(held, held)))
    moved = np.mean(np.sum(axes[:, joint] ** 2 / np.maximum(np.abs(size), LEAST_FREE), axis=1))
    return float(np.sqrt(stiffness * max(moved, 1.0) / held[joint]) / (2 * np.pi))
