"""Stiffness that grows (or falls) with the deflection."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class CubicStiffness(Effect):
    """A spring that hardens with the cube of its deflection."""

    name = "cubic_stiffness"
    summary = "transmission that stiffens with deflection"
    equation = "link equation: +cubic (q - θ)³, motor equation: the same with -"
    physics = "More teeth share the load as the torque rises (harmonic drives: K1 < K2 < K3); rubber softens instead."
    typical = "stiffness at full load 1.3-2 times that at rest"
    fingerprint = "motor side only, odd in the deflection and curved, no plateau at zero"
    record = "loads up to the rated torque in both directions, slowly"
    place = "spring"
    either_sign = "A transmission may stiffen or soften, as long as it pushes back."
    acts_as = "torque"
    elastic_only = True
    amplitudes = (Parameter("cubic", "N·m/rad³", "coefficient of the deflection's cube"),)
    example = {"cubic": 4000000.0}

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the spring still pushes back harder the more it is bent, within the deflections of this log."""
        most = float(np.max(np.abs(scene.deflection(joint)), initial=0.0))
        stiffness = float(scene.stiffness[joint])
        return not stiffness + 3 * values["cubic"] * most**2 <= 0

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the cubic coefficient in both rows of the transmission."""
        return spring_rows(self.joint, scene.deflection(self.joint) ** 3)
