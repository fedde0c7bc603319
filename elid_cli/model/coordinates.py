"""Which coordinates a robot's motion has: links' positions, and motors' behind springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.robot.robot import Robot


@dataclass(frozen=True)
class Coordinates:
    """Places of the motion's m coordinates: the links' n positions, then the motors' of elastic joints."""

    links: int
    motors: NDArray[np.intp]
    """Coordinate that the motor of each joint moves, (n,)."""

    @property
    def count(self) -> int:
        """Number of coordinates m."""
        return max(self.links, int(self.motors.max()) + 1)


def coordinates_of(robot: Robot) -> Coordinates:
    """Return the coordinates of a robot's motion."""
    elastic = np.array([joint.elastic for joint in robot.joints])
    motors = np.arange(robot.n)
    motors[elastic] = robot.n + np.arange(np.count_nonzero(elastic))
    return Coordinates(robot.n, motors)


def chains_of(robot: Robot) -> NDArray[np.intp]:
    """Return the first joint of the chain that each coordinate belongs to, (m,): chains do not move each other."""
    places, roots = coordinates_of(robot), [own[0] for own in robot.ancestors]
    found = np.empty(places.count, dtype=np.intp)
    found[: robot.n] = found[places.motors] = roots
    return found


def side_by_side(chain: NDArray[np.intp]) -> list[list[int]]:
    """Return coordinates of `chains_of` (m,), one of every chain at a time: they do not move each other."""
    place = np.array([np.count_nonzero(chain[:k] == root) for k, root in enumerate(chain)])
    return [np.flatnonzero(place == number).tolist() for number in range(int(place.max()) + 1)]
