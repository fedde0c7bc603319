"""Which base parameters other equations contradict, where some equations lack something.

A body's parameters stand in the equations of several joints. Those that lack something bend them, and the others, which
lack nothing, then say something else.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.model.regressor import EstimationRow

MOVED = 3.0
"""Shift, in standard errors of what the other rows say alone, from which they contradict."""
LOST = 3.0
"""Growth of a standard error without some rows from which a parameter rests on them."""
TINY = 1e-14
"""Least eigenvalue of all information, of the largest."""
HELD = 1e-6
"""Share of its information that a direction keeps which the other rows do not show at all."""


def moved_by_rows(fit: DefaultFit, rows: Collection[EstimationRow]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the base parameters that all other rows contradict, and those that rest on these rows, (b,) each.

    Parameters
    ----------
    fit
        The fit.
    rows
        Those that lack something.
    """
    solution = fit.solution
    place = {column: k for k, column in enumerate(solution.basis.tolist())}
    size = len(place)
    whole, others, pull = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for item in fit.triangles.items:
        weight = solution.weights.get(item.row, 0.0)
        own = [k for k, column in enumerate(item.index.tolist()) if column in place]
        where = [place[column] for column in item.index[own].tolist()]
        factor = weight * item.factor[:, own]
        gram = factor.T @ factor
        whole[np.ix_(where, where)] += gram
        if item.row not in rows:
            others[np.ix_(where, where)] += gram
            left = weight * (item.factor[:, -1] - item.factor[:, :-1] @ solution.values[item.index])
            pull[where] += factor.T @ left
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    whole, others = (matrix * np.outer(scale, scale) for matrix in (whole, others))
    # in coordinates in which all rows know every direction alike: no inverse then cuts any off
    known, axes = np.linalg.eigh(whole)
    alike = axes / np.sqrt(np.maximum(known, TINY * known.max()))
    transform = (fit.transform[:, solution.basis] * scale) @ alike
    inverse = np.asarray(np.linalg.inv(alike.T @ others @ alike + HELD * np.eye(len(known))))
    shift = np.abs(transform @ (inverse @ (alike.T @ (scale * pull))))
    now = np.linalg.norm(transform, axis=1)
    growth = _spread(transform, inverse) / np.maximum(now, 1e-300)
    return shift > MOVED * growth * fit.deviations(fit.covariance), growth > LOST


def _spread(transform: Array, inverse: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.einsum("bi,ij,bj->b", transform, inverse, transform), 0.0)))
