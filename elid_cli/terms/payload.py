"""Payload: the last body changes while the log runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli.motion import random_motion
from elid_cli.robot import LINK_PARAMETERS, Robot
from elid_cli.terms.bodies import last_body
from elid_cli.terms.effect import Alteration, Columns, Effect, Parameter, RowKey, Scene

Array = NDArray[np.float64]

TOLERANCE = 1e-8
"""Share of a column that has to be new for it to count as independent of those before it."""
_UNITS = ("kg", *["kg·m"] * 3, *["kg·m²"] * 6)


class Payload(Effect):
    """Ten inertial parameters added to the last body from one instant on.

    A chain cannot tell all ten apart. As in the base parameters, the leftmost independent ones carry those that
    depend on them; the others have columns of zeros and are not named.
    """

    name = "payload"
    summary = "mass gripped (or dropped) during the log"
    equation = "link rows: (last body's columns) · change, for t ≥ start"
    physics = (
        "A gripper closes on a part. A payload that is there from the first instant to the last is part of the last"
        " body and cannot be seen in the log."
    )
    typical = "a tenth to the whole of the rated payload"
    fingerprint = "sum rows of all joints from one instant on, in the pattern of the last body's gravity and inertia"
    record = "the same motion before and after the change"
    place = "chain"
    whole_robot = True
    amplitudes = tuple(
        Parameter(name, unit, f"change of the last body's {name}")
        for name, unit in zip(LINK_PARAMETERS, _UNITS, strict=True)
    )
    shapes = (Parameter("start", "s", "instant of the change", low=0.0),)
    twins = ()
    local = True
    simulated = "robot"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return instants spread over the log, away from its ends."""
        first = float(scene.motion.t[0]) if scene.samples else 0.0
        length = min(scene.duration, float(np.ptp(scene.motion.t))) if scene.samples else 0.0
        return [(first + length * share,) for share in np.linspace(0.1, 0.9, 17)] if length > 0 else []

    def columns(self, scene: Scene) -> Columns:
        """Return the last body's independent columns in the link rows from the start on, zeros for the others."""
        key = ("last body",)
        if key not in scene.cache:
            scene.cache[key] = last_body(scene.robot, scene.motion) * independent(scene.robot)[:, None]
        after = scene.motion.t >= self.shape[0]
        return {RowKey("link", j): rows * after for j, rows in enumerate(scene.cache[key])}

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the changes that can be told apart, and the start."""
        kept = independent(scene.robot)
        values = {
            name: float(c) for name, c, keep in zip(LINK_PARAMETERS, coefficients, kept, strict=True) if keep or c != 0
        }
        return {**values, "start": self.shape[0]}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`; changes that are not given are 0."""
        return np.array([float(values.get(name, 0.0)) for name in LINK_PARAMETERS]), (float(values["start"]),)

    def altered(self, robot: Robot, parameters: Array, coefficients: Array) -> Alteration:
        """Return the parameters with the payload."""
        names = robot.parameter_names()
        changed = np.array(parameters, dtype=float)
        for name, change in zip(LINK_PARAMETERS, coefficients, strict=True):
            changed[names.index(f"{name}{robot.n}")] += change
        return Alteration(self.shape[0], robot, changed)


def independent(robot: Robot) -> Array:
    """Return 1 for the last body's parameters that no earlier one of them can stand for, else 0, shape (10,)."""
    motion = random_motion(robot.n, robot.elastic, samples=24)
    columns = last_body(robot, motion).transpose(1, 0, 2).reshape(len(LINK_PARAMETERS), -1)
    basis: list[Array] = []
    kept = np.zeros(len(LINK_PARAMETERS))
    for k, column in enumerate(columns):
        rest = column.copy()
        for _ in range(2):  # the second pass takes away what rounding left
            for direction in basis:
                rest -= direction * float(direction @ rest)
        size = float(np.linalg.norm(rest))
        if size > TOLERANCE * max(float(np.linalg.norm(column)), 1e-12):
            kept[k] = 1.0
            basis.append(rest / size)
    return kept
