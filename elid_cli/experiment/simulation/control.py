"""Motor-side PD control with feed-forward (the regulator of Tomei, 1991), gains from the robot's inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, flag, number, optional, several, word
from elid_cli.errors import RobotError, UsageError
from elid_cli.model.dynamics import Dynamics

BANDWIDTH = 25.0
"""Bandwidth, rad/s, asked of joints that are stiff enough for it."""
DAMPING = 0.7
SPRING_SHARE = 0.7
"""Bandwidth as a share of the link's frequency on its spring with the motor held: beyond it a link swings alone."""
SAMPLED_SHARE = 0.4
"""Largest speed correction per controller sample, as a share of the error: above it sampled control rings."""
GRAVITY_MARGIN = 3.0
"""Least proportional gain, in units of the joint's gravity torque per rad."""


_GAINS = optional(several(number(least=0), "gains, one or one per joint"))
_RULES = {"kp": _GAINS, "kd": _GAINS, "feedforward": word("model", "gravity", "none"), "continuous": flag}


@dataclass(frozen=True)
class ControlOptions:
    """How the simulated robot is controlled; gains of None are chosen by `automatic_gains`.

    `feedforward` is what the controller knows of the robot: everything but its effects ("model"), its gravity, or
    nothing. `continuous` evaluates the controller at every instant instead of holding its torque over a sample, so
    that the log's torque has no delay.
    """

    kp: tuple[float, ...] | None = None
    kd: tuple[float, ...] | None = None
    feedforward: Literal["model", "gravity", "none"] = "model"
    continuous: bool = False

    def __post_init__(self) -> None:
        """Refuse words that say nothing, and gains that are none (UsageError)."""
        check_fields(self, _RULES)


@dataclass(frozen=True)
class Gains:
    """Proportional (N·m/rad) and derivative (N·m·s/rad) gains at the joints, shape (n,)."""

    kp: Array
    kd: Array


def automatic_gains(dynamics: Dynamics, positions: Array, period: float) -> Gains:
    """Return gains that hold a robot never seen before.

    Parameters
    ----------
    dynamics
        The robot.
    positions
        Link positions at which inertia and gravity are looked at, shape (N, n).
    period
        The controller's sample time, s.

    """
    robot, elastic = dynamics.robot, dynamics.elastic
    n = robot.n
    link, motor = np.zeros(n), np.zeros(n)
    for q in positions:
        M = dynamics.mass_matrix(q.tolist())
        link = np.maximum(link, np.diag(M)[:n])
        # what one motor feels at once: the others free, its own link left behind
        try:
            felt = 1.0 / np.diag(np.linalg.inv(M))
        except np.linalg.LinAlgError:
            raise RobotError(
                f"{robot.name}: the mass matrix is singular",
                detail="some joint moves nothing: neither the bodies beyond it nor its rotor have a mass",
                hint="give masses and inertias, or Ja of every joint",
            ) from None
        now = np.array([felt[n + elastic.index(k)] if k in elastic else felt[k] for k in range(n)])
        motor = now if not motor.any() else np.minimum(motor, now)
    total = link.copy()
    for place, k in enumerate(elastic):
        total[k] += M[n + place, n + place]
    bandwidth = np.full(n, BANDWIDTH)
    for k in elastic:
        bandwidth[k] = min(BANDWIDTH, SPRING_SHARE * float(np.sqrt(dynamics.stiffness[k] / link[k])))
    gravity = np.abs(dynamics.gravity(positions)).max(axis=0)
    kp = np.maximum(total * bandwidth**2, GRAVITY_MARGIN * gravity)
    limit = SAMPLED_SHARE * motor / period
    kd = np.minimum(2 * DAMPING * np.sqrt(kp * total), limit)
    # the position loop, too, must be slow for the sample time: kp/kd below a tenth of the sample rate
    kp = np.minimum(kp, 0.1 * kd / period)
    return Gains(kp, kd)


def gains_of(options: ControlOptions, dynamics: Dynamics, positions: Array, period: float) -> Gains:
    """Return the gains asked for, or automatic ones where none are.

    Raises
    ------
    UsageError
        A number of gains that is neither 1 nor the number of joints.

    """
    automatic = automatic_gains(dynamics, positions, period)
    kp = automatic.kp if options.kp is None else _per_joint(options.kp, dynamics.robot.n, "kp")
    kd = automatic.kd if options.kd is None else _per_joint(options.kd, dynamics.robot.n, "kd")
    return Gains(kp, kd)


def _per_joint(values: tuple[float, ...], n: int, name: str) -> Array:
    if len(values) not in (1, n):
        raise UsageError(f"{name}: {len(values)} values for {n} joints", hint=f"give one, or {n} in the joints' order")
    return np.broadcast_to(np.asarray(values, dtype=float), (n,)).copy()
