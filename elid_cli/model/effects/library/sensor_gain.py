"""Gain of a joint torque sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class SensorGain(Effect):
    """A joint torque sensor whose scale is off.

    Where the sensor's reading stands on the right-hand side (link row: bodies = reading; motor row: motor torque
    minus reading), the error is a share of the transmitted torque, with opposite signs in the two rows.
    """

    name = "sensor_gain"
    summary = "joint torque sensor off by a factor"
    equation = "link equation: +gain load, motor equation: the same with -;  reading = (1 + gain) load"
    physics = "Strain gauges are calibrated without the flange's preload; bridges and amplifiers are not exact."
    typical = "±1-5 %"
    fingerprint = "sensor against motor torque and against deflection: a share of the load; nothing in the whole joint"
    record = "large loads of both signs, with motor torque and sensor logged together"
    place = "sensor"
    either_sign = "A sensor reads too much or too little."
    elastic_only = True
    amplitudes = (Parameter("gain", "1", "share by which the sensor reads too much", low=-0.6, high=1.5),)
    nuisance = "reading gain"
    example = {"gain": 0.04}
    simulated = "log"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the one shape where this joint has a sensor."""
        return [()] if has_sensor(scene, joint) else []

    def columns(self, scene: Scene) -> Columns:
        """Return the transmitted torque in both rows of the transmission."""
        j = self.joint
        stiffness = float(scene.stiffness[j])
        # from the deflection where possible: the sensor's own reading would explain itself
        load = -stiffness * scene.deflection(j) if stiffness > 0 else scene.load[:, j]
        return spring_rows(j, load)

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the sensor's reading as logged."""
        return self._in_channels(signals, ("tau_link",), lambda reading: reading * (1.0 + values["gain"]))


def has_sensor(scene: Scene, joint: int) -> bool:
    """Whether a joint's transmitted torque is measured."""
    return scene.tau_link is not None and bool(np.any(np.isfinite(scene.tau_link[:, joint])))
