"""Friction that changes while the log lasts, as a gear warms up."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.parameter import StandardParameter

LINEAR = 5.0
"""Time constant in lengths of the log that bends by a hundredth."""
STRAIGHT = 1e3
"""The same from which it counts as linear."""


class FrictionDrift(Effect):
    """Coulomb and viscous friction that change over the log, towards what they are when warm."""

    name = "friction_drift"
    summary = "Coulomb and viscous friction that drift during the log (warm-up)"
    equation = (
        "motor equation: (g(t) - 1/2) (coulomb sign(θ') + viscous θ'),  g = (1 - exp(-t/time)) / (1 - exp(-T/time))"
    )
    physics = "Lubricant warms as it is sheared and gets thinner, seals soften, preload relaxes."
    typical = "viscous friction -30 to -60 % over 20-60 K, minutes to an hour"
    fingerprint = "motor side and whole joint, the product of time and velocity or direction"
    record = "minutes of motion that repeat the first movement at the end; a temperature column"
    place = "motor"
    takes_energy = True
    amplitudes = (
        Parameter("coulomb", "N·m", "change of Coulomb friction from the first to the last instant; fs is midway"),
        Parameter(
            "viscous", "N·m·s/rad", "change of viscous friction from the first to the last instant; fv is midway"
        ),
    )
    shapes = (Parameter("time", "s", "time constant of the change; linear in time when not given", low=1e-3),)
    example = {"coulomb": -0.3, "viscous": 0.15}

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return time constants from a sixth of the log to several logs, which is a straight line."""
        return [(share * scene.duration,) for share in (0.15, 0.3, 0.6, 1.5, LINEAR)] if scene.duration > 0 else []

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`; without a time constant the change is linear."""
        time = float(values.get("time", 2.0 * STRAIGHT * scene.duration))
        return np.array([float(values["coulomb"]), float(values["viscous"])]), (time,)

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether friction stays friction: neither part may turn around during the log (±half of it each way)."""
        known = dict(zip(scene.robot.parameter_names(), scene.parameters.tolist(), strict=True))
        coulomb, viscous = known[StandardParameter("fs", joint)], known[StandardParameter("fv", joint)]
        if coulomb <= 0 and viscous <= 0:
            return True
        speed = scene.top_speed(joint, 0.9)
        whole = max(coulomb, 0.0) + max(viscous, 0.0) * speed
        return bool(abs(values["coulomb"]) + abs(values["viscous"]) * speed < 1.5 * whole)

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of both changes in the motor row."""
        part, passed = self.shape[0] / scene.duration, scene.motion.t / scene.duration
        time = passed - 0.5 if part > STRAIGHT else np.expm1(-passed / part) / np.expm1(-1.0 / part) - 0.5
        return motor_row(self.joint, time * scene.direction(self.joint), time * scene.motion.dtheta[:, self.joint])
