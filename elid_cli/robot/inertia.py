"""Inertial parameters of a body as its 4x4 pseudo-inertia, which moves between frames and adds like a matrix.

``J = [[S, c], [c', m]]`` with ``S = tr(I)/2·E - I``, ``c`` the first moment (kg·m) and ``I`` the inertia tensor about
the frame's origin (kg·m²). With ``T`` the 4x4 transform that takes coordinates of frame A to frame B,
``J_B = T J_A T'`` (Wensing, Kim, Slotine, "Linear matrix inequalities for physically consistent inertial parameter
identification", 2018). Parameters are in the order of `robot.LINK_PARAMETERS`.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array

ROUNDING = 1e-9
"""Relative error of moments of inertia that were computed from sums of others."""


def pseudo_inertia(parameters: Array) -> Array:
    """Return the 4x4 pseudo-inertia of ten parameters (m, c, I about the origin), shape (10,)."""
    m, cx, cy, cz, xx, yy, zz, xy, xz, yz = (float(value) for value in parameters)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    matrix[:3, 3] = matrix[3, :3] = (cx, cy, cz)
    matrix[3, 3] = m
    return matrix


def inertial_parameters(matrix: Array) -> Array:
    """Return the ten parameters, shape (10,), of a 4x4 pseudo-inertia."""
    second = matrix[:3, :3]
    tensor = np.trace(second) * np.eye(3) - second
    xy, xz, yz = tensor[0, 1], tensor[0, 2], tensor[1, 2]
    return np.array([matrix[3, 3], *matrix[:3, 3], *np.diag(tensor), xy, xz, yz])


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
        return 0.0, np.zeros(3), _tensor(parameters)
    centre = first / mass
    return mass, centre, _tensor(parameters) - mass * _steiner(centre)


def real_tensor(tensor: Array) -> bool:
    """Return whether an inertia tensor about the centre (3, 3) is that of a real body: A > 0 and A + B >= C."""
    a, b, c = np.linalg.eigvalsh(tensor)
    return bool(a > 0 and a + b >= (1 - ROUNDING) * c)


def about_origin(mass: float, centre: Array, tensor: Array) -> Array:
    """Return the ten parameters about the origin of a mass, its centre (3,) and its tensor about that (3, 3)."""
    moment = tensor + mass * _steiner(centre)
    xy, xz, yz = moment[0, 1], moment[0, 2], moment[1, 2]
    return np.array([mass, *(mass * centre), *np.diag(moment), xy, xz, yz])


def _steiner(r: Array) -> Array:
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))


def _tensor(parameters: Array) -> Array:
    xx, yy, zz, xy, xz, yz = (float(value) for value in parameters[4:])
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
