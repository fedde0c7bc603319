"""Encoder zero: a joint's positions are read from another zero than the robot file has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import SIDES, model_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import EquationRow, Scene

STEP = 1e-5
"""rad (m); change of the position by which torques are compared where the offset is not known, or smaller."""


class EncoderZero(Effect):
    """A constant in all of one joint's positions.

    The columns hold what the bodies' torques, at the present parameters, change from the position as read to the one
    that the present offset means, per offset: once these agree, the torque is exact. A motion that is simulated under
    commands finds it as a turn of the robot's own geometry.
    """

    name = "encoder_zero"
    summary = "positions read too large by an offset: a zero that is off"
    equation = "all link equations: what the bodies' torques are at position - offset, less what they are at position"
    physics = (
        "A joint that was homed in a pose a little off, an encoder mounted after service, a link that is not straight:"
        " commands and readings agree, but both are off from the geometry."
    )
    typical = "1-100 mrad"
    fingerprint = "whole joint, of every joint whose torque depends on this joint's position: weight in turned poses"
    record = "rests and slow motion in many poses, the links behind this joint stretched out as well as folded"
    place = "encoder"
    either_sign = "A zero is off either way."
    from_model = True
    searched = True
    moves_zero = True
    amplitudes = (Parameter("offset", "rad", "what the joint's positions read too much", low=-0.5, high=0.5),)
    example = {"offset": 0.02}
    twins = ("gravity_direction",)
    simulated = "log"

    def columns(self, scene: Scene) -> Columns:
        """Return what all torques of the model change, over the offset, where it is taken off the joint's position."""
        motion, j = scene.motion, self.joint
        known = scene.zeros.get(j, 0.0)
        step = known if abs(known) > STEP else STEP
        moved = motion.of_joint(j).changed(q=motion.q[:, [j]] - step, theta=motion.theta[:, [j]] - step)
        parameters, key = np.asarray(scene.parameters), ("torques as read",)
        if key not in scene.cache:  # the same for every joint
            scene.cache[key] = model_torque(scene, parameters)
        change = (model_torque(scene, parameters, (j, moved)) - scene.cache[key]) / step
        rows = (EquationRow(side, k) for side in SIDES for k in range(scene.robot.n))
        return {row: values[None] for row, values in zip(rows, change, strict=True) if np.any(values)}

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the joint's positions as logged."""
        return self._in_channels(signals, ("q", "theta"), lambda position: position + values["offset"])
