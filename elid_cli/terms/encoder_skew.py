"""Encoder skew: link and motor encoders read at different instants."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli.terms.effect import Columns, Effect, Parameter, Scene
from elid_cli.terms.rows import spring_rows
from elid_cli.terms.shifted import shifted

Array = NDArray[np.float64]


class EncoderSkew(Effect):
    """A time shift of one joint's link encoder against every other channel.

    To first order the true link angle is q + skew q', which changes the spring's torque by K skew q'. The column holds
    that; what the bodies need changes too, and is put right by moving the channel in time once the skew is known.
    """

    name = "encoder_skew"
    summary = "link encoder sampled at another instant than the motor encoder"
    equation = "link row: +K skew q', motor row: the same with -; the link's channels moved by the skew"
    physics = "Two encoders on two buses, or one with a filter: the difference of their readings follows the speed."
    typical = "a tenth of a sample to 5 ms"
    fingerprint = "motor row high with the sum row low, along the link's velocity, not its deflection"
    record = "fast, lightly loaded motion next to slow, loaded motion"
    place = "encoder"
    elastic_only = True
    amplitudes = (
        Parameter("skew", "s", "age of the link encoder's reading beyond the motor encoder's", low=-0.1, high=0.1),
    )
    twins = ()
    simulated = "log"

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the skew: the coefficient is K times it."""
        return {"skew": float(coefficients[0]) / float(scene.stiffness[self.joint])}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`."""
        return np.array([values["skew"] * float(scene.stiffness[joint])]), ()

    def columns(self, scene: Scene) -> Columns:
        """Return the link's velocity in both rows of the transmission."""
        return spring_rows(self.joint, scene.motion.dq[:, self.joint])

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the link's channels as logged: each reading is `skew` old."""
        changed = {name: np.array(signals[name]) for name in ("q", "dq") if name in signals}
        for channel in changed.values():
            channel[:, self.joint] = shifted(channel[:, self.joint], -values["skew"] / dt)
        return changed
