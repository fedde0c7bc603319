"""Hysteresis of the transmission: friction inside the spring."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.kinds import MemoryEffect
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import Scene


class Hysteresis(MemoryEffect):
    """A Dahl element parallel to the spring.

    Its state z follows dz/de = (1 - z sign(de)) / distance for the deflection e = q - θ. Along a stretch in one
    direction that is an exponential approach to ±1, exact for any step.
    """

    name = "hysteresis"
    summary = "loop in torque against deflection (friction inside the gear)"
    equation = "link equation: +torque z, motor equation: -torque z;  dz/d(q - θ) = (1 - z sign(q' - θ')) / distance"
    physics = (
        "Teeth, flexspline and bearings slip a little under load and hold part of the torque when it reverses (Dahl)."
    )
    typical = "torque 2-10 % of the rated torque, distance 0.1-3 mrad"
    fingerprint = "motor side only, a loop over the deflection that does not widen with speed"
    record = "slow load reversals of several sizes; fast ones too, since damping grows with speed and this does not"
    place = "spring"
    elastic_only = True
    amplitudes = (Parameter("torque", "N·m", "half the height of the loop", low=0.0),)
    shapes = (
        Parameter("distance", "rad", "deflection after a reversal in which 63 % of the loop is crossed", low=1e-8),
    )
    example = {"torque": 6.0, "distance": 0.001}

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return distances as shares of the deflections in this log."""
        top = float(np.quantile(np.abs(scene.deflection(joint)), 0.98))
        return [(top * share,) for share in (0.01, 0.03, 0.1, 0.3)] if top > 0 else []

    def drive(self, scene: Scene) -> Array:
        """Return the deflection q - θ, shape (N,)."""
        return scene.deflection(self.joint)

    def advance(self, state: float, previous: float, now: float) -> float:
        """Return the state after the deflection moved from `previous` to `now`."""
        step = now - previous
        limit = math.copysign(1.0, step)
        return limit + (state - limit) * math.exp(-abs(step) / self.shape[0])

    def history(self, scene: Scene) -> Array:
        """Return the state at every instant, shape (N,): `advance` with its exponentials taken at once."""
        step = np.diff(self.drive(scene), prepend=0.0)
        keep = np.exp(-np.abs(step) / self.shape[0])
        gain = np.copysign(1.0 - keep, step)
        starts = [k for k in {0, *scene.starts} if k < len(step)]
        keep[starts] = gain[starts] = 0.0  # every segment starts from 0
        states = np.empty(len(step))
        state = 0.0
        for k, (a, b) in enumerate(zip(keep.tolist(), gain.tolist(), strict=True)):
            state = a * state + b
            states[k] = state
        return states

    def columns_of(self, scene: Scene, state: Array) -> Columns:
        """Return the column of the loop in both rows of the transmission."""
        return spring_rows(self.joint, state)
