"""Skew between a joint's encoders, seen in the positions alone.

Where almost no torque crosses a transmission its stiffness stays unknown, and the torques cannot tell a skew from it.
The deflection itself can: it follows the link's velocity, theta - q = skew q' + load / K + constant. That is a skew,
and not viscous load on a soft spring, when the load that varies deflects the spring too little for its viscous part
to be what is seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State
from elid_cli.estimation.regression.covariance import regression
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import MOTOR_PARAMETERS, StandardParameter

SURE = 6.0
"""Standard deviations by which a skew must differ from zero."""
SHARE = 0.5
"""Least part of the deflection's remaining variance that the velocity must take away on held-out stretches."""
TIMES_VISCOUS = 3.0
"""How many times the deflection by viscous load the velocity's part must be."""
LONGEST = 0.05
"""s."""


@dataclass(frozen=True)
class Skew:
    """A skew seen in the positions."""

    joint: int
    skew: float
    """Age of the link encoder's reading beyond the motor encoder's, s."""
    deviation: float
    share: float
    """Part of the held-out variance of the deflection that it explains beyond load and constant."""
    without: float
    """Held-out rms of the deflection that load and constant leave, rad (m)."""
    with_it: float
    """The same with the skew."""
    quarters: tuple[float, ...] = ()
    """Part of the deflection's squared error that it takes from each quarter of the log, predicted from the others."""
    rivals: tuple[tuple[str, Mapping[str, float]], ...] = ()
    """Effects that the torques like as well, with their values."""


def visible_skew(state: State, joint: int) -> Skew | None:
    """Return the skew that a joint's positions show beyond doubt, or None."""
    seen = _regressed(state, joint)
    if seen is None:
        return None
    item, viscous = seen
    sure = abs(item.skew) > SURE * item.deviation and item.share > SHARE and abs(item.skew) < LONGEST
    return item if sure and abs(item.skew) > TIMES_VISCOUS * viscous else None


def looked_again(state: State, item: Skew) -> Skew:
    """Return a skew as a look at the moved channel shows it: the load of the first look was biased by the skew."""
    seen = _regressed(state, item.joint)
    if seen is None:
        return item
    last = seen[0]
    share = 1.0 - (last.with_it / item.without) ** 2 if item.without > 0 else item.share
    skew = item.skew + last.skew
    return replace(item, skew=skew, deviation=last.deviation, with_it=last.with_it, share=share)


def _regressed(state: State, joint: int) -> tuple[Skew, float] | None:
    """Return the skew by regression of the deflection, and what viscous load on the spring may imitate of it, s."""
    log = state.log
    robot = log.model.robot
    if not robot.joints[joint].elastic or log.signals.still[joint]:
        return None
    deflection, speed = log.observation.channels[[joint, 2 * robot.n + joint]]
    load = link_load(state, joint)
    known = np.isfinite(deflection) & np.isfinite(load)
    train, test = known & (log.fold >= 0), known & (log.fold < 0)
    if train.sum() < 50 or test.sum() < 10:
        return None
    columns = np.array([speed, load, np.ones_like(load)])
    fitted = regression(columns[:, train].T, deflection[train], log.observation.segment[train])
    plain = regression(columns[1:, train].T, deflection[train], log.observation.segment[train])
    with_it = float(np.sum((deflection - fitted.values @ columns)[test] ** 2))
    without = float(np.sum((deflection - plain.values @ columns[1:])[test] ** 2))
    skew, deviation = float(fitted.values[0]), float(fitted.spread[0])
    share = 1.0 - with_it / without if without > 0 else 0.0
    viscous = abs(float(state.standard[log.model.index[StandardParameter("fv", joint)]]))
    compliance = abs(float(fitted.values[1])) + 2.0 * float(fitted.spread[1])
    count = float(test.sum())
    item = Skew(joint, skew, deviation, share, float(np.sqrt(without / count)), float(np.sqrt(with_it / count)))
    return item, viscous * compliance


def link_load(state: State, joint: int, parameters: Array | None = None) -> Array:
    """Return the torque that the bodies need from a joint's transmission, (M,).

    From the present standard parameters, or from others (p,).
    """
    values = state.standard if parameters is None else parameters
    log = state.log
    total = log.observation.group(EstimationRow("sum", joint))
    own = {log.model.index.get(StandardParameter(kind, joint)) for kind in MOTOR_PARAMETERS}
    load: Array = np.array([0.0 if int(k) in own else values[k] for k in total.index]) @ total.columns
    for number, effect in enumerate(state.effects if parameters is None else ()):
        if effect.place == "link" and total.row in state.columns[number].rows:
            load = load + state.coefficients(number) @ state.columns[number].rows[total.row]
    return load
