"""What is known of the rotors beforehand: the robot file's values, or a share of what the motor moves at low speed."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.climb import Climb
from elid_cli.estimation.motor_side.link_sensors import KINDS
from elid_cli.estimation.motor_side.link_side import LinkSide, reflected
from elid_cli.estimation.motor_side.motor_log import MotorLog, Samples
from elid_cli.estimation.motor_side.rungs import FIRST_RUNG
from elid_cli.estimation.motor_side.unknowns import RotorPrior, Unknowns
from elid_cli.robot.robot import Robot

TOLD = 0.2
"""Standard deviation of a rotor's inertia in a data sheet, share of it."""
GUESSED, LOOSE = 0.35, 1.0
"""Share of all inertia that a rotor of unknown inertia is taken to have, and its standard deviation."""
_RATE = 100.0
_STRONG = 100.0


def rotors_of(robot: Robot, link: LinkSide, samples: Samples) -> tuple[RotorPrior, Array]:
    """Return what is known of the rotors and the inertia that each motor moves as a rigid joint, kg·m², (n,)."""
    total = _moved(link, samples)
    told = reflected(robot)
    known = np.isfinite(told) & (told > 0)
    value = np.where(known, told, GUESSED * total)
    return RotorPrior(value, np.where(known, TOLD, LOOSE) * value), total


def _moved(link: LinkSide, samples: Samples) -> Array:
    """Return link and rotor inertia together of rigid joints, from the lowest frequencies."""
    log = MotorLog(samples, _RATE)
    unknowns = Unknowns(link)
    none = RotorPrior(np.zeros(link.n), np.full(link.n, 1e-12))
    climb = Climb(log, unknowns, none, min(5.0, 0.2 / log.dt))
    climb.with_load = False
    x = np.zeros(unknowns.size)
    x[unknowns["p"]] = 1e-3
    free = unknowns.free("lost", "bumps", "further", "load", "c", "J", *(kind.name for kind in KINDS))
    x, _ = climb.rung(x, 2 * FIRST_RUNG, free, _STRONG)
    mass: Array = np.abs(climb.mass(x))
    return mass
