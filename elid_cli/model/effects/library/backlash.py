"""Backlash: an angle over which the transmission carries no torque."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class Backlash(Effect):
    """A dead zone of the spring: within the gap its torque is taken away again."""

    name = "backlash"
    summary = "play in the transmission (dead zone)"
    equation = "link equation: -stiffness clip(q - θ, -gap, gap), motor equation: the same with +;  stiffness = K"
    physics = "Teeth need clearance and wear gives more of it: the link floats until a flank is touched."
    typical = "planetary gears 3-15 arc minutes in all (gap 0.4-2 mrad), cycloidal and harmonic drives below 1-2"
    fingerprint = "motor side only, odd in the deflection, a plateau of torque around zero"
    record = "torques that change sign often and slowly: gravity on both sides, or contact with either flank"
    place = "spring"
    acts_as = "torque"
    elastic_only = True
    amplitudes = (
        Parameter(
            "stiffness",
            "N·m/rad",
            "stiffness missing within the gap; a true gap misses all of K (the default)",
            low=0.0,
        ),
    )
    shapes = (Parameter("gap", "rad", "half the play: deflection from the middle to a flank", low=1e-7),)
    example = {"stiffness": 3000.0, "gap": 0.0015}
    twins = ("encoder_offset",)

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return half gaps as shares of the deflections in this log."""
        top = float(np.quantile(np.abs(scene.deflection(joint)), 0.98))
        return [(top * share,) for share in (0.03, 0.06, 0.12, 0.22, 0.38, 0.6)] if top > 0 else []

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return stiffness and gap; the coefficient is minus the stiffness."""
        return {"stiffness": -float(coefficients[0]), "gap": self.shape[0]}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`; the stiffness may be left out."""
        stiffness = values.get("stiffness", float(scene.stiffness[joint]))
        return np.array([-float(stiffness)]), (float(values["gap"]),)

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the dead zone takes away the whole spring: its slope must be -K, within 30 %."""
        stiffness = float(scene.stiffness[joint])
        return values["gap"] > 0 and 0.7 * stiffness < values["stiffness"] < 1.3 * stiffness

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the dead zone in both rows of the transmission."""
        gap = self.shape[0]
        return spring_rows(self.joint, np.clip(scene.deflection(self.joint), -gap, gap))
