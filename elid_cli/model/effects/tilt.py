"""A base that is not level: gravity turned in the model itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import horizontal_axes, turned
from elid_cli.robot.robot import Robot

STEEPEST = 0.5
"""rad; a base that seems steeper is not turned further."""


def tilted(robot: Robot, angles: Array) -> Robot:
    """Return the robot in gravity turned by roll and pitch (rad, (2,)) about its horizontal base axes."""
    if not np.any(angles):
        return robot
    first, second = horizontal_axes(robot)
    x, y, z = (float(v) for v in turned(np.array(robot.gravity), angles[0] * first + angles[1] * second))
    return replace(robot, gravity=(x, y, z))
