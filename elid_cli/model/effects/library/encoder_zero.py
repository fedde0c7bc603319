"""Encoder zero: a joint's positions are read from another zero than the robot file has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import SIDES, model_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import EquationRow, Scene

STEP = 1e-5
"""rad (m); change of the position by which torques are compared."""
FURTHEST = 3.15
"""rad (m); a little more than half a turn."""


class EncoderZero(Effect):
    """A constant in all of one joint's positions.

    The columns hold what the bodies' torques change with the position, at the present parameters. An offset that is
    known turns the robot's own geometry, so that its torque is exact whatever its size, and what the columns tell is
    what is still missing.
    """

    name = "encoder_zero"
    summary = "positions read too large by an offset: a zero that is off"
    equation = "all link equations: what the bodies' torques are at position - offset, less what they are at position"
    physics = (
        "A joint that was homed in a pose a little off, an encoder mounted after service, a link that is not straight:"
        " commands and readings agree, but both are off from the geometry."
    )
    typical = "1-100 mrad; a quarter of a turn where two conventions meet"
    fingerprint = "whole joint, of every joint whose torque depends on this joint's position: weight in turned poses"
    record = "rests and slow motion in many poses, the links behind this joint stretched out as well as folded"
    place = "encoder"
    either_sign = "A zero is off either way."
    from_model = True
    searched = True
    moves_zero = True
    amplitudes = (Parameter("offset", "rad", "what the joint's positions read too much", low=-FURTHEST, high=FURTHEST),)
    example = {"offset": 0.02}
    twins = ("gravity_direction",)
    simulated = "log"

    def columns(self, scene: Scene) -> Columns:
        """Return what all torques of the model change with the joint's position, taken off it."""
        motion, j = scene.motion, self.joint
        moved = motion.of_joint(j).changed(q=motion.q[:, [j]] - STEP, theta=motion.theta[:, [j]] - STEP)
        parameters, key = np.asarray(scene.parameters), ("torques as read",)
        if key not in scene.cache:  # the same for every joint
            scene.cache[key] = model_torque(scene, parameters)
        change = (model_torque(scene, parameters, (j, moved)) - scene.cache[key]) / STEP
        rows = (EquationRow(side, k) for side in SIDES for k in range(scene.robot.n))
        return {row: values[None] for row, values in zip(rows, change, strict=True) if np.any(values)}

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the joint's positions as logged."""
        return self._in_channels(signals, ("q", "theta"), lambda position: position + values["offset"])
