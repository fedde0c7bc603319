"""Kinematic error of the gear: the output does not turn evenly with the input."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.harmonics import ORDER, PHASE, Harmonic
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class KinematicError(Harmonic):
    """A transmission error that repeats with the motor's angle and strains the spring."""

    name = "kinematic_error"
    summary = "transmission error that repeats with the angle (harmonic drive)"
    equation = "link equation: +K amplitude sin(order θ + phase), motor equation: the same with -"
    physics = (
        "Teeth that are not evenly placed make the output lead and lag; in a harmonic drive mostly twice per turn of"
        " the wave generator."
    )
    typical = "amplitude 0.5-2 arc minutes (1.5e-4 to 6e-4 rad); order twice the gear ratio, once or four times"
    fingerprint = "motor side only, periodic in the angle whatever the direction"
    record = "whole turns of the wave generator, slow; link and motor encoders"
    place = "spring"
    elastic_only = strains_spring = True
    amplitudes = (Parameter("amplitude", "rad", "transmission error at the joint", low=0.0, high=0.1), PHASE)
    shapes = (ORDER,)
    short = 0.4  # nothing else in the deflection bends with the angle as gravity does in a torque
    example = {"amplitude": 0.0004, "phase": 0.7, "order": 20.0}

    def columns(self, scene: Scene) -> Columns:
        """Return the sine and the cosine column in both rows of the transmission."""
        return spring_rows(self.joint, *self.waves(scene))
