"""How sensors on links are mounted and where they sit, as the motors' slow motion tells."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import Kind, LinkSensors
from elid_cli.estimation.motor_side.operators import filtered
from elid_cli.model.link_vectors import AXES
from elid_cli.robot.robot import Robot

FAST, SLOW = 10.0, 1.0
"""Frequencies, Hz: below the first the motors' accelerations are told from their noise, and below the second links are
taken to move as their motors do."""
INSTANTS = 400
"""Instants of the slow motion at which accelerometers are looked at."""
ROUNDS, BEGUN = 40, 3
"""Rounds of place and rotation in turn, and after how many only the best start is gone on with."""
UNTOLD = 1e-3
"""Part of a place's effect, of the largest one's, below which the motion does not tell it."""
UNLIKE, UNLIKE_TURN = 0.5, 0.4
"""Part of a sensor's slow changes that those of its link must leave at most: of accelerometers, of gyroscopes."""
MOST_BIAS = 4.0
"""Bias beyond which it is none, in its prior standard deviations: about a vertical axis a wrong unit changes nothing
else."""
STILL = 1e-9
"""Rate of a link, rad/s, below which it does not turn."""
TELLING = 0.2
"""Distance from 1 from which on a ratio of sizes helps to find what is wrong."""
SLIDES = "its link does not turn"
STRANGE_TURN = (
    "it does not turn as its link does: the joint it is mapped to, an axis, a sign, the unit or the clock is wrong"
)
STRANGE = (
    "it does not feel what its link does: the joint it is mapped to, an axis, a sign, the unit, the clock or the "
    "robot's gravity is wrong"
)


class _First(NamedTuple):
    """What slow motion tells of one sensor."""

    turn: Array
    """(3, 3)."""
    place: Array
    """m in the link's frame, (3,)."""
    strange: str
    """Why it cannot be one on that link; empty where it can."""


def mounted(sensors: LinkSensors, robot: Robot, theta: Array, dt: float) -> tuple[LinkSensors, dict[int, str]]:
    """Return sensors of one kind with the rotations and places that the motors' slow motion tells.

    Those that do not move as their links do are left out: the second is why, by their place among the given ones.

    Parameters
    ----------
    sensors
        What was measured.
    robot
        The joints that move.
    theta
        Motors' positions at the joints, (N, n).
    dt
        Sample time, s.
    """
    if not sensors.joints:
        return sensors, {}
    measured, own, field, inner = _slowly(sensors, robot, theta, dt)
    first = []
    for number in range(len(sensors.joints)):
        seen = measured.axes(number)[inner], own[inner, number]
        first.append(_felt(sensors.kind, *seen, field[inner, number]) if sensors.kind.placed else _turned(*seen))
    strange = {number: sensor.strange for number, sensor in enumerate(first) if sensor.strange}
    estimated = replace(
        sensors, mounting=np.array([sensor.turn for sensor in first]),
        places=np.array([sensor.place for sensor in first]),
    )  # fmt: skip
    return estimated.only([number for number in range(len(first)) if number not in strange]), strange


def _slowly(sensors: LinkSensors, robot: Robot, theta: Array, dt: float) -> tuple[LinkSensors, Array, Array, slice]:
    """Return what sensors measure and would in their links' frames if these moved as their motors, both slow.

    The second is (N, m, 3); then how it changes with the place, (N, m, 3, 3) or (N, m, 3, 0), and the samples that no
    end of the filter reaches. What is felt is filtered and not the motion: it follows that one's squares and sines.
    """
    smooth, _ = filtered(theta, dt, FAST)
    rate = np.gradient(smooth, dt, axis=0)
    motion = smooth, rate, np.gradient(rate, dt, axis=0)
    felt = sensors.kind.vectors(robot, sensors.joints).slopes(motion, sensors.places)
    values, reach = filtered(sensors.values, dt, SLOW)
    own, field = (
        filtered(part.reshape(len(theta), -1), dt, SLOW)[0].reshape(part.shape) for part in (felt.values, felt.by_place)
    )
    end = reach if 4 * reach < len(theta) else 2
    return replace(sensors, values=values), own, field, slice(end, len(theta) - end)


