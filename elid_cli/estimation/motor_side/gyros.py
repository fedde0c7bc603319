"""How gyroscopes on links are mounted, as the motors' slow motion tells (Kabsch 1976)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors, slowly
from elid_cli.robot.robot import Robot

UNLIKE = 0.4
"""Part of a gyroscope's slow rates that a rotation of its link's must leave at most."""
STRANGE = (
    "it does not turn as its link does: the joint it is mapped to, an axis, a sign, the unit or the clock is wrong"
)


def mounted(gyros: LinkSensors, robot: Robot, theta: Array, dt: float) -> tuple[LinkSensors, dict[int, str]]:
    """Return gyroscopes with the rotations that the motors' slow motion tells (Kabsch 1976, Acta Cryst. A32).

    Those that do not turn as their links do are left out: the second is why, by their place among the given ones.

    Parameters
    ----------
    gyros
        What was measured.
    robot
        The joints that move.
    theta
        Motors' positions at the joints, (N, n).
    dt
        Sample time, s.
    """
    if not gyros.joints:
        return gyros, {}
    measured, turning, _, inner = slowly(gyros, robot, theta, dt)
    found, refused = [], {}
    for number in range(len(gyros.joints)):
        pair = turning[inner, number], measured.axes(number)[inner]
        model, rates = (values - values.mean(axis=0) for values in pair)
        left, _, right = np.linalg.svd(rates.T @ model)
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        found.append(turn)
        if not np.linalg.norm(rates - model @ turn.T) < UNLIKE * np.linalg.norm(rates):
            ratio = float(np.linalg.norm(rates) / max(float(np.linalg.norm(model)), 1e-300))
            refused[number] = f"{STRANGE}; it turns {ratio:.2g} times as fast"
    used = [number for number in range(len(gyros.joints)) if number not in refused]
    return replace(gyros, mounting=np.array(found)).only(used), refused
