"""Load-dependent friction: a gear that loses a share of the torque it transmits."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

MOST = 0.8
"""Largest coefficient: a gear that loses more than 45 % of what it transmits. Near one, a joint would hold any load by
itself, and what a fit finds there is torque that the model lacks."""


class LoadFriction(Effect):
    """Coulomb friction proportional to the transmitted torque."""

    name = "load_friction"
    summary = "friction that grows with the transmitted torque"
    equation = "motor equation: coefficient |load| sign(θ'),  load = K (θ - q); of a rigid joint, what its bodies need"
    physics = "Tooth contacts slide under load: the normal force, and with it the friction, follows the torque."
    typical = "coefficient 0.03-0.3 (gear efficiency 97-75 %)"
    fingerprint = "motor side and whole joint, the product of direction of motion and size of the load"
    record = "the same speeds under different gravity loads, in both directions"
    taken = (
        "It is taken to be the same whether the motor drives the load or the load drives the motor. If it differs by d"
        " at every joint, no log tells: masses, inertias and stiffnesses are then off by d/2"
    )
    place = "motor"
    takes_energy = True
    acts_as = "friction"
    amplitudes = (Parameter("coefficient", "1", "friction per transmitted torque", low=0.0, high=MOST),)
    example = {"coefficient": 0.1}
    from_model = True

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the coefficient in the motor row."""
        # never the measured torque: with it the column would hold what it is to predict
        return motor_row(self.joint, np.abs(scene.load[:, self.joint]) * scene.direction(self.joint))
