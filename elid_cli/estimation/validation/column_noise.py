"""Noise of the positions in the columns: errors in variables, which standard errors do not see.

A column is computed from measured positions, and their noise enters it through second derivatives. Least squares then
pulls every coefficient towards what noise alone would give: by -(H - N)⁻¹ N β, H being the normal matrix of the noisy
columns and N that of their noise (Fuller, Measurement Error Models, 1987, section 1.2). Inertias of small motions under
coarse encoders are pulled by many times what the residual says.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.validation.noise_floor import PropagatedNoise

MOST = 0.9
"""Part of a direction's normal matrix that noise is taken for at most: beyond it the motion shows nothing."""


def pull_of(fit: DefaultFit, noise: PropagatedNoise) -> Array:
    """Return by how much noise in the columns pulls the base parameters of a fit, (b,).

    What noise of the deflection does to a stiffness, and to what goes with it, is known apart (`stiffness.noise`).

    Parameters
    ----------
    fit
        The fit.
    noise
        What noise changes in its columns, at the same instants.
    """
    solution, model = fit.solution, fit.model
    basis = solution.basis
    place = {int(column): k for k, column in enumerate(basis)}
    stiff = np.array([column < model.parameters and model.names[column].kind == "K" for column in basis])
    normal, own = np.zeros((2, len(basis), len(basis)))
    load = np.zeros(len(basis))
    for number, group in enumerate(noise.groups):
        weight = solution.weights.get(group.row, 0.0) ** 2 / len(noise.changes)
        known = [k for k, column in enumerate(group.index) if int(column) in place]
        here = [place[int(group.index[k])] for k in known]
        values = solution.values[group.index] * [model.names[k].kind != "K" for k in group.index]
        for history in noise.changes:
            change = history[number][:, group.use]
            own[np.ix_(here, here)] += weight * change[known] @ change[known].T
            load[here] += weight * change[known] @ (values @ change)
    for triangle in fit.triangles.items:
        if triangle.row in solution.weights:
            known = [k for k, column in enumerate(triangle.index) if int(column) in place]
            here = [place[int(triangle.index[k])] for k in known]
            part = triangle.factor[:, known] * solution.weights[triangle.row]
            normal[np.ix_(here, here)] += part.T @ part
    own[stiff], own[:, stiff], load[stiff] = 0.0, 0.0, 0.0
    size = np.sqrt(np.diag(normal))
    if not (np.isfinite(size).all() and (size > 0).all() and np.isfinite(load).all()):
        return np.zeros(fit.base.count)
    unit = np.linalg.cholesky(normal / np.outer(size, size) + 1e-12 * np.eye(len(size)))
    inner = np.linalg.solve(unit, np.linalg.solve(unit, own / np.outer(size, size)).T)
    shares, turn = np.linalg.eigh(0.5 * (inner + inner.T))
    left = turn @ ((turn.T @ np.linalg.solve(unit, load / size)) / (1.0 - np.minimum(shares, MOST)))
    moved = -np.linalg.solve(unit.T, left) / size
    found: Array = fit.transform[:, basis] @ moved
    return found
