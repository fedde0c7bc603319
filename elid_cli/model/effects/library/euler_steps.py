"""Euler steps: the log is of a simulator, whose steps are long enough to matter."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class EulerSteps(Effect):
    """A simulator that integrates by semi-implicit Euler steps, MuJoCo's default for one.

    It acts in the simulated motion, and in a torque that is computed from the log (`of_drives.with_steps`), of logs
    whose sample time is a whole number of steps; it has no column.
    """

    name = "euler_steps"
    summary = "log of a simulator that integrates by semi-implicit Euler steps"
    equation = "v(t + step) = v(t) + step M^-1 tau(q(t), v(t)), q(t + step) = q(t) + step v(t + step)"
    physics = (
        "No robot, but a simulator: positions go on with the velocity of the step's end, so that the one that drives"
        " damp is half a step late, and commands seem to act half a step before they are told. A model without it finds"
        " motor inertia too small by half a step times kd less the joint's viscous friction. With `implicit` 1 the"
        " drives' damping is taken at the step's end (MuJoCo's implicitfast, with position or velocity actuators); then"
        " the inertia is found too large, by half a step times kd and the viscous friction. The two differ by an"
        " inertia of one step times kd, and by nothing else but what friction that fades in makes of coupled joints."
    )
    typical = "0.5-5 ms"
    fingerprint = "motion that is half a step ahead of the commands; what the steps leave in fast motion"
    record = "the simulator's step and integrator; with a tenth of the step nothing of it is left"
    place = "torque"
    searched = False
    of_drive = "step"
    amplitudes = (
        Parameter("step", "s", "the simulator's time step", low=0.0, high=0.1),
        Parameter("implicit", "-", "1 where the drives' damping is taken at the step's end, else 0", low=0.0, high=1.0),
    )
    example = {"step": 0.002, "implicit": 0.0}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: declared steps are in the computed torque, and the motion finds others."""
        return {}
