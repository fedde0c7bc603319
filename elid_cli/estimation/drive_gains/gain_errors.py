"""What the errors of drives' gains add to those of the parameters: a parameter is as unsure as the torque's unit.

Least squares are linear in the torque. The part of the parameters that one joint's torque makes, the other torques
taken for zero, is therefore what they change by per relative change of its gain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import solve
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.verdicts import WEAK, torque_scale

OF_GAINS = "the drives' gains are not known better"


def with_gain_errors(found: Identification, spread: Array) -> Identification:
    """Return an identification whose standard errors contain those of the gains that its torques were made by.

    Parameters
    ----------
    found
        The identification of torques in N·m (N).
    spread
        Covariance of the gains' relative errors, (n, n); NaN of gains that are not told.
    """
    if found.triangles is None:
        return found
    slopes = slopes_of(found, found.triangles)
    added = slopes @ np.where(np.isfinite(spread), spread, 0.0) @ slopes.T
    scale = torque_scale(found.base, found.triangles)
    items = zip(found.parameters, np.diag(added).tolist(), scale.tolist(), strict=True)
    parameters = tuple(_wider(item, variance, least) for item, variance, least in items)
    return replace(found, parameters=parameters, covariance=found.covariance + added)


def slopes_of(found: Identification, triangles: Triangles) -> Array:
    """Return the change of every base parameter per relative change of every joint's torque, (b, n)."""
    robot, base = found.robot, found.base
    basis = solve(triangles, found.weights).basis
    slopes = np.zeros((base.count, robot.n))
    for joint in range(robot.n):
        items = []
        for triangle in triangles.items:
            factor = triangle.factor.copy()
            factor[:, -1] *= triangle.row.joint == joint
            items.append(replace(triangle, factor=factor))
        part = solve(replace(triangles, items=tuple(items), prior=None), found.weights, basis=basis)
        slopes[:, joint] = base.transform @ part.values[: triangles.parameters]
    return slopes


def _wider(item: BaseEstimate, variance: float, least: float) -> BaseEstimate:
    """Return a parameter with a further variance; `least` is what makes little of the torque."""
    deviation = float(np.hypot(item.std_error, np.sqrt(max(variance, 0.0))))
    size = max(abs(item.estimate), least if np.isfinite(least) else 0.0)
    if item.verdict != "supported" or deviation <= WEAK * size:
        return replace(item, std_error=deviation)
    of = "what would make 1 % of the torque" if size > abs(item.estimate) else "the value"
    reason = f"standard error {100 * deviation / size:.0f} % of {of}: {OF_GAINS}"
    return replace(item, std_error=deviation, verdict="weak", reason=reason)
