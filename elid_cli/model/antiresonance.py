"""The antiresonance that a robot file means, and what a motion and a log must reach to show it.

The link swings against the held motor at sqrt(K / Jl) / 2π. What refuses a stiffness and what plans the motion that
shows it ask here, so that they say the same frequency.
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
ROTOR = 0.35
"""Share of all inertia that a rotor of unknown inertia is taken to have."""
LEAST_LINK = 0.05
"""Least share of a link."""
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
        motion = Motion(np.zeros(len(q)), q, still, ddq, q, still, ddq)
        whole = model.dense(motion, model.equations) @ parameters
        total = np.zeros_like(q)
        for item, values in zip(model.equations.rows, whole, strict=True):
            total[:, item.row.joint] += values
        return np.asarray(total)

    rest = torque(still)
    unit = np.eye(robot.n)
    return np.asarray(np.array([np.mean(torque(still + unit[k])[:, k] - rest[:, k]) for k in range(robot.n)]))


def expected_antiresonance(robot: Robot, joint: int) -> float:
    """Return the antiresonance of a joint that the robot file means, Hz; NaN where it gives no stiffness."""
    values = dict(zip(robot.parameter_names(), robot.reference().tolist(), strict=True))
    stiffness = values.get(StandardParameter("K", joint), np.nan)
    if not stiffness > 0:
        return float("nan")
    inertia = float(moved_inertias(robot)[joint])
    rotor = values[robot.rotor_names[joint]] * (robot.joints[joint].gear_ratio or 1.0) ** 2
    link = inertia - (rotor if np.isfinite(rotor) else ROTOR * inertia)
    return float(np.sqrt(stiffness / max(link, LEAST_LINK * inertia)) / (2 * np.pi))
