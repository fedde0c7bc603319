"""The scale of a torque, told by the weight of the bodies that the robot's file describes.

A torque at the motor's shaft is smaller than the one at the joint by the gear ratio, and a model of it fits as well:
only something of known size shows it, as the masses of a URDF do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.logs.checks.encoder_pairs import as_yaml, proposed, turned_round
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.torque_scale import LAG, SURE, WRONG_SCALE, Slope, slopes_beside
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.model.body_torques import gravity_torques
from elid_cli.robot.robot import Robot

INSTANTS = 400
"""Instants of a log that are looked at."""
FEWEST = 60
"""Instants that are enough."""
FAINT = 0.3
"""Correlation of torque and weight below which a torque does not hold the weight at all."""
OWN = 0.2
"""Least part of a weight's spread that the joint's speed and the chain's accelerations must leave."""
NOTHING = 0.05
"""Part of the largest weight below which a joint's own says nothing: fingers, wrists that turn about their centre."""
FOLLOWS = 0.8
"""Correlation of torque and weight from which a torque is too large for it; else it may be anything, inertia too."""
TURNED = 1.6
"""Times its weight that a torque of a turned sign pulls at most: more is what fast motion makes of it, but where it
follows the weight."""
ALIKE = 0.05
"""Relative difference of joints' scales that counts as none."""
UNITS = {1000.0: "unit: mN.m"}
"""Scales that a unit explains."""
BESIDE_WEIGHT = "times what carries the weight"
"""What is said of a torque of another size than the described bodies' weight."""
AGAINST = "runs against the weight"
"""What is said of a torque that pulls where the described bodies' weight pulls."""
WEIGHTLESS = "does not follow the weight"
"""What is said of a torque that does not follow the weight of the described bodies at all."""


class Scale(NamedTuple):
    """A torque over the weight that it carries, and the standard error of that."""

    joint: int
    ratio: float
    deviation: float
    correlation: float
    """Of both, beside what the joint's speed and its chain's accelerations explain."""

    @classmethod
    def of(cls, joint: int, slope: Slope) -> Scale:
        """Return the slope of a joint's torque."""
        return cls(joint, slope.ratio, slope.deviation, slope.correlation)


@dataclass(frozen=True)
class Weighed:
    """Torques of a log beside the weight of the bodies that the robot's file describes."""

    q: Array
    """Positions at the joint, contiguous, (N, n)."""
    tau: Array
    """Torques at the joint, (N, n)."""
    dt: float
    """Sample time, s."""
    robot: Robot
    """The description; joints whose load is unknown are not looked at."""

    @cached_property
    def scales(self) -> list[Scale]:
        """How many times the weight each joint's torque holds, where that shows (`weight_scales`)."""
        (found,) = weight_scales(self.q, self.tau, self.dt, self.robot, np.ones((1, self.robot.n)))
        return found


def wrong_scales(log: Weighed, plan: ReadPlan, *, signal: str = "tau", computed: bool = False) -> Iterator[str]:
    """Yield a sentence where the torques are not of the size that the described bodies' weight makes them.

    Parameters
    ----------
    log
        Positions, torques and description.
    plan
        Where the torque was read from.
    signal
        ``tau``, or ``tau_link`` where that is the only torque.
    computed
        Whether the torque is computed from commands and gains.
    """
    scales, robot = log.scales, log.robot
    names = robot.joint_names
    idle = [s for s in scales if s.correlation < FAINT and abs(s.ratio) + SURE * s.deviation < 1 / WRONG_SCALE]
    if idle:
        yield (
            f"{signal} of {in_words([names[s.joint] for s in idle])} {WEIGHTLESS} of the described bodies: gravity was "
            f"taken out of it, something else carries them, or {WRONG}, or the masses or the gravity of {robot.name}"
        )
    opposed = [
        s for s in scales
        if s.correlation < -FAINT and s.ratio + SURE * s.deviation < -1 / WRONG_SCALE
        and (s.ratio > -TURNED or s.correlation < -FOLLOWS)
    ]  # fmt: skip
    if opposed:
        against = [names[s.joint] for s in opposed]
        turning = names if len(opposed) == len(scales) > 1 else against
        which = "a sign of the commands is" if computed else "a sign is"
        yield (
            f"{signal} of {in_words(against)} {AGAINST} of the described bodies: {which} "
            f"wrong, or the gravity of {robot.name} (a robot that hangs says gravity: [0, 0, 9.81]); "
            f"{turned_round(plan, signal, turning, names, computed=computed)}"
        )
    off = [s for s in scales if s.correlation > FAINT and _is_off(s)]
    if not off:
        return
    sizes = in_words([f"{s.ratio:.2g}" for s in off])
    said = (
        f"{signal} of {in_words([names[s.joint] for s in off])} is {sizes} {BESIDE_WEIGHT} of the "
        f"described bodies: {WRONG}, or the masses of {robot.name}"
    )
    if all(s.ratio > 1 for s in off):
        said += ", or the positions, which may be too small"
    if computed:
        yield f"{said}; the torque is computed, so the gains kp and kd may be of the motor's side"
        return
    placement = plan.placements.get(signal)
    newtons = placement is None or placement.spec.unit in ("", "N.m", "N")
    if signal == "tau" and newtons and all(s.ratio < 1 for s in off):
        ratios = in_words([about(1 / s.ratio) for s in off])
        said += f"; a torque at the motor's shaft would mean gear ratios of about {ratios}"
    yield f"{said}; {proposed(plan, signal, _key(off, robot, plan, signal))}"


