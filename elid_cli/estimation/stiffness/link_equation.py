"""Stiffness where the motor torque shows it badly: by both regressions, or from the link's own equation.

The link's row has no measured torque in it: K (theta - q) = what the bodies need. It fixes the ratio of the stiffness
to the inertias as sharply as the deflection is measured, whatever the motor's friction does. Where friction hides the
transmitted torque, the file's reference inertias (CAD, a data sheet) supply the scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangle
from elid_cli.estimation.result import BaseEstimate, Identification, Verdict
from elid_cli.robot.parameter import StandardParameter

EXPLAINED = 0.6
"""Least part of the bodies' torque that the transmission's must explain."""
GOOD = 0.84
"""The same for a stiffness that counts as supported: at most 40 % of the torque's rms is left."""
SHARPER = 0.5
"""Error, as a part of the other's, from which the link's equation goes before a weak stiffness by the motor torque."""
WEAK = 0.3
"""Relative standard deviation above which a stiffness is weak."""
REFUSED = 1.0
"""Relative standard deviation above which a stiffness says nothing."""
CLEAR = 0.7
"""Part of the deflection's variance that must follow the torque for a stiffness to be read off one regression."""
APART = 0.25
"""Relative difference between two ways to a stiffness beyond which neither is well determined."""
LEAST = 50
"""Instants without which nothing is said."""


@dataclass(frozen=True)
class LinkStiffness:
    """Stiffness that a link's equation gives with the file's inertias, N·m/rad."""

    value: float
    deviation: float
    """With what noise of the encoders in the deflection pulls the value by (`stiffness.pull`)."""
    explained: float
    """Part of the variance of the bodies' torque that spring, damping and link friction explain."""


@dataclass(frozen=True)
class TwoWays:
    """A stiffness by the regressions of torque on deflection and of deflection on torque, N·m/rad.

    Noise in the deflection makes the first too small, noise in the torque the second too large.
    """

    direct: float
    inverse: float

    @property
    def middle(self) -> float:
        """Return the geometric mean."""
        return float(np.sqrt(self.direct * self.inverse))

    @property
    def spread(self) -> float:
        """Return the standard deviation whose two-sided 95 % interval reaches about from one to the other."""
        return self.middle * 0.25 * float(np.log(self.inverse / self.direct))

    @property
    def share(self) -> float:
        """Return the part of the deflection's variance that follows the torque."""
        return self.direct / self.inverse


def two_ways(
    observation: Observation, values: Array, names: Sequence[str], joint: int, extras: Sequence[ExtraColumns] = ()
) -> TwoWays | None:
    """Return a joint's stiffness by both regressions of its motor row, or None where they do not exist.

    The torque is the motor's less rotor inertia, friction and effects as identified, or the joint torque sensor's: a
    limit that cuts a command is no torque that the spring passes on.

    Parameters
    ----------
    observation
        The log's equations.
    values
        Standard parameters, then what the columns of `extras` are multiplied by, (p + e,).
    names
        Names of the standard parameters, (p,).
    joint
        Joint number from 0.
    extras
        Columns of nuisances and effects.
    """
    row, constant = observation.spring_row(joint), observation.parameters
    other, first = np.zeros(observation.instants), constant
    for extra in extras:
        if row in extra.rows:
            other = other + values[first : first + extra.width] @ extra.rows[row]
        first += extra.width
    groups = [group for group in observation.groups if group.row == row]
    parts = []
    for group in groups:
        rows = np.vstack([group.columns, np.ones(observation.instants), group.target - other])[:, group.use].T
        parts.append(Triangle(row, 0, np.append(group.index, constant), rows, group.count, 0.0))
    return ways_of(parts, values, names, joint, constant)


def ways_of(
    parts: Sequence[Triangle], standard: Array, names: Sequence[str], joint: int, constant: int
) -> TwoWays | None:
    """Return a joint's stiffness by both regressions of a row that holds it; None where they do not exist.

    Parameters
    ----------
    parts
        The row's triangles, or its equations themselves.
    standard, names
        The standard parameters as identified and their names, (p,): their part is taken off the torque.
    joint
        Joint number from 0.
    constant
        Number of the column of ones, which is eliminated.
    """
    count, index = sum(part.count for part in parts), parts[0].index if parts else np.zeros(0, dtype=np.intp)
    places = {names[k] if k < len(names) else k: place for place, k in enumerate(index.tolist())}
    spring = places.pop(StandardParameter("K", joint), None)
    if spring is None or count < LEAST:
        return None
    factor = np.concatenate([part.factor for part in parts])
    x, ones = factor[:, spring], factor[:, places[constant]]
    own = [place for place in places.values() if index[place] < len(names)]
    y = factor[:, -1] - factor[:, own] @ standard[index[own]]

    def product(a: Array, b: Array) -> float:
        return float(a @ b) - float(a @ ones) * float(b @ ones) / count

    xx, yy, xy = product(x, x), product(y, y), product(x, y)
    return TwoWays(xy / xx, yy / xy) if xx > 0 and xy > 0 else None


