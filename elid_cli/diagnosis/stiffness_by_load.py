"""Stiffness from the deflection against the torque that the bodies need.

What is left in the motor row (hysteresis, friction) disturbs both the torque and the deflection, so that the regression
of one on the other gives a stiffness that is too soft or too stiff, and whose standard error does not know it. The load
is computed from the motion and shares neither disturbance: the regression of the deflection on it, theta - q = load / K
+ constant, is what an instrument is to errors in variables (Janot, Vandanjon, Gautier 2014). It is asked where the
transmission's torque explains visibly less than the whole deflection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.encoders import link_load, regression
from elid_cli.diagnosis.state import State
from elid_cli.identification import Identification, Verdict
from elid_cli.link_equation import two_ways

Array = NDArray[np.float64]

CLEAR = 0.9
"""Part of the deflection's variance that follows the torque from which one regression is good enough."""
EXPLAINED = 0.3
"""Least part of the deflection's variance that the load must explain …"""
GOOD = 0.5
"""… and from which the stiffness counts as supported."""
SURE = 0.3
"""Largest relative standard deviation."""
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
    motion = log.signals.motion
    deflection = log.signals.decimate((motion.theta[:, joint] - motion.q[:, joint])[None])[0]
    load = link_load(state, joint)
    known = np.isfinite(deflection) & np.isfinite(load) & ~log.observation.reversing[joint]
    if known.sum() < LEAST:
        return None
    columns, target = np.array([load, np.ones(len(load))]).T[known], deflection[known]
    (compliance, constant), spread = regression(columns, target, log.observation.stretch[known])
    rest = target - columns @ np.array([compliance, constant])
    explained = 1.0 - float(np.var(rest) / np.var(target)) if np.var(target) > 0 else 0.0
    if compliance <= 0 or spread[0] > SURE * compliance or explained < EXPLAINED:
        return None
    return ByLoad(1.0 / float(compliance), float(spread[0]) / float(compliance) ** 2, explained)


def with_load(found: Identification, state: State) -> Identification:
    """Return the identification with each stiffness that depends on the direction of regression taken by the load."""
    estimate, deviation = found.estimate.copy(), found.std_error.copy()
    verdict: list[Verdict] = list(found.verdict)
    this_log, reasons = dict(found.this_log), dict(found.reasons)
    for k, leader in enumerate(found.base.leaders):
        name = found.base.parameters[leader]
        if not name.startswith("K"):
            continue
        joint = int(name[1:]) - 1
        ways = two_ways(found, state.log.observation, joint)
        if verdict[k] != "refused" and ways is not None and ways.share >= CLEAR:
            continue
        other = stiffness_by_load(state, joint)
        if other is None:
            continue
        direct = float(state.standard[leader])
        # a 95 % interval that reaches from one way to the other, where they differ by more than the error
        apart = 0.25 * abs(float(np.log(direct / other.value))) * other.value if direct > 0 else 0.0
        estimate[k], deviation[k] = other.value, max(other.deviation, apart)
        good = other.explained >= GOOD
        verdict[k] = "supported" if good else "weak"
        this_log[name] = found.base.classes[name] if good else "weak"
        reasons[name] = (
            f"from the deflection against the torque that the bodies need, which {other.explained:.0%} of it follows; "
            f"torque on deflection gives {direct:.3g}"
        )
    return replace(
        found, estimate=estimate, std_error=deviation, verdict=tuple(verdict), this_log=this_log, reasons=reasons
    )