def _is_off(scale: Scale) -> bool:
    """Whether a scale is surely further from 1 than wrong masses explain."""
    low, high = scale.ratio - SURE * scale.deviation, scale.ratio + SURE * scale.deviation
    return (low > WRONG_SCALE and scale.correlation > FOLLOWS) or high < 1 / WRONG_SCALE


def about(size: float) -> str:
    """Return a size with two digits, without an exponent where it needs none."""
    return f"{float(f'{size:.2g}'):g}"


def _key(off: Sequence[Scale], robot: Robot, plan: ReadPlan, signal: str) -> str:
    """Return the keys of a mapping that makes up for the scales; joints that the log does not judge stay open."""
    ratio = float(np.median([s.ratio for s in off]))
    alike = all(abs(s.ratio / ratio - 1) < ALIKE + s.deviation / ratio for s in off)
    placement = plan.placements.get(signal)
    before = np.broadcast_to(placement.spec.scale, robot.n).tolist() if placement is not None else [1.0] * robot.n
    kept = [f"unit: {as_yaml(placement.spec.unit)}"] if placement is not None and placement.spec.unit else []
    kept += ["side: motor"] if placement is not None and placement.spec.motor_side else []
    geared = [(robot.joints[s.joint].gear_ratio or 1.0) * s.ratio for s in off]
    if not kept and all(abs(product - 1) < WRONG_SCALE / 10 for product in geared):
        return ", ".join([*kept, "side: motor"])
    unit = next((key for factor, key in UNITS.items() if alike and abs(ratio / factor - 1) < WRONG_SCALE / 10), "")
    if unit and not kept and set(before) == {1.0}:
        return unit
    if alike and len(set(before)) == 1:
        return ", ".join([*kept, f"scale: {about(before[0] / ratio)}"])
    found = {s.joint: about(before[s.joint] / s.ratio) for s in off}
    sizes = (f"{name}: {found.get(k, 'RATIO')}" for k, name in enumerate(robot.joint_names))
    return ", ".join([*kept, f"scale: {{{', '.join(sizes)}}}"])


@lru_cache(maxsize=16)
def evenly(first: int, last: int, count: int) -> NDArray[np.intp]:
    """Return up to `count` numbers of samples, evenly taken from `first` to `last`."""
    at = np.unique(np.linspace(first, last, count).astype(np.intp))
    at.setflags(write=False)
    return at


def weight_scales(q: Array, tau: Array, dt: float, robot: Robot, factors: Array) -> list[list[Scale]]:
    """Return how many times the weight of what it carries each joint's torque holds, where that shows.

    The torque is fitted by the weight beside an offset, the joint's friction and the accelerations of its chain.

    Parameters
    ----------
    q, tau
        Positions and torques at the joint, contiguous, (N, n).
    dt
        Sample time, s.
    robot
        The description.
    factors
        What to multiply the positions by, (F, n), each in turn: there is one list for each.
    """
    found: list[list[Scale]] = [[] for _ in factors]
    lag = max(1, round(LAG / dt))
    if len(q) < 2 * lag + FEWEST or not any(robot.gravity):
        return found
    at = evenly(lag, len(q) - 1 - lag, INSTANTS)
    here, ahead, behind, torque = q[at], q[at + lag], q[at - lag], tau[at]
    speed, bend = ahead - behind, ahead - 2.0 * here + behind
    smooth = bool(np.isfinite(bend).all())
    weight = gravity_torques(robot, (factors[:, None] * here).reshape(-1, robot.n)).reshape(len(factors), *here.shape)
    least = NOTHING * np.nanmax(np.abs(weight), axis=(1, 2), initial=0.0)
    for j in range(robot.n):
        used = np.isfinite(torque[:, j]) & np.isfinite(speed[:, j]) & np.isfinite(weight[:, :, j]).all(axis=0)
        if np.count_nonzero(used) < FEWEST:
            continue
        own_weight = weight[:, used, j]
        shown = np.flatnonzero(np.ptp(own_weight, axis=1) > least)
        if not shown.size:
            continue
        chain = [k for k in range(robot.n) if k in robot.ancestors[j] or j in robot.ancestors[k]]
        bends = bend[:, chain] if smooth else np.nan_to_num(bend[:, chain])
        own = np.column_stack([speed[:, j], np.sign(speed[:, j]), bends, np.ones(at.size)])
        slopes = slopes_beside(own[used], own_weight[shown].T, torque[used, j], OWN)
        for k, slope in zip(shown.tolist(), slopes, strict=True):
            if math.isfinite(slope.ratio):
                found[k].append(Scale.of(j, slope))
    return found
