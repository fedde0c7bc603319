"""How gyroscopes on links are mounted, as the motors' slow motion tells (Kabsch 1976)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors, beside, rotation, slowly
from elid_cli.robot.robot import Robot

UNLIKE = 0.4
"""Part of a gyroscope's slow rates that a rotation of its link's must leave at most."""
STILL = 1e-9
"""Rate of a link, rad/s, below which it does not turn."""
SLIDES = "its link does not turn"
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
        turn = rotation(model, rates)
        found.append(turn)
        size = float(np.linalg.norm(model))
        if not size > STILL * len(rates):
            refused[number] = SLIDES
        elif not np.linalg.norm(rates - model @ turn.T) < UNLIKE * np.linalg.norm(rates):
            refused[number] = STRANGE + beside(float(np.linalg.norm(rates)) / size, "turns")
    used = [number for number in range(len(gyros.joints)) if number not in refused]
    return replace(gyros, mounting=np.array(found)).only(used), refused
