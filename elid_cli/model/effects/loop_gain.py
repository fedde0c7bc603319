"""A gain of a drive's loop that is another one than the log or the robot file tells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class LoopGain(Effect):
    """One gain that is off by a factor, while the other and the torque constant are right.

    It acts in the simulated motion, and in the torque that is computed from the log (`of_drives.with_loop_gains`); it
    has no column.
    """

    physics = (
        "Gains are set in the drive's own units, one by one, and a log or a configuration file holds what somebody"
        " believed them to be."
    )
    typical = "±5-50 %"
    place = "torque"
    searched = False
    either_sign = "A gain is off either way."
    amplitudes = (Parameter("gain", "1", "share by which the logged gain is too large", low=-0.8, high=3.0),)
    example: ClassVar[Mapping[str, float]] = {"gain": 0.2}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: a declared gain is in the computed torque, and the motion finds others."""
        return {}
