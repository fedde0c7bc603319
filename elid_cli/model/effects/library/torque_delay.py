"""Torque delay: the logged torque is ahead of the one that acts, or behind it."""

from __future__ import annotations

from collections.abc import Mapping

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import derivative, motor_row
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.time_shift import shifted

LATEST = -0.025
"""s; a torque that seems logged later than that is none: no filter of a drive is so slow."""


class TorqueDelay(Effect):
    """A time shift between the torque channel and the position channels."""

    name = "torque_delay"
    summary = "torque that acts later than logged, or is logged later than it acts"
    equation = "motor equation: delay dτ/dt, that is τ(t - delay) acts at t"
    physics = (
        "A log that holds the commanded torque is ahead: current loop, amplifier and zero-order hold deliver it later"
        " (half a sample at least). One that holds a measured current, filtered or stamped on arrival, is behind: the"
        " delay is negative."
    )
    typical = "half a sample to 8 ms, either way"
    fingerprint = "motor side and whole joint, along the torque's own rate of change"
    record = (
        "fast torque changes; a transmission damper shows on the motor side only, a delay in the whole joint as well"
    )
    place = "torque"
    either_sign = "A torque is logged before or after it acts."
    amplitudes = (
        Parameter("delay", "s", "time from a logged torque to its effect, negative where it acts first", LATEST, 0.1),
    )
    corrects = "torque"
    nuisance = "delay"
    example = {"delay": 0.003}
    twins = ("transmission_damping",)
    simulated = "log"

    def columns(self, scene: Scene) -> Columns:
        """Return the torque's derivative in the motor row: model + delay dτ/dt = τ."""
        key = ("torque rate", self.joint)
        if key not in scene.cache:
            delayed = scene.tau if scene.command_torque is None else scene.command_torque
            scene.cache[key] = derivative(delayed[:, self.joint], scene.dt, scene.starts)
        return motor_row(self.joint, scene.cache[key])

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the torque as logged: ahead of the one that acts by the delay."""
        return self._in_channels(signals, ("tau",), lambda tau: shifted(tau, values["delay"] / dt))
