"""Stribeck friction: boundary friction that changes with speed before the full film forms."""

from __future__ import annotations

import numpy as np

from elid_cli.terms.effect import Columns, Effect, Parameter, RowKey, Scene


class Stribeck(Effect):
    """Friction that is higher (or lower) at low speed than Coulomb and viscous friction alone."""

    name = "stribeck"
    summary = "friction that rises or falls towards zero speed"
    equation = "motor row: amplitude sign(θ') exp(-|θ'|/velocity)"
    physics = "Boundary lubrication at low speed gives way to a full film as the speed rises (Stribeck 1902)."
    typical = "10-100 % of the Coulomb friction; velocity 0.01-0.3 rad/s at the joint"
    fingerprint = "motor and sum rows, odd in velocity, within three Stribeck velocities of standstill"
    record = "slow passes through zero speed in both directions, and steady slow motion"
    place = "motor"
    amplitudes = (Parameter("amplitude", "N·m", "friction at zero speed above the Coulomb level"),)
    shapes = (Parameter("velocity", "rad/s", "speed over which it decays", low=1e-4),)
    twins = ()

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return velocities from the slowest that the log resolves to half its top speed."""
        top = float(np.quantile(np.abs(scene.motion.dtheta[:, joint]), 0.98))
        return [(v,) for v in (0.02, 0.04, 0.07, 0.12, 0.2, 0.35, 0.6) if 0.01 * top < v < 0.5 * top]

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the amplitude in the motor row."""
        speed = scene.motion.dtheta[:, self.joint]
        value = scene.direction(self.joint) * np.exp(-np.abs(speed) / self.shape[0])
        return {RowKey("motor", self.joint): value[None]}
