"""Noise of the positions in the columns: errors in variables, which standard errors do not see.

A column is computed from measured positions, and their noise enters it through second derivatives. Least squares then
pulls every coefficient towards what noise alone would give: by -(H - N)⁻¹ N β, H being the normal matrix of the noisy
columns and N that of their noise (Fuller, Measurement Error Models, 1987, section 1.2). Inertias of small motions under
coarse encoders are pulled by many times what the residual says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import Solved
from elid_cli.estimation.judgement import ColumnNoise
from elid_cli.estimation.validation.noise_floor import PropagatedNoise
from elid_cli.model.regressor import EstimationRow

MOST = 0.9
"""Part of a direction's normal matrix that is noise from which the motion shows nothing of that direction."""
LOST = 1e3
"""Times its value, or its standard error, that may be missing of what lies along such a direction."""


def columns_of(noise: PropagatedNoise) -> tuple[ColumnNoise, ...]:
    """Return the mean square of what noise changes in the columns of every row, as sent through a log's equations."""
    found = []
    for number, group in enumerate(noise.groups):
        changes = np.concatenate([history[number][:, group.use] for history in noise.changes], axis=1)
        if changes.shape[1]:
            found.append(ColumnNoise(group.row, group.index, changes @ changes.T / changes.shape[1]))
    return tuple(found)


def joined(logs: Sequence[Sequence[ColumnNoise]], instants: Sequence[int]) -> tuple[ColumnNoise, ...]:
    """Return the mean square over several logs; one without any knows of no noise."""
    whole, rows = max(sum(instants), 1), dict[EstimationRow, ColumnNoise]()
    for columns, count in zip(logs, instants, strict=True):
        for item in columns:
            before = rows[item.row].gram if item.row in rows else 0.0
            rows[item.row] = ColumnNoise(item.row, item.index, before + item.gram * (count / whole))
    return tuple(rows.values())


def pull_of(fit: Solved, columns: Sequence[ColumnNoise]) -> Array:
    """Return by how much noise in the columns pulls the base parameters of a fit, in several directions, (b, d).

    Along a direction in which most of the columns is noise, nothing bounds it. What noise of the deflection does to a
    stiffness, and to what goes with it, is known apart (`stiffness.noise`).

    Parameters
    ----------
    fit
        The fit.
    columns
        What noise is in its columns.
    """
    solution, model = fit.solution, fit.model
    basis = solution.basis
    place = {int(column): k for k, column in enumerate(basis)}
    normal, own = np.zeros((2, len(basis), len(basis)))
    counts: dict[EstimationRow, int] = {}
    for triangle in fit.triangles.items:
        if triangle.row in solution.weights:
            counts[triangle.row] = counts.get(triangle.row, 0) + triangle.count
            known = [k for k, column in enumerate(triangle.index) if int(column) in place]
            here = [place[int(triangle.index[k])] for k in known]
            part = triangle.factor[:, known] * solution.weights[triangle.row]
            normal[np.ix_(here, here)] += part.T @ part
    for item in columns:
        weight = solution.weights.get(item.row, 0.0) ** 2 * counts.get(item.row, 0)
        known = [k for k, column in enumerate(item.index) if int(column) in place and model.names[column].kind != "K"]
        here = [place[int(item.index[k])] for k in known]
        own[np.ix_(here, here)] += weight * item.gram[np.ix_(known, known)]
    size = np.sqrt(np.diag(normal))
    if not (np.isfinite(size).all() and (size > 0).all() and np.isfinite(own).all()):
        return np.zeros((fit.base.count, 0))
    unit = np.linalg.cholesky(normal / np.outer(size, size) + 1e-12 * np.eye(len(size)))
    inner = np.linalg.solve(unit, np.linalg.solve(unit, own / np.outer(size, size)).T)
    shares, turn = np.linalg.eigh(0.5 * (inner + inner.T))
    held = turn.T @ (unit.T @ (solution.values[basis] * size))  # the values along the directions
    lost = shares > MOST
    pulled = turn @ np.where(lost, 0.0, held * shares / (1.0 - np.minimum(shares, MOST)))
    open_ = turn[:, lost] * (LOST * np.maximum(np.abs(held[lost]), 1.0))
    moved = np.linalg.solve(unit.T, np.column_stack([-pulled, open_])) / size[:, None]
    return np.asarray(fit.transform[:, basis] @ moved)
