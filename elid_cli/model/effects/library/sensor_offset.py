"""Offset of a joint torque sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.library.sensor_gain import has_sensor
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class SensorOffset(Effect):
    """A joint torque sensor that reads a constant too much."""

    name = "sensor_offset"
    summary = "joint torque sensor off by a constant"
    equation = "link equation: +offset, motor equation: the same with -;  reading = load + offset"
    physics = "Bridges drift with temperature and mounting stress, and are zeroed under a load that was not zero."
    typical = "0.5-3 % of the sensor's range"
    fingerprint = "sensor against motor torque and against deflection: a constant; nothing in the whole joint"
    record = "poses with load torques of both signs, warm and cold"
    place = "sensor"
    either_sign = "A zero is off either way."
    elastic_only = True
    amplitudes = (Parameter("offset", "N·m", "what the sensor reads too much"),)
    nuisance = "reading offset"
    example = {"offset": 1.5}
    simulated = "log"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the one shape where this joint has a sensor."""
        return [()] if has_sensor(scene, joint) else []

    def columns(self, scene: Scene) -> Columns:
        """Return the constant in both rows of the transmission."""
        return spring_rows(self.joint, np.ones(scene.samples))

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the sensor's reading as logged."""
        return self._in_channels(signals, ("tau_link",), lambda reading: reading + values["offset"])
