"""Held loop: a drive computes its torque once per period and holds it until the next."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class HeldLoop(Effect):
    """A drive whose loop runs at the log's rate, or another one: its torque is held for a period.

    It acts in the simulated motion, and in a torque that is computed from the log (`of_drives.with_held_loops`); it has
    no column.
    """

    name = "held_loop"
    summary = "loop of the drive that is computed once per period, its torque held"
    equation = "drive: kp (q_des - q) + kd (dq_des - dq) at the start of every period, in place of at every instant"
    physics = (
        "The loop runs on the computer that logs, or in a simulator's controller. Positions and velocities act late by"
        " half a period: a model without it finds viscous friction too small by kp, and inertia by kd, times that."
    )
    typical = "1-10 ms"
    fingerprint = "all drives, fast motion: viscous friction and inertia too small, and what the steps of torque leave"
    record = "the same motion with other gains: the missing friction is kp, the missing inertia kd, times half a period"
    place = "torque"
    searched = False
    of_drive = "hold"
    amplitudes = (Parameter("period", "s", "time from one torque to the next", low=0.0, high=0.1),)
    example = {"period": 0.004}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: a declared loop is in the computed torque, and the motion finds others."""
        return {}
