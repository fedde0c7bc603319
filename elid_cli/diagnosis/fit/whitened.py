"""The whitened problem of a fitted model, projected off what the model spans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.projection import Projected, Stretch
from elid_cli.diagnosis.fit.whitening import JointWhitener
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.lapack import lapack
from elid_cli.model.regressor import EstimationRow

_BLOCK = 32
"""Reflections that LAPACK makes at once."""


def project(
    observation: Observation,
    extras: Sequence[ExtraColumns],
    solution: Solution,
    joints: tuple[JointWhitener, ...],
    fold: NDArray[np.intp],
    folds: int,
    further: Sequence[ExtraColumns] = (),
) -> Projected:
    """Whiten the present model's equations and project the residual.

    Parameters
    ----------
    observation, extras, solution
        The present model and its fit.
    joints
        Whiteners of the joints.
    fold
        Fold of each instant, (M,); -1 for instants that the search must not see.
    folds
        Number of folds.
    further
        Columns that the model lacks, and that may come with whatever else it lacks.
    """
    instants = observation.instants
    columns_of = {
        group.row: _dense(group.row, observation, extras, solution, further)
        for group in observation.groups
        if group.count
    }
    parts, targets, places, kept, adapted = [], [], [], [], []
    stretches: list[Stretch] = []
    first = 0
    channels = 0
    for whitener in joints:
        r = len(whitener.rows)
        seen = whitener.use & (fold >= 0)
        series = np.array([columns_of[row] for row in whitener.rows])
        whitener = whitener.mixed_by(series[:, -1:], seen)
        adapted.append(whitener)
        instant = np.flatnonzero(seen)
        instant = instant[np.argsort(fold[instant], kind="stable")]
        white = whitener.apply(series)[:, :, instant]
        parts.append(white[:, :-1].transpose(0, 2, 1).reshape(r * len(instant), -1))
        targets.append(white[:, -1].ravel())
        kept.append(instant)
        places.append(slice(first, first + r * len(instant)))
        edges = np.searchsorted(fold[instant], np.arange(folds + 1))
        for k in range(r):
            start = first + k * len(instant)
            stretches += [
                Stretch(channels + k, f, slice(start + int(edges[f]), start + int(edges[f + 1]))) for f in range(folds)
            ]
        first += r * len(instant)
        channels += r
    columns, target = np.concatenate(parts), np.concatenate(targets)
    del parts, targets  # the largest arrays of a search: as few of them at a time as can be
    norms = np.linalg.norm(columns, axis=0)
    columns = np.asfortranarray(columns[:, norms > 0])
    columns /= norms[norms > 0]
    work = _BLOCK * columns.shape[1]
    reflected, tau, _, _ = lapack().dgeqrf(columns, work, overwrite_a=1)
    live = np.abs(np.diag(reflected)) > 1e-9
    basis = lapack().dorgqr(reflected, tau, work, overwrite_a=1)[0]
    basis = basis if live.all() else basis[:, live]
    target = target - basis @ (basis.T @ target)
    return Projected(tuple(adapted), tuple(kept), tuple(places), basis, target, tuple(stretches), folds, instants)


def _dense(
    row: EstimationRow,
    observation: Observation,
    extras: Sequence[ExtraColumns],
    solution: Solution,
    further: Sequence[ExtraColumns],
) -> Array:
    """Return the basis columns, further ones and, last, the residual of a row group, (r + d + 1, M)."""
    group = observation.group(row)
    index, columns = full_columns(group, extras, observation.parameters)
    place = {int(column): k for k, column in enumerate(solution.basis)}
    dense = np.zeros((len(solution.basis) + 1, observation.instants))
    for k, column in enumerate(index):
        if int(column) in place:
            dense[place[int(column)]] = columns[k]
    dense[-1] = group.target - solution.values[index] @ columns
    nothing = np.zeros(observation.instants)
    return (
        np.insert(dense, [-1], [extra.rows.get(row, nothing[None])[0] for extra in further], axis=0)
        if further
        else dense
    )
