"""Torques beside the deflection of the joints' springs: their sign, side and scale, and where theta's zero is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.checks.encoder_pairs import CLOSE, UNLIKE, Mends, Pair, proposed, turned_round
from elid_cli.logs.checks.torque_scale import (
    FOLLOWS,
    RELATED,
    WRONG_SCALE,
    Slope,
    correlation_of,
    is_spring,
    off,
    scale_of,
    spring_slope,
)
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

EXACTLY = 1e-3
"""Share of tau that is not proportional to the deflection below which tau is no motor torque."""
SOFTEST = 0.5
"""Slope of theta over q below which, and over whose inverse, no spring is looked for."""


@dataclass(frozen=True)
class Sprung:
    """Positions on both sides of the springs, and torques, evenly taken from a log, (N, n) each."""

    q: Array
    """rad or m, as the next."""
    theta: Array
    tau: Array
    """N·m or N, as the next."""
    sensed: Array | None
    """Torque in the transmission, `tau_link`."""
    inner: slice
    """Samples between which there is no gap."""
    dt: float
    """Time between the samples, s."""
    computed: NDArray[np.bool_]
    """Joints whose torque is computed from commands, (n,)."""

    def slope(self, pair: Pair, robot: Robot) -> Slope:
        """Return the slope of a joint's torque over its deflection, which shows where it may be elastic."""
        theta, q = self.theta[self.inner, pair.j], self.q[self.inner, pair.j]
        if not (robot.joints[pair.j].elastic and SOFTEST < pair.slope < 1 / SOFTEST):
            return Slope()
        return spring_slope(theta, theta - q, self.tau[self.inner, pair.j], self.dt)

    def bent(self, j: int, own: Slope, stiffness: float) -> float:
        """Return what the mean load bends a joint's spring by, rad or m; NaN where that is not known.

        `own` is what `slope` says, `stiffness` that of the robot file, N·m/rad (N/m), 0 where it has none.
        """
        sensed = self.sensed[:, j] if self.sensed is not None else np.full(1, np.nan)
        if np.isfinite(sensed).all():
            deflection = self.theta[:, j] - self.q[:, j]
            follows = correlation_of(deflection, sensed)
            if follows > FOLLOWS:
                return float(sensed.mean() * follows * deflection.std() / sensed.std())
        load = sensed if np.isfinite(sensed).any() else self.tau[:, j]
        if not np.isfinite(load).any():
            return math.nan
        if not stiffness > 0 and own.correlation > RELATED and own.ratio > 0:
            stiffness = own.ratio
        return float(np.nanmean(load)) / stiffness if stiffness > 0 else math.nan


def spring_suspicions(log: Sprung, pairs: Sequence[Pair], robot: Robot, plan: ReadPlan) -> list[str]:
    """Return one sentence per suspicion that positions and torques of joints with both sides raise."""
    found: list[str] = []
    deflection = log.theta - log.q
    if len(pairs) > 1:
        found.extend(_swapped_torques(deflection, log.tau, list(pairs), robot))
    slopes = [log.slope(pair, robot) for pair in pairs]
    stiffness = [robot.joints[pair.j].parameters.get("K", 0.0) for pair in pairs]
    bent = [log.bent(pair.j, own, k) for pair, own, k in zip(pairs, slopes, stiffness, strict=True)]
    mends = Mends.of(list(zip(pairs, bent, strict=True)), plan, robot.joint_names)
    springs = [p for p in pairs if abs(p.slope - 1) < CLOSE and robot.joints[p.j].elastic]
    follow = {p.name: correlation_of(deflection[:, p.j], log.tau[:, p.j]) for p in springs}
    opposed = [name for name, share in follow.items() if share < -RELATED]  # with one that is sure, likely ones too
    if len(opposed) > 1 and not any(share > RELATED for share in follow.values()):
        opposed = list(robot.joint_names)
    scales: dict[int, float] = {}
    for pair, own, k, far in zip(pairs, slopes, stiffness, bent, strict=True):
        apart, tau = deflection[:, pair.j], log.tau[:, pair.j]
        found.extend(pair.sentences(plan, far, sprung=is_spring(apart, tau, own, k), mends=mends))
        if pair in springs:
            told = bool(log.computed[pair.j])
            found.extend(_directions(pair, apart, tau, plan, opposed, robot.joint_names, computed=told))
            scales[pair.j] = scale_of(apart, tau, own, robot.joints[pair.j].parameters.get("K"))
    right = any(abs(math.log(scale)) <= math.log(WRONG_SCALE) for scale in scales.values() if scale > 0)
    for pair in pairs:
        if not log.computed[pair.j]:
            found.extend(_scale(pair, scales.get(pair.j, math.nan), robot, plan, alone=right))
    return found


