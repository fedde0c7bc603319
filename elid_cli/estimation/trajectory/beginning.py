"""What a trajectory fit begins with: drive parameters by least squares of the torque, joint by joint."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

SLOW = 0.1
"""Part of the usual speed below which friction is not looked at for the start."""
OWN = 0.1
"""Part of a joint's torque that its inertia, and each of its frictions, has at the start at least."""


def started_from(robot: Robot, signals: Signals) -> Array:
    """Return drive parameters to start from, (n, 4): least squares joint by joint, the bodies as the file says."""
    dq, ddq = signals.motion.dtheta, signals.motion.ddtheta
    left = torque_of_drives(robot, signals)
    values, least = np.empty((robot.n, len(KINDS))), np.empty((robot.n, 3))
    for k in range(robot.n):
        speed = dq[:, k]
        usual = max(float(np.sqrt(np.nanmean(speed**2))), 1e-9)  # between stretches there is no motion
        use = (np.abs(speed) > SLOW * usual) & np.isfinite(left[:, k])
        columns = np.stack([ddq[:, k], np.sign(speed), speed, np.ones_like(speed)], axis=1)[use]
        values[k] = np.linalg.lstsq(columns, left[use, k], rcond=None)[0]
        sizes = np.sqrt(np.mean(columns[:, :3] ** 2, axis=0)) if use.any() else np.ones(3)
        least[k] = OWN * np.std(left[use, k]) / np.maximum(sizes, 1e-9) if use.any() else 0.0
    # none is 0: a part of what moves the joint, or of what others have, whichever is less: wrists are light
    typical = np.maximum(np.median(values[:, :3], axis=0), 1e-4)
    values[:, :3] = np.maximum(values[:, :3], np.minimum(0.2 * typical, np.maximum(least, 1e-9)))
    return values


def torque_of_drives(robot: Robot, signals: Signals) -> Array:
    """Return the torque that the bodies as the file has them leave to drives, along the measured motion, (N, n)."""
    motion = signals.motion
    q, dq, ddq = motion.theta, motion.dtheta, motion.ddtheta
    local = Linearised(robot, without=PARAMETERS).about(q[:, None], dq[:, None])
    left: Array = signals.tau - local.force[:, 0] - np.einsum("nij,nj->ni", local.mass[:, 0], ddq)
    return left
