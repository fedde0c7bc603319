"""Lookup: a smooth curve over one variable, for structure that no named effect explains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.kinds import CurveEffect, CurveRows
from elid_cli.model.effects.rows import link_row, motor_row, spring_rows
from elid_cli.model.effects.scene import Scene

ROWS: tuple[CurveRows, ...] = ("motor", "link", "transmission")
CURVES = 16
"""Cubic B-splines that make up a curve."""


class Lookup(CurveEffect):
    """A cubic spline with 16 degrees of freedom over one variable; held constant beyond its range."""

    name = "lookup"
    variables = ("velocity", "deflection", "angle", "load", "time")
    summary = "smooth curve over one variable, where no named effect fits"
    equation = "torque = Σ c_k B_k(variable), B_k uniform cubic B-splines between low and high"
    physics = "No physical cause: the curve describes what is left, for this robot and within this range."
    typical = "whatever is left"
    fingerprint = "a residual that follows one variable"
    record = "more of the variable's range, then look for the cause"
    place = "motor"
    either_sign = "A curve that describes what is left."
    amplitudes = tuple(
        Parameter(f"c{k}", "N·m", f"height of the curve's part {k} of {CURVES}") for k in range(1, CURVES + 1)
    )
    shapes = (
        Parameter("variable", "1", "1 velocity, 2 deflection, 3 angle, 4 load, 5 time", low=1, high=5, fixed=True),
        Parameter("rows", "1", "1 motor side, 2 link side, 3 transmission (both)", low=1, high=3, fixed=True),
        Parameter("low", "unit of the variable", "start of the range", fixed=True),
        Parameter("high", "unit of the variable", "end of the range", fixed=True),
    )
    example = {"variable": 1.0, "rows": 1.0, "low": -2.0, "high": 2.0} | {
        f"c{k}": 0.3 * k - 0.02 * k**2 for k in range(1, CURVES + 1)
    }

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return nothing: a curve is asked for (`over`), never found."""
        return []

    @classmethod
    def over(cls, scene: Scene, joint: int, variable: str, rows: CurveRows) -> Lookup | None:
        """Return the curve over the range that a variable covers in this log (without its outermost 1 %)."""
        values = variable_of(scene, joint, variable, rows)
        low, high = (float(x) for x in np.quantile(values, (0.01, 0.99)))
        return cls(joint, (cls.variables.index(variable) + 1, ROWS.index(rows) + 1, low, high)) if low < high else None

    @classmethod
    def words(cls, values: Mapping[str, float]) -> str:
        """Return what a curve runs over and where it acts: ``velocity on the motor side``."""
        variable, rows = cls.variables[int(values["variable"]) - 1], ROWS[int(values["rows"]) - 1]
        return f"{variable} {'in the transmission' if rows == 'transmission' else f'on the {rows} side'}"

    @property
    def variable(self) -> str:
        """What the curve runs over."""
        return self.variables[int(self.shape[0]) - 1]

    @property
    def rows(self) -> CurveRows:
        """Where it acts."""
        return ROWS[int(self.shape[1]) - 1]

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the range is not empty."""
        return super().plausible(scene, joint, values) and values["low"] < values["high"]

    def columns(self, scene: Scene) -> Columns:
        """Return the B-splines at every instant in the curve's rows."""
        low, high = self.shape[2:]
        place = (variable_of(scene, self.joint, self.variable, self.rows) - low) / (high - low)
        basis = b_splines(place, CURVES)
        if self.rows == "motor":
            return motor_row(self.joint, *basis)
        return link_row(self.joint, *basis) if self.rows == "link" else spring_rows(self.joint, *basis)


def variable_of(scene: Scene, joint: int, variable: str, rows: CurveRows) -> Array:
    """Return the variable at every instant, shape (N,): the link's own state for link rows, else the motor's."""
    motion, link = scene.motion, rows == "link"
    if variable == "velocity":
        return (motion.dq if link else motion.dtheta)[:, joint]
    if variable == "angle":
        return (motion.q if link else motion.theta)[:, joint]
    if variable == "deflection":
        return scene.deflection(joint)
    return scene.load[:, joint] if variable == "load" else motion.t


def b_splines(place: Array, count: int) -> Array:
    """Return `count` uniform cubic B-splines on [0, 1] at places (N,), held beyond; they add up to 1, (count, N)."""
    pieces = count - 3
    x = np.clip(place, 0.0, 1.0) * pieces
    piece = np.minimum(x.astype(int), pieces - 1)
    u = x - piece
    parts = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    basis = np.zeros((count, len(x)))
    index = np.arange(len(x))
    for k, part in enumerate(parts):
        basis[piece + k, index] = part / 6
    return basis