def _directions(
    pair: Pair,
    deflection: Array,
    tau: Array,
    plan: ReadPlan,
    opposed: Sequence[str],
    names: Sequence[str],
    *,
    computed: bool,
) -> Iterator[str]:
    """Compare motor torque with deflection: tau = K (theta - q) + rotor inertia + friction."""
    correlation = correlation_of(deflection, tau)
    if correlation < -FOLLOWS:
        what = "that of the commands" if computed else "its sign"
        yield (
            f"{pair.name}: tau has the opposite sign of the deflection theta - q: {what} is wrong, or q and "
            f"theta are swapped; {turned_round(plan, 'tau', opposed, names, computed=computed)}"
        )
    elif correlation**2 > 1 - EXACTLY**2:
        yield (
            f"{pair.name}: tau follows the deflection without any friction or inertia: it looks like the torque "
            "in the transmission (tau_link), not the motor's"
        )


def _scale(pair: Pair, ratio: float, robot: Robot, plan: ReadPlan, *, alone: bool) -> Iterator[str]:
    """Name a torque that is in another unit; with `alone` other joints' are not, and its mapping scales it alone."""
    if not off(ratio):
        return
    stiffness = robot.joints[pair.j].parameters["K"]
    why = f"it is {ratio:.3g} times K (theta - q) with K = {stiffness:g} of the robot file"
    shaft = abs(math.log(pair.gear)) > math.log(WRONG_SCALE) if pair.gear > 0 else False
    if shaft and abs(ratio * pair.gear - 1) < 0.3:
        what, key, factor = "the motor's shaft torque", "side: motor", pair.gear
    elif abs(ratio / 1000 - 1) < 0.3:
        what, key, factor = "mN·m", "unit: mN.m", 1e-3
    else:
        what, factor = "a current or another unit (or the positions are in one)", 1 / ratio
        key = f"unit: A, scale: {{{pair.name}: {factor:.4g}}}"
    placement = plan.placements.get("tau")
    if alone or (placement is not None and np.any(np.asarray(placement.spec.scale) != 1.0)):  # what is mapped stays
        key = _rescaled(plan, pair, factor, robot)
    yield f"{pair.name}: tau looks like {what}, {why}; {proposed(plan, 'tau', key)}"


def _rescaled(plan: ReadPlan, pair: Pair, factor: float, robot: Robot) -> str:
    """Return the keys that scale one joint's torque by a factor and leave the others as they are mapped."""
    spec = plan.placements["tau"].spec
    given = np.broadcast_to(spec.scale, robot.n) * np.where(np.arange(robot.n) == pair.j, factor, 1.0)
    scale = ", ".join(f"{n}: {v:.4g}" for n, v in zip(robot.joint_names, given, strict=True) if v != 1.0)
    kept = [f"unit: {spec.unit}"] if isinstance(spec.unit, str) and spec.unit else []
    return ", ".join([*kept, *(["side: motor"] if spec.motor_side else []), f"scale: {{{scale}}}"])


def _swapped_torques(deflection: Array, tau: Array, pairs: list[Pair], robot: Robot) -> Iterator[str]:
    """Name pairs of elastic joints whose torques fit each other's deflection far better than their own."""
    joints = [p.j for p in pairs if robot.joints[p.j].elastic and np.isfinite(tau[:, p.j]).all() and tau[:, p.j].std()]
    joints = [j for j in joints if deflection[:, j].std() > 0]
    if len(joints) < 2:
        return
    table = np.abs(np.corrcoef(deflection[:, joints].T, tau[:, joints].T)[: len(joints), len(joints) :])
    for a in range(len(joints)):
        for b in range(a + 1, len(joints)):
            if max(table[a, a], table[b, b]) < UNLIKE and min(table[a, b], table[b, a]) > FOLLOWS:
                one, two = robot.joint_names[joints[a]], robot.joint_names[joints[b]]
                yield (
                    f"tau of {one} and {two} look swapped: each follows the other's deflection; "
                    f"if so, map it with joints: {{{one}: {two}, {two}: {one}}}"
                )
