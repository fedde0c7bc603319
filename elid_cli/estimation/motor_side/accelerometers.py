"""How accelerometers on links are mounted and where they sit, as the motors' slow motion tells."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors, slowly
from elid_cli.model.link_vectors import AXES
from elid_cli.robot.robot import Robot

INSTANTS = 400
"""Instants of the slow motion that are looked at."""
ROUNDS, BEGUN = 40, 3
"""Rounds of place and rotation in turn, and after how many only the best start is gone on with."""
UNTOLD = 1e-3
"""Part of a place's effect, of the largest one's, below which the motion does not tell it."""
UNLIKE = 0.5
"""Part of an accelerometer's slow changes that those of its link must leave at most."""
STRANGE = (
    "it does not feel what its link does: the joint it is mapped to, an axis, a sign, the unit, the clock or the "
    "robot's gravity is wrong"
)


def mounted(sensors: LinkSensors, robot: Robot, theta: Array, dt: float) -> tuple[LinkSensors, dict[int, str]]:
    """Return accelerometers with the rotations and places that the motors' slow motion tells.

    Rotation (Kabsch 1976) and place are fitted in turn from every rotation of the axes onto each other. Those that do
    not feel what their links do are left out: the second is why, by their place among the given ones.

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
    measured, felt, field, inner = slowly(sensors, robot, theta, dt)
    here = np.linspace(inner.start, inner.stop - 1, INSTANTS).astype(int)
    turns, places, refused = [], [], {}
    for number in range(len(sensors.joints)):
        own = measured.axes(number)[here]
        turn, place, left = _fitted(own, felt[here, number], field[here, number])
        turns.append(turn)
        places.append(place)
        changes, missed = (values - values.mean(axis=0) for values in (own, left))  # a bias is no fault
        if not np.linalg.norm(missed) < UNLIKE * np.linalg.norm(changes):
            weight = float(np.linalg.norm(felt[here, number]))  # for the greatest part, wherever it sits
            ratio = float(np.linalg.norm(own)) / max(weight, 1e-300)
            refused[number] = f"{STRANGE}; it feels {ratio:.2g} times as much"
    used = [number for number in range(len(sensors.joints)) if number not in refused]
    return replace(sensors, mounting=np.array(turns), places=np.array(places)).only(used), refused


def _fitted(values: Array, origin: Array, field: Array) -> tuple[Array, Array, Array]:
    """Return rotation, place and what they leave of values (M, 3), m/s².

    Parameters
    ----------
    values
        What was measured.
    origin
        What the origin of the link's frame feels, (M, 3) …
    field
        … and how that changes with the place, (M, 3, 3).
    """
    starts = [_from(start, values, origin, field, BEGUN) for start in _rotations()]
    best = min(starts, key=lambda found: float(np.linalg.norm(found[-1])))
    return _from(best[0], values, origin, field, ROUNDS)


def _from(turn: Array, values: Array, origin: Array, field: Array, rounds: int) -> tuple[Array, Array, Array]:
    for _ in range(rounds):
        rows = (turn @ field).reshape(values.size, AXES)
        place = np.asarray(np.linalg.lstsq(rows, (values - origin @ turn.T).ravel(), rcond=UNTOLD)[0], dtype=np.float64)
        model = origin + field @ place
        left, _, right = np.linalg.svd(values.T @ model)
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return turn, place, values - model @ turn.T


def _rotations() -> list[Array]:
    """Return the 24 rotations that take axes to axes."""
    found = []
    for order, signs in product(permutations(range(AXES)), product((1.0, -1.0), repeat=AXES)):
        turn = np.eye(AXES)[list(order)] * np.array(signs)
        if np.linalg.det(turn) > 0:
            found.append(turn)
    return found
