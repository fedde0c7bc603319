"""Which base parameters what a model lacks may move: those that curves over the motion, as unknowns, do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.standard_errors import with_prior
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.estimation.validation.other_rows import moved_by_rows
from elid_cli.model.regressor import EstimationRow, Kind
from elid_cli.robot.parameter import StandardParameter

HIDDEN = 30.0
"""How many times larger than what is seen of it a missing torque may be: the rest hides in the parameters."""
MOVED, WIDER = 2.0, 3.0
"""Shift in standard errors, or growth of these, with the missing curves as unknowns, from which a bias is possible."""

ALIKE = 0.9
"""Correlation with a rotor inertia in doubt from which a parameter is in doubt as well."""


class Missing(NamedTuple):
    """A row that lacks something: the groups of curves that it follows, and the size of what is seen, N·m."""

    row: EstimationRow
    groups: tuple[str, ...]
    seen: float
    shared: bool = False
    """Whether other values of the row's own parameters would explain it."""


def _acted(rows: Sequence[EstimationRow]) -> frozenset[Kind]:
    """Return the kinds of a joint's rows that a torque acts in which some of them lack.

    With a joint torque sensor the motor's side, the link's and the transmission have a row each. Without, the sum row
    alone is the link's side, and the motor row alone the spring, which the sum does not hold.
    """
    kinds = {row.kind for row in rows}
    if "drive" in kinds:
        return frozenset({"drive", "motor", "sum"})
    if kinds & {"load", "spring"}:
        return frozenset({"load", "sum"} if "load" in kinds else {"spring", "motor"})
    return frozenset(kinds)


def movable(
    fit: DefaultFit,
    missing: Sequence[Missing],
    curves: Mapping[int, Mapping[str, Array]],
) -> NDArray[np.bool_]:
    """Return the base parameters that the missing torque can move, (b,): those that its curves, as unknowns, do.

    And those that rows which lack nothing contradict.
    """
    extras, sizes = [], list[float]()
    for joint in sorted({item.row.joint for item in missing}):
        here = [item for item in missing if item.row.joint == joint]
        rows = [item.row for item in here]
        names = dict.fromkeys(name for item in here for name in item.groups)
        values = np.concatenate([curves[joint][name] for name in names])
        acted = [g.row for g in fit.observation.groups if g.row.joint == joint and g.row.kind in _acted(rows)]
        extras.append(ExtraColumns("missing", dict.fromkeys(acted, values), ("",) * len(values)))
        size = max(item.seen for item in here)
        sizes += [HIDDEN * size / max(float(np.sqrt(np.mean(v**2))), 1e-12) for v in values]
    triangles = fit.data.triangles((*fit.extras, *extras))
    known = with_prior(triangles, fit.triangles, 1.0 / np.array(sizes))
    solution = reweighted(known, fit.base.count + triangles.extras)
    transform = np.pad(fit.base.transform, ((0, 0), (0, triangles.extras)))
    before = fit.deviations(fit.covariance)
    used = transform[:, solution.basis] @ solution.inverse
    # the noise is as large as before: what its inverse weights say of the wrong model's residual would hide the change
    after = np.sqrt(np.sum(used**2, axis=1))
    plain = fit.transform[:, fit.solution.basis] @ fit.solution.inverse
    ratio = after / np.maximum(np.sqrt(np.sum(plain**2, axis=1)), 1e-300)
    shift = np.abs(transform @ solution.values - fit.transform @ fit.solution.values)
    moved = (shift > MOVED * before) | (ratio > WIDER) | _of_lacking(fit, missing)
    return np.asarray(moved | _by_rows(fit, missing) | _of_deflection(fit, missing))


def _by_rows(fit: DefaultFit, missing: Sequence[Missing]) -> NDArray[np.bool_]:
    """Return the base parameters, (b,), that other rows contradict, or that rest on a torque that they rule out."""
    rows = {item.row for item in missing}
    contradicted, _ = moved_by_rows(fit, rows)
    off = {item.row.joint for item in missing if item.shared}
    if not off:
        return contradicted
    others, resting = moved_by_rows(fit, {row for row in fit.solution.weights if row.joint in off or row in rows})
    return contradicted | others | resting


def _of_deflection(fit: DefaultFit, missing: Sequence[Missing]) -> NDArray[np.bool_]:
    """Return what hangs on how far a motor is from its link, (b,), where its own row lacks what the sum does not.

    The rotor and the bodies behind it turn together but for the deflection: that alone tells them apart. And where the
    deflection is wrong the motor's own position may be, and with it speed and acceleration.
    """
    rows = {item.row for item in missing}
    doubted = [
        row.joint for row in rows
        if row.kind == "motor" and EstimationRow("sum", row.joint) not in rows
    ]  # fmt: skip
    leaders = [fit.base.parameters[k] for k in fit.base.leaders]
    rotors = [leader in {fit.model.robot.rotor_names[k] for k in doubted} for leader in leaders]
    speeds = [leader in {StandardParameter("fv", k) for k in doubted} for leader in leaders]
    own = fit.transform[:, fit.solution.basis]
    covariance = own @ fit.covariance @ own.T
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    alike = np.abs(covariance / np.outer(size, size))[:, rotors] > ALIKE
    return np.asarray(alike.any(axis=1) | np.array(rotors, dtype=bool) | np.array(speeds, dtype=bool))


def _of_lacking(fit: DefaultFit, missing: Sequence[Missing]) -> NDArray[np.bool_]:
    """Return the base parameters of drives and springs whose own torque lacks something, (b,).

    No curve over the motion is friction that grows with the load, or a spring that stiffens: what they take goes into
    the constants beside them first. What a motor lacks is in its sum and its motor row, a spring's in the motor row
    alone; of a rigid joint one row holds all. What follows the load or the deflection in the motor row may be the
    spring's, whatever else lacks it.
    """
    rows: dict[int, set[Kind]] = {}
    own = set()
    for item in missing:
        row = item.row
        rows.setdefault(row.joint, set()).add(row.kind)
        if row.kind in ("motor", "spring") and not {"load", "deflection"}.isdisjoint(item.groups):
            own.add(StandardParameter("K", row.joint))
        if item.shared:
            own |= {StandardParameter(kind, row.joint) for kind in ("fs", "fv", "K")}
    for joint, kinds in rows.items():
        rigid = not fit.model.robot.joints[joint].elastic
        if "drive" in kinds or {"sum", "motor"} <= kinds or rigid:
            own |= {StandardParameter("fs", joint), StandardParameter("fv", joint)}
        elif kinds & {"motor", "spring"}:
            own.add(StandardParameter("K", joint))
    leaders = [fit.base.parameters[k] for k in fit.base.leaders]
    return np.array([leader in own for leader in leaders], dtype=bool)
