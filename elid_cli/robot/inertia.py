"""Inertial parameters of a body as its 4x4 pseudo-inertia, which moves between frames and adds like a matrix.

``J = [[S, c], [c', m]]`` with ``S = tr(I)/2·E - I``, ``c`` the first moment (kg·m) and ``I`` the inertia tensor about
the frame's origin (kg·m²). With ``T`` the 4x4 transform that takes coordinates of frame A to frame B,
``J_B = T J_A T'`` (Wensing, Kim, Slotine, "Linear matrix inequalities for physically consistent inertial parameter
identification", 2018). Parameters are in the order of `robot.LINK_PARAMETERS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.parameter import LINK_PARAMETERS

ROUNDING = 1e-9
"""Relative error of moments of inertia that were computed from sums of others."""


def ten_of(values: Mapping[str, float]) -> Array:
    """Return the ten parameters of a body, shape (10,), of a joint's parameters by name; 0 for what is unknown."""
    return np.array([values.get(name, 0.0) for name in LINK_PARAMETERS])


def symmetric(six: Iterable[float]) -> Array:
    """Return the 3x3 tensor of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = map(float, six)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six_of(tensor: Array) -> Array:
    """Return xx, yy, zz, xy, xz, yz of a 3x3 tensor, shape (6,)."""
    return np.array([*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])


def in_lengths(matrix: Array, length: float) -> Array:
    """Return a 4x4 pseudo-inertia with lengths in units of `length`, m: masses and inertias are then comparable."""
    weights = np.array([1 / length, 1 / length, 1 / length, 1.0])
    return np.asarray(matrix * np.outer(weights, weights))


def pseudo_inertia(parameters: Array) -> Array:
    """Return the 4x4 pseudo-inertia of ten parameters (m, c, I about the origin), shape (10,)."""
    m, cx, cy, cz, *six = (float(value) for value in parameters)
    tensor = symmetric(six)
    matrix = np.empty((4, 4))
    matrix[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    matrix[:3, 3] = matrix[3, :3] = (cx, cy, cz)
    matrix[3, 3] = m
    return matrix


def inertial_parameters(matrix: Array) -> Array:
    """Return the ten parameters, shape (10,), of a 4x4 pseudo-inertia."""
    second = matrix[:3, :3]
    tensor = np.trace(second) * np.eye(3) - second
    return np.array([matrix[3, 3], *matrix[:3, 3], *six_of(tensor)])


def moved(matrix: Array, transform: Array) -> Array:
    """Return a pseudo-inertia in frame B, given in frame A and the 4x4 transform of A's coordinates to B's."""
    return np.asarray(transform @ matrix @ transform.T)


def inverse(transform: Array) -> Array:
    """Return the inverse of a rigid 4x4 transform."""
    back = np.eye(4)
    back[:3, :3] = transform[:3, :3].T
    back[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return back


def about_centre(parameters: Array) -> tuple[float, Array, Array]:
    """Return (mass, centre of mass (3,), inertia tensor about it (3, 3)) of ten parameters about the origin.

    A body without mass must have no first moment (ValueError): it has no centre that could stand for it.
    """
    mass, first = float(parameters[0]), np.asarray(parameters[1:4], dtype=float)
    if mass == 0:
        if np.any(first != 0):
            raise ValueError("a first moment but no mass")
        return 0.0, np.zeros(3), symmetric(parameters[4:])
    centre = first / mass
    return mass, centre, symmetric(parameters[4:]) - mass * _steiner(centre)


def real_tensor(tensor: Array) -> bool:
    """Return whether an inertia tensor about the centre (3, 3) is that of a real body: A > 0 and A + B >= C."""
    a, b, c = np.linalg.eigvalsh(tensor)
    return bool(a > 0 and a + b >= (1 - ROUNDING) * c)


def about_origin(mass: float, centre: Array, tensor: Array) -> Array:
    """Return the ten parameters about the origin of a mass, its centre (3,) and its tensor about that (3, 3)."""
    moment = tensor + mass * _steiner(centre)
    return np.array([mass, *(mass * centre), *six_of(moment)])


def _steiner(r: Array) -> Array:
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
