"""Damping in the transmission, parallel to its spring."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class TransmissionDamping(Effect):
    """A damper beside the spring of the transmission."""

    name = "transmission_damping"
    summary = "viscous damping in the transmission"
    equation = "link equation: +damping (q' - θ'), motor equation: the same with -"
    physics = "Material damping of flexspline, belt or shaft, and oil squeezed between teeth."
    typical = "0.1-1 % of critical; damping/K 1-5 ms"
    fingerprint = "motor side only, along the deflection's rate"
    record = "motion that makes the joint vibrate (jerky steps), link encoder and torque on one clock"
    place = "spring"
    acts_as = "torque"
    elastic_only = True
    amplitudes = (Parameter("damping", "N·m·s/rad", "damping torque per deflection rate", low=0.0),)
    example = {"damping": 8.0}
    twins = ("torque_delay",)

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the damping in both rows of the transmission."""
        j = self.joint
        return spring_rows(j, scene.motion.dq[:, j] - scene.motion.dtheta[:, j])
