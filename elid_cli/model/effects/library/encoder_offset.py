"""Encoder offset: motor and link encoders disagree by a constant angle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter, Same
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene

LARGEST = 3.5
"""rad (m); an encoder zeroed wherever it was may be off by half a turn."""
ONE_SIDED = 0.9
"""Mean sign of the load from which it counts as always on one side."""


class EncoderOffset(Effect):
    """A constant in the deflection that is no deflection."""

    name = "encoder_offset"
    summary = "zeros of motor and link encoder that do not agree"
    equation = "link equation: +K offset, motor equation: the same with -"
    physics = "The two encoders were zeroed at different times, or under load: their difference is off by a constant."
    typical = "0.1-5 mrad"
    fingerprint = "a constant on the motor side only"
    record = "any motion; a torque offset would shift the whole joint as well"
    place = "encoder"
    either_sign = "A zero is off either way."
    elastic_only = strains_spring = True
    amplitudes = (Parameter("offset", "rad", "what the motor encoder reads too much, the link's taken as true"),)
    in_deflection = "constant"
    always_fitted = "no two encoders have the same zero"
    example = {"offset": 0.001}
    twins = ("backlash",)
    simulated = "log"

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the offset is less than about half a turn, by a positive K."""
        return abs(values["offset"]) < LARGEST and not scene.stiffness[joint] <= 0

    @classmethod
    def same_here(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Same, ...]:
        """Return backlash where the load hardly ever changes sides: the gap is then crossed once for all."""
        load = scene.load[:, joint]
        return (Same("backlash", joint, {}),) if abs(float(np.mean(np.sign(load)))) > ONE_SIDED else ()

    def columns(self, scene: Scene) -> Columns:
        """Return the constant in both rows of the transmission."""
        return spring_rows(self.joint, np.ones(scene.samples))

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the motor's position as logged."""
        return self._in_channels(signals, ("theta",), lambda theta: theta + values["offset"])
