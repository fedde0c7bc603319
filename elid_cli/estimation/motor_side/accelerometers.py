"""How accelerometers on links are mounted and where they sit, as the motors' slow motion tells."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors, beside, rotation, slowly
from elid_cli.model.link_vectors import AXES
from elid_cli.robot.robot import Robot

INSTANTS = 400
"""Instants of the slow motion that are looked at."""
ROUNDS, BEGUN = 40, 3
"""Rounds of place and rotation in turn, and after how many only the best start is gone on with."""
UNTOLD = 1e-3
"""Part of a place's effect, of the largest one's, below which the motion does not tell it."""
MOST_BIAS = 4.0
"""Bias beyond which it is none, in its prior standard deviations: about a vertical axis a wrong unit changes nothing
else."""
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
        bias = left.mean(axis=0)
        changes, missed = own - own.mean(axis=0), left - bias  # a small bias is no fault
        unlike = not np.linalg.norm(missed) < UNLIKE * np.linalg.norm(changes)
        if unlike or np.abs(bias).max() > MOST_BIAS * sensors.kind.bias_spread:
            weight = float(np.linalg.norm(felt[here, number]))  # for the greatest part, wherever it sits
            refused[number] = STRANGE + beside(float(np.linalg.norm(own)) / max(weight, 1e-300), "feels")
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
