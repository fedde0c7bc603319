"""The body of a real robot that needs most nearly the same torques as parameters that no body has."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.inertia import in_lengths, inertial_parameters, pseudo_inertia

INSIDE = 1e-4
"""Least second moments of the body, in parts of its mass times its size squared."""
SLIGHT = 1e-4
"""What a parameter's change counts beside that of the torques, each in its size: it decides what no torque tells."""


def is_body(parameters: Array) -> bool:
    """Whether ten parameters (10,) are those of a body with mass: its pseudo-inertia has no negative eigenvalue."""
    if not parameters[0] > 0:
        return False
    matrix = in_lengths(pseudo_inertia(parameters), _size(parameters))
    return bool(np.linalg.eigvalsh(matrix)[0] >= 0.0)


def nearest_body(parameters: Array, felt: Array) -> Array:
    """Return the parameters (10,) of the body that acts most nearly as `parameters` do.

    Parameters
    ----------
    parameters
        Mass, first moments and inertias about the origin, (10,); with a mass above 0.
    felt
        Torques that 1 of each needs along some motion, (R, 10).

    The mass stays. A body's pseudo-inertia is ``U U'`` with U upper triangular (Rucker, Wensing, "Smooth
    parameterization of rigid-body inertia", 2022). What is one already is returned as it is.

    Raises
    ------
    ValueError
        No mass.
    """
    if not parameters[0] > 0:
        raise ValueError(f"a mass of {parameters[0]:.3g} kg")
    if is_body(parameters):
        return parameters
    from scipy.optimize import least_squares

    mass, size = float(parameters[0]), _size(parameters)
    sizes = mass * size ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    weights = np.asarray(np.linalg.qr(felt * sizes, mode="r"))
    weights = np.concatenate([weights / max(np.abs(weights).max(), 1e-300), SLIGHT * np.eye(len(sizes))])
    upper = np.triu_indices(3)

    def body(entries: Array) -> Array:
        factor = np.eye(4)
        factor[:3, 3] = entries[:3]
        factor[:3, :3][upper] = entries[3:]
        matrix = factor @ factor.T + INSIDE * np.diag([1.0, 1.0, 1.0, 0.0])
        return mass * inertial_parameters(in_lengths(matrix, 1 / size))

    scaled = in_lengths(pseudo_inertia(parameters), size) / mass
    centre = scaled[:3, 3]
    values, vectors = np.linalg.eigh(scaled[:3, :3] - np.outer(centre, centre))
    # U U' with U upper is Cholesky's with the axes in the opposite order
    inside = np.linalg.cholesky(((vectors * np.maximum(values, INSIDE)) @ vectors.T)[::-1, ::-1])[::-1, ::-1]
    found = least_squares(
        lambda entries: weights @ ((body(entries) - parameters) / sizes), np.concatenate([centre, inside[upper]]),
        xtol=1e-12, ftol=1e-12, gtol=1e-12,
    )  # fmt: skip
    return body(found.x)


def _size(parameters: Array) -> float:
    """Return a length, m, that makes masses, first moments and inertias of a body comparable."""
    mass = float(parameters[0])
    spread = np.abs(parameters[4:7]).max() / mass
    return float(np.sqrt(max(spread, np.sum(parameters[1:4] ** 2) / mass**2, 1e-12)))
