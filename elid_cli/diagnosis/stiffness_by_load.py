"""Stiffness from the deflection against the torque that the bodies need.

What is left in the motor row (hysteresis, friction) disturbs both the torque and the deflection, so that the regression
of one on the other gives a stiffness that is too soft or too stiff, and whose standard error does not know it. The load
is computed from the motion and shares neither disturbance: the regression of the deflection on it, theta - q = load / K
+ constant, is what an instrument is to errors in variables (Janot, Vandanjon, Gautier 2014). It is asked where the
transmission's torque explains visibly less than the whole deflection, and believed where it agrees with the bounds
that the two regressions are. Where the robot file knows the inertias, the link's equation goes before it.

The load is the identified bodies', whose inertia stands beside the rotor's in every other row. Where noise of the
encoders pulls the stiffness towards 0, the rotor takes the link's inertia, and the load and the stiffness by it come
out too small alike: an error that is added, and from a share of the noise nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.search.encoder_skew import link_load
from elid_cli.estimation.facts import deflection_noise
from elid_cli.estimation.regression.covariance import regression
from elid_cli.estimation.result import Identification
from elid_cli.estimation.stiffness.link_equation import CLEAR as LOOSE
from elid_cli.estimation.stiffness.link_equation import (
    EXPLAINED,
    GOOD,
    LinkStiffness,
    TwoWays,
    taken,
    two_ways,
)
from elid_cli.estimation.stiffness.links import link_stiffness
from elid_cli.estimation.stiffness.noise import COLLAPSED, deciding_deflection, pull
from elid_cli.estimation.stretches import QUARTERS, quarter_of
from elid_cli.robot.parameter import StandardParameter

CLEAR = 0.95
"""Part of the deflection's variance that follows the torque from which one regression is good enough."""
HALF = 0.5
"""Least part of the deflection's variance that must follow the load."""
SURE = 0.3
"""Largest relative standard deviation."""
BEYOND = 1.25
"""Factor by which the stiffness may lie outside the two regressions, whose friction is not free of error either."""
LEAST = 50
"""Instants without which nothing is said."""


@dataclass(frozen=True)
class ByLoad:
    """A stiffness by the load, N·m/rad."""

    value: float
    deviation: float
    explained: float
    """Part of the deflection's variance that follows the load."""


def stiffness_by_load(state: State, joint: int) -> ByLoad | None:
    """Return a joint's stiffness by its load, or None where the load does not tell it."""
    log = state.log
    deflection, load = log.observation.channels[joint], link_load(state, joint)
    known = np.isfinite(deflection) & np.isfinite(load) & ~log.observation.reversing[joint]
    if known.sum() < LEAST:
        return None
    columns, target = np.array([load, np.ones(len(load))]).T[known], deflection[known]
    fitted = regression(columns, target, log.observation.segment[known])
    compliance, rest = float(fitted.values[0]), target - columns @ fitted.values
    explained = 1.0 - float(np.var(rest) / np.var(target)) if np.var(target) > 0 else 0.0
    deviation = max(float(fitted.spread[0]), _between_quarters(columns, target))
    deviation = float(np.hypot(deviation, compliance * _pulled(state, joint, load, known)))
    if not np.isfinite(deviation) or compliance <= 0 or deviation > SURE * compliance or explained < HALF:
        return None
    return ByLoad(1.0 / compliance, deviation / compliance**2, explained)


def _pulled(state: State, joint: int, load: Array, known: NDArray[np.bool_]) -> float:
    """Return by what part of itself noise in the deflection pulls the load's size, a standard deviation.

    Infinite where the noise is so large a part that the motor row has lost the stiffness.
    """
    log, solution, covariance = state.log, state.solution, state.covariance
    place = np.flatnonzero(solution.basis == log.model.index[StandardParameter("K", joint)])
    left = deciding_deflection(log.model, state.triangles, solution, joint)
    noise = deflection_noise(log.signals, joint)
    if not len(place) or left is None or not np.isfinite(noise):
        return 0.0
    own = int(place[0])
    if noise**2 > COLLAPSED * left or not covariance[own, own] > 0:
        return float("inf")
    by = pull(float(solution.values[solution.basis[own]]), noise, left)
    moved = np.zeros(len(solution.values))
    moved[solution.basis] = covariance[:, own] / covariance[own, own] * by
    change = link_load(state, joint, moved)[known]
    change, size = change - change.mean(), load[known] - load[known].mean()
    return abs(float(change @ size)) / max(float(size @ size), 1e-300)


def _between_quarters(columns: Array, target: Array) -> float:
    """Return the standard deviation of the first coefficient by leaving out each quarter in turn (the jackknife).

    What a transmission remembers for seconds is one constant in a quarter; no correlation over lags can tell that.
    """
    quarter = quarter_of(len(target))
    scale = np.linalg.norm(columns, axis=0)
    values = []
    for k in range(QUARTERS):
        rest = quarter != k
        values.append(np.linalg.lstsq(columns[rest] / scale, target[rest], rcond=None)[0][0] / scale[0])
    return float(np.sqrt((QUARTERS - 1) * np.var(values)))


def _good(link: LinkStiffness) -> bool:
    return link.value > 0 and link.explained >= EXPLAINED and link.deviation <= SURE * link.value


def _bounds(ways: TwoWays) -> str:
    return f"torque on deflection gives {ways.direct:.3g}, deflection on torque {ways.inverse:.3g}"


def with_load(found: Identification, state: State) -> Identification:
    """Return the identification with each stiffness that depends on the direction of regression taken by the load."""
    reference = state.log.model.robot.reference()
    # what bends a spring's law is fitted along with its stiffness; a line through the raw deflection knows none of it
    bent = {effect.joint for effect in state.effects if effect.place == "spring"}
    items = list(found.parameters)
    for k, item in enumerate(items):
        joint = item.leader.joint if item.leader.kind == "K" else -1
        if joint < 0 or joint in bent:
            continue
        ways = two_ways(state.log.observation, state.solution.values, found.base.parameters, joint, state.extras)
        if ways is None or (item.verdict != "refused" and ways.share >= CLEAR):
            continue
        link = link_stiffness(found.base, state.log.observation, state.log.signals, reference, joint)
        if link is not None and ways.share < LOOSE and _good(link):
            reason = (
                f"from the link's equation and the file's inertias, which explain {link.explained:.0%} of its torque; "
                f"{_bounds(ways)}"
            )
            items[k] = taken(item, link.value, link.deviation, reason, firm=link.explained >= GOOD)
            continue
        other = stiffness_by_load(state, joint)
        if other is None or not ways.direct / BEYOND < other.value < ways.inverse * BEYOND:
            continue
        # a 95 % interval that reaches from one way to the other, where they differ by more than the error
        apart = 0.25 * abs(float(np.log(ways.middle / other.value))) * other.value
        reason = (
            f"from the deflection against the torque that the bodies need, which {other.explained:.0%} of it follows; "
            f"{_bounds(ways)}"
        )
        items[k] = taken(item, other.value, max(other.deviation, apart), reason)
    return replace(found, parameters=tuple(items))
