"""Friction under load that differs between a motor that drives its load and one that is driven by it."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

MOST = 0.8
"""Largest difference, as of the coefficient of load friction."""


class BackdrivingFriction(Effect):
    """What a joint loses of its load while the load drives the motor, beyond what it loses while driving.

    Half of it is load friction whatever the direction, and half is in proportion to the load: a torque constant that is
    off by as much, but for inertia and friction of the motor.
    """

    name = "backdriving_friction"
    summary = "friction under load that differs while the load drives the motor"
    equation = "motor equation: coefficient (|load| sign(θ') - load |sign(θ')|)/2,  load as in load_friction"
    physics = (
        "Worm, spur and harmonic gears lose more, or less, of what they transmit when the load drives them: other"
        " flanks carry it, and wedge or part."
    )
    typical = "coefficient ±0.02-0.1"
    fingerprint = "motor side and whole joint, the load while it acts in the direction of motion, nothing else"
    record = (
        "inertia or friction of the motor measured by itself (uncoupled, from its data sheet): a torque constant that"
        " is off changes these as well"
    )
    place = "motor"
    takes_energy = True
    either_sign = "A gear may lose more or less where it is driven by its load."
    acts_as = "directed friction"
    amplitudes = (
        Parameter("coefficient", "1", "friction per load while driven beyond that while driving", low=-MOST, high=MOST),
    )
    example = {"coefficient": 0.06}
    twins = ("torque_gain",)
    comes_with = ("load_friction",)
    from_model = True
    by_motion = False

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the coefficient in the motor row."""
        load, direction = scene.load[:, self.joint], scene.direction(self.joint)
        return motor_row(self.joint, 0.5 * (np.abs(load) * direction - load * np.abs(direction)))
