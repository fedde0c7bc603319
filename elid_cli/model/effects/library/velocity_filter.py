"""Velocity filter: the drive's damping term takes a velocity that a first-order filter has made late."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class VelocityFilter(Effect):
    """A first-order low-pass filter of the velocity that a drive's loop takes.

    It acts in the simulated motion, and in a torque that is computed from the log as far as the logged velocity is
    not late itself (`of_drives.with_filters`); it has no column.
    """

    name = "velocity_filter"
    summary = "filter of the velocity that the drive's loop takes"
    equation = "drive: kd (dq_des - v) with time · dv/dt + v = dq, in place of kd (dq_des - dq)"
    physics = (
        "Drives differentiate their encoder and filter the result. The loop damps by that velocity, which comes late,"
        " and a model without the filter finds the inertia too small by kd times that time."
    )
    typical = "1-10 ms"
    fingerprint = (
        "one drive or all, in fast motion: inertia that is too small by kd times the time, and what that leaves"
    )
    record = "fast motion beside slow motion, with other kd: the time stays, the missing inertia is kd times it"
    place = "torque"
    searched = False
    of_drive = "filter"
    amplitudes = (Parameter("time", "s", "time constant of the filter", low=0.0, high=0.05),)
    example = {"time": 0.004}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: a declared filter is in the computed torque, and the motion finds others."""
        return {}