def with_both_regressions(found: Identification, way: Callable[[int], TwoWays | None]) -> Identification:
    """Return the identification with each stiffness that depends on the direction of regression put between the two.

    `way` gives both for a joint (from 0).
    """
    items = tuple(_between(item, way) if item.leader.kind == "K" else item for item in found.parameters)
    unsaid = np.array([np.isnan(item.estimate) for item in items])
    covariance = np.where(unsaid[:, None] | unsaid[None], np.nan, found.covariance)
    return replace(found, parameters=items, covariance=covariance)


def _between(item: BaseEstimate, way: Callable[[int], TwoWays | None]) -> BaseEstimate:
    ways = way(item.leader.joint) if item.verdict != "refused" else None
    if ways is None or ways.share >= CLEAR:
        return item
    follows = f"only {ways.share:.0%} of the deflection follows the torque"
    if item.estimate > ways.inverse + 2.0 * item.std_error:
        # what stands still tells more than what varies: right if neither encoder's zero is off
        away = 0.5 * (item.estimate - ways.inverse)
        reason = (
            f"{follows}: this value is from the mean load, and the varying load gives no more than {ways.inverse:.3g}"
        )
        return replace(item, std_error=max(item.std_error, away), verdict="weak", reason=reason)
    estimate, deviation = ways.middle, max(ways.spread, item.std_error)
    reason = (
        f"{follows}: between {ways.direct:.3g} (torque on deflection) and {ways.inverse:.3g} (deflection on torque)"
    )
    if not deviation <= REFUSED * estimate:  # true for NaN too
        reason = f"standard error {deviation:.2g} against a value of {estimate:.2g}: {reason}"
        return replace(item, estimate=np.nan, std_error=np.nan, verdict="refused", reason=reason)
    verdict: Verdict = "weak" if deviation > WEAK * estimate else item.verdict
    return replace(item, estimate=estimate, std_error=deviation, verdict=verdict, reason=reason)


def with_link_stiffness(found: Identification, way: Callable[[int], LinkStiffness | None]) -> Identification:
    """Return the identification with refused and weak stiffnesses taken from the links' equations, where they hold.

    A stiffness that both ways give, but differently, is marked as weak. `way` gives the other way to the stiffness of
    a joint (from 0).
    """
    items, notes = list(found.parameters), list(found.notes)
    for k, item in enumerate(items):
        if item.leader.kind != "K":
            continue
        joint = item.leader.joint
        other = way(joint)
        if other is None or other.value <= 0 or other.explained < EXPLAINED or other.deviation > 0.3 * other.value:
            continue
        if item.verdict == "refused" or (item.verdict == "weak" and other.deviation < SHARPER * item.std_error):
            reason = (
                f"from the link's equation and the file's inertias, which explain {other.explained:.0%} of its torque: "
                "the motor torque does not show it"
            )
            firm = other.explained > GOOD  # in the scale of inertias that no torque of this log has confirmed
            items[k] = replace(taken(item, other.value, other.deviation, reason, firm=firm), bias_possible=firm)
            notes.append(f"{item.leader} of {found.robot.joint_names[joint]} is {reason}")
        elif abs(item.estimate - other.value) > APART * item.estimate and item.std_error > 0.05 * item.estimate:
            reason = (
                f"poorly determined: the link's equation with the file's inertias gives {other.value:.3g} "
                f"(± {other.deviation:.2g})"
            )
            items[k] = replace(item, verdict="weak", reason=reason)
    return replace(found, parameters=tuple(items), notes=tuple(notes))


def taken(item: BaseEstimate, value: float, deviation: float, reason: str, *, firm: bool = True) -> BaseEstimate:
    """Return a parameter with a value that another way gives, supported where that is `firm`."""
    return replace(item, estimate=value, std_error=deviation, verdict="supported" if firm else "weak", reason=reason)