def _turned(values: Array, link: Array) -> _First:
    """Return how a gyroscope is turned that measures rates (N, 3) where its link has others."""
    model, rates = (own - own.mean(axis=0) for own in (link, values))
    turn, size, strange = rotation(model, rates), float(np.linalg.norm(model)), ""
    if not size > STILL * len(rates):
        strange = SLIDES
    elif not np.linalg.norm(rates - model @ turn.T) < UNLIKE_TURN * np.linalg.norm(rates):
        strange = STRANGE_TURN + _beside(float(np.linalg.norm(rates)) / size, "turns")
    return _First(turn, np.zeros(AXES), strange)


def _felt(kind: Kind, values: Array, origin: Array, field: Array) -> _First:
    """Return how an accelerometer is turned and where it sits, fitted in turn from every rotation of axes to axes.

    Parameters
    ----------
    kind
        Of accelerometer.
    values
        What was measured, (N, 3).
    origin
        What the origin of the link's frame feels, (N, 3) …
    field
        … and how that changes with the place, (N, 3, 3).
    """
    here = np.linspace(0, len(values) - 1, INSTANTS).astype(int)
    values, origin, field = values[here], origin[here], field[here]
    turn, place, left = _fitted(values, origin, field)
    bias = left.mean(axis=0)
    changes, missed = values - values.mean(axis=0), left - bias  # a small bias is no fault
    strange = ""
    if (
        not np.linalg.norm(missed) < UNLIKE * np.linalg.norm(changes)
        or np.abs(bias).max() > MOST_BIAS * kind.bias_spread
    ):
        weight = float(np.linalg.norm(origin))  # for the greatest part, wherever it sits
        strange = STRANGE + _beside(float(np.linalg.norm(values)) / max(weight, 1e-300), "feels")
    return _First(turn, place, strange)


def _fitted(values: Array, origin: Array, field: Array) -> tuple[Array, Array, Array]:
    """Return rotation, place and what they leave of values (M, 3), m/s²."""
    starts = [_from(start, values, origin, field, BEGUN) for start in _rotations()]
    best = min(starts, key=lambda found: float(np.linalg.norm(found[-1])))
    return _from(best[0], values, origin, field, ROUNDS)


def _from(turn: Array, values: Array, origin: Array, field: Array, rounds: int) -> tuple[Array, Array, Array]:
    for _ in range(rounds):
        rows = (turn @ field).reshape(values.size, AXES)
        place = np.asarray(np.linalg.lstsq(rows, (values - origin @ turn.T).ravel(), rcond=UNTOLD)[0], dtype=np.float64)
        model = origin + field @ place
        turn = rotation(model, values)
    return turn, place, values - model @ turn.T


def _rotations() -> list[Array]:
    """Return the 24 rotations that take axes to axes."""
    found = []
    for order, signs in product(permutations(range(AXES)), product((1.0, -1.0), repeat=AXES)):
        turn = np.eye(AXES)[list(order)] * np.array(signs)
        if np.linalg.det(turn) > 0:
            found.append(turn)
    return found


def rotation(model: Array, measured: Array) -> Array:
    """Return the rotation that takes a model's vectors, (N, 3), nearest to measured ones (Kabsch 1976)."""
    left, _, right = np.linalg.svd(measured.T @ model)
    found: Array = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return found


def _beside(ratio: float, verb: str) -> str:
    """Return how many times as much a sensor measures as its link's motion has, in words, where that tells anything."""
    how = "fast" if verb == "turns" else "much"
    return f"; it {verb} {ratio:.2g} times as {how}" if abs(ratio - 1) > TELLING else ""
