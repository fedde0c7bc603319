"""A robot as it stands and is read: declared tilts of its base and zeros of its encoders turn the robot itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.tilt import declared_tilt, tilted
from elid_cli.robot.robot import Robot
from elid_cli.robot.zeros import with_zeros


def posed(robot: Robot) -> Robot:
    """Return the robot in the gravity and with the geometry that its declared effects stand for, without these."""
    offsets, kept = np.zeros(robot.n), []
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        if kind.moves_zero:
            offsets[joint] += float(spec.parameters.get(kind.amplitudes[0].name, 0.0))
        elif not kind.turns_gravity:
            kept.append(spec)
    if len(kept) == len(robot.effects):
        return robot
    turned = tilted(with_zeros(robot, offsets), declared_tilt(robot))
    return replace(turned, effects=tuple(kept))
