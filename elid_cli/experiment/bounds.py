"""Limits of motions: what a robot allows, and a motion made so small that it keeps them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.experiment.information import States
from elid_cli.experiment.reference import ReferenceSpline, SplineReference, limits_of
from elid_cli.robot.ranges import range_of
from elid_cli.robot.robot import Robot

CHECKS = 100.0
"""Instants per second at which limits are checked at the end."""
ROOM = 0.97
"""Share of each limit that is used."""


@dataclass(frozen=True)
class Bounds:
    """Limits of a robot's joints, each (n,); infinite where unknown."""

    low: Array
    high: Array
    velocity: Array
    acceleration: Array
    torque: Array


def bounds_of(robot: Robot) -> Bounds:
    """Return the limits that trajectories keep; range, speed and acceleration get defaults where unknown."""
    ranges = np.array([range_of(joint) for joint in robot.joints])
    speeds = np.array([limits_of(joint) for joint in robot.joints])
    torques = [joint.limits.torque for joint in robot.joints]
    torque = np.array([np.inf if value is None else value for value in torques])
    return Bounds(ranges[:, 0], ranges[:, 1], speeds[:, 0], speeds[:, 1], torque)


def within(
    trajectory: SplineReference, torques: Callable[[States], Array], bounds: Bounds
) -> tuple[SplineReference, dict[str, Array]]:
    """Return the trajectory moved as little less as its limits ask, and the share of every limit that it uses.

    Parameters
    ----------
    trajectory
        The motion.
    torques
        Gives the motor torques (N, n) of a motion's states.
    bounds
        The limits.

    Raises
    ------
    DataError
        The robot cannot even hold itself within its torque limits.

    """
    grid = np.linspace(0.0, trajectory.duration, round(trajectory.duration * CHECKS) + 1)
    home = np.array([spline.points[0] for spline in trajectory.splines])
    for _ in range(60):
        states = trajectory.evaluate(grid)
        used = _shares(states, torques(states), bounds, home)
        worst = np.max([np.nan_to_num(share) for share in used.values()], axis=0)
        if np.all(worst <= 1.0):
            return trajectory, used
        torque = bool(np.any(np.nan_to_num(used["torque"]) > 1.0))
        # a torque depends on all joints' motion, so all of them move less; other limits are a joint's own
        factor = np.where(torque, 0.97, 1.0) * np.where(worst > 1.0, np.minimum(0.999 / worst, 0.999), 1.0)
        factor = np.maximum(factor, 0.9)
        smaller = zip(trajectory.splines, home, factor, strict=True)
        trajectory = replace(
            trajectory, splines=tuple(ReferenceSpline(s.knots, h + f * (s.points - h)) for s, h, f in smaller)
        )
    raise DataError("no motion within the torque limits", hint="check limits: and the masses in the robot file")


def _shares(states: States, torque: Array, bounds: Bounds, home: Array) -> dict[str, Array]:
    q, dq, ddq = states
    up, down = np.maximum((q - home).max(axis=0), 0.0), np.maximum((home - q).max(axis=0), 0.0)
    room = np.maximum(up / (bounds.high - home), down / (home - bounds.low))
    limited = np.where(np.isfinite(bounds.torque), np.abs(torque).max(axis=0) / bounds.torque, np.nan)
    return {
        "position": room,
        "velocity": np.abs(dq).max(axis=0) / bounds.velocity,
        "acceleration": np.abs(ddq).max(axis=0) / bounds.acceleration,
        "torque": limited,
    }
