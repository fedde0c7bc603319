"""What a physical robot's parameters must satisfy, as cones: the condition that a model can be simulated.

Per body the 4x4 pseudo-inertia of its own link is positive semidefinite (Wensing, Kim, Slotine, arXiv 1701.04395;
positive mass and the triangle inequality follow); rotor inertias and stiffnesses are positive, friction is not
negative. In this model body i-1 contains rotor i, so its link is what remains without the rotor's thin disc
``diag(Jm/2, Jm/2, Jm)``; asking that of the remainder makes the mass matrix of links and motors together positive
definite: kinetic energy is then a sum of squares of real bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.robot.inertia import inertial_parameters, pseudo_inertia
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Joint, Robot

MARGIN = 1e-6
"""Smallest scaled eigenvalue, rotor inertia and stiffness that count as positive."""
DENSITY = 20.0
"""Mass, kg per m of the mean distance between joints, of a body about which nothing is known."""
SLENDER = 16.0
"""A body about which nothing is known is a sphere of second moments m·L²/16 per axis."""
GRAVITY = 9.81
RESONANCE = 2 * np.pi * 10
"""Angular frequency, rad/s, at which a body swings on a spring about which nothing is known."""
FRICTION = 0.05
"""Friction about which nothing is known, at standstill and per rad/s, as a share of the weight's torque."""
_UPPER = tuple((r, c) for c in range(4) for r in range(c + 1))


@dataclass(frozen=True)
class Scales:
    """Typical size of every standard parameter, (p,), so that unlike units can be compared."""

    length: float
    masses: Array
    sizes: Array


@dataclass(frozen=True)
class Consistency:
    """The cones of a robot over its standard parameters, in scaled units ``y = x / sizes``."""

    robot: Robot
    scales: Scales
    links: Array
    """Link pseudo-inertia of every body as a linear map of y, (n, 4, 4, p); dimensionless."""
    positive: NDArray[np.intp]
    """Parameters that must be positive: Jm, Ja, K."""
    nonnegative: NDArray[np.intp]
    """Parameters that must not be negative: fs, fv."""

    def eigenvalues(self, y: Array) -> Array:
        """Return the smallest eigenvalue of every link's scaled pseudo-inertia, (n,)."""
        return np.array(np.linalg.eigvalsh(self.links @ y)[:, 0])

    def slack(self, y: Array) -> float:
        """Return by how much the tightest condition is met; negative where one is broken (0 at friction 0)."""
        strict = np.concatenate([self.eigenvalues(y), y[self.positive]])
        return float(min(strict.min() - MARGIN, y[self.nonnegative].min(initial=np.inf)))

    def interior(self, y: Array) -> Array:
        """Return parameters well inside the cones whose rotors, springs and friction are about those of `y`."""
        inside = np.abs(y)
        inside[self.positive] = np.maximum(inside[self.positive], 0.1)
        inside[self.nonnegative] = np.maximum(inside[self.nonnegative], 0.1)
        names = self.robot.parameter_names()
        for i in range(1, self.robot.n + 1):
            index = [names.index(StandardParameter(kind, i - 1)) for kind in LINK_PARAMETERS]
            inside[index] = 0.0
            rotor = self.links[i - 1] @ inside
            body = np.diag([1 / SLENDER] * 3 + [1.0]) - rotor * np.diag([1.0, 1, 1, 0])
            size = np.array([self.scales.masses[i - 1] * self.scales.length**k for k in (2, 2, 2, 0)])
            inside[index] = inertial_parameters(np.sqrt(np.outer(size, size)) * body) / self.scales.sizes[index]
        return inside

    def positive_only(self, functional: Array) -> bool:
        """Return whether a combination ``functional @ x`` (p,) is positive for every physical robot.

        That is so when it lies in the dual cone: a positive semidefinite matrix per body, no negative scalar.
        """
        names = self.robot.parameter_names()
        scalars = functional * self.scales.sizes
        dual = np.zeros_like(self.links[..., 0])
        used = np.zeros(len(names), dtype=bool)
        for i in range(1, self.robot.n + 1):
            index = [names.index(StandardParameter(kind, i - 1)) for kind in LINK_PARAMETERS]
            used[index] = True
            dual[i - 1] = _gradient(self.links[i - 1][..., index], scalars[index])
        # x = link + rotor: a rotor adds its disc to the body it rides on, so it pays through that body's matrix
        rest = scalars - np.einsum("iab,iabk->k", dual, self.links)
        least = np.linalg.eigvalsh(dual)[:, 0]
        size = max(float(np.abs(scalars).max()), 1e-300)
        return bool(np.all(least > -1e-9 * size) and np.all(rest[~used] > -1e-9 * size) and np.any(scalars))


def _gradient(link: Array, scalars: Array) -> Array:
    """Return the symmetric matrix C (4, 4) with <C, J(y)> = scalars @ y for the ten parameters y of one body."""
    basis = np.array([link[r, c] * (1.0 if r == c else 2.0) for r, c in _UPPER])
    entries = np.linalg.solve(basis.T, scalars)
    matrix = np.zeros((4, 4))
    for (r, c), value in zip(_UPPER, entries, strict=True):
        matrix[r, c] = matrix[c, r] = value
    return matrix


def consistency(robot: Robot, estimate: Array) -> Consistency:
    """Return the cones of a robot.

    Parameters
    ----------
    robot
        Its reference values set the scales.
    estimate
        Standard parameters (p,) that give the scale where the robot file knows none; NaN and 0 where unknown.

    """
    names = robot.parameter_names()
    scales = _scales(robot, estimate)
    links = np.zeros((robot.n, 4, 4, len(names)))
    length = np.array([scales.length] * 3 + [1.0])
    for i, joint in enumerate(robot.joints, start=1):
        unit = np.outer(length, length) * scales.masses[i - 1]
        for k, kind in enumerate(LINK_PARAMETERS):
            place = names.index(StandardParameter(kind, i - 1))
            links[i - 1, :, :, place] = pseudo_inertia(np.eye(10)[k]) * scales.sizes[place] / unit
        carrier = robot.parents[i - 1]
        if carrier >= 0 and joint.gear_ratio is not None:
            z = np.asarray(joint.motor_axis, dtype=float)
            place = names.index(StandardParameter("Jm", i - 1))
            before = np.outer(length, length) * scales.masses[carrier]
            disc = (np.eye(3) - np.outer(z, z)) / 2 * scales.sizes[place]
            links[carrier, :3, :3, place] = -disc / before[:3, :3]
    positive = [k for k, name in enumerate(names) if name.kind in ("Jm", "Ja", "K")]
    friction = [k for k, name in enumerate(names) if name.kind in ("fs", "fv")]
    return Consistency(robot, scales, links, np.array(positive, dtype=np.intp), np.array(friction, dtype=np.intp))


def prior(robot: Robot, scales: Scales) -> Array:
    """Return reference values, (p,), with a sphere's, and typical sizes', where the robot file knows none."""
    values = robot.reference()
    for k, name in enumerate(robot.parameter_names()):
        if not np.isnan(values[k]):
            continue
        kind = name.kind
        if kind == "m" or kind not in LINK_PARAMETERS:
            values[k] = scales.sizes[k]
        elif kind in ("Ixx", "Iyy", "Izz"):
            values[k] = 2 * scales.sizes[k] / SLENDER
        else:
            values[k] = 0.0
    return values


def _scales(robot: Robot, estimate: Array) -> Scales:
    names = robot.parameter_names()
    steps = [float(np.linalg.norm((before @ after)[:3, 3])) for before, after in robot.placements()]
    length = max(float(np.mean(steps)), 0.05)
    reference = robot.reference()
    known = dict(zip(names, np.nan_to_num(reference).tolist(), strict=True))
    masses = np.zeros(robot.n)
    for i in range(1, robot.n + 1):
        ten = np.array([known[StandardParameter(kind, i - 1)] for kind in LINK_PARAMETERS])
        second = 0.5 * float(np.abs(ten[4:7]).sum())
        masses[i - 1] = max(abs(ten[0]), float(np.abs(ten[1:4]).max()) / length, second / length**2)
    masses[masses == 0] = DENSITY * length
    masses = np.maximum(masses, 1e-3 * masses.max())
    sizes = np.ones(len(names))
    for k, name in enumerate(names):
        kind, body = name.kind, name.joint
        moved = [k for k, own in enumerate(robot.ancestors) if body in own]
        load = float(masses[moved].sum()), length if robot.joints[body].revolute else 1.0
        if kind in LINK_PARAMETERS:
            sizes[k] = masses[body] * length ** {"m": 0, "c": 1, "I": 2}[kind[0]]
        else:
            sizes[k] = _scalar_size(kind, names, reference, estimate, k) or _typical(kind, robot.joints[body], load)
    return Scales(length, masses, sizes)


def _scalar_size(kind: str, names: tuple[StandardParameter, ...], reference: Array, estimate: Array, k: int) -> float:
    """Return the size of a Jm, Ja, fs, fv or K: its reference, else its estimate, else those of its kind, else 0."""
    for value in (reference[k], estimate[k]):
        if np.isfinite(value) and value != 0:
            return abs(float(value))
    same = [j for j, name in enumerate(names) if name.kind == kind]
    others = np.abs(np.concatenate([reference[same], estimate[same]]))
    others = others[np.isfinite(others) & (others > 0)]
    return float(np.median(others)) if others.size else 0.0


def _typical(kind: str, joint: Joint, load: tuple[float, float]) -> float:
    """Return a usual Jm, Ja, fs, fv or K of a joint that carries a mass at an arm, (kg, m): its inertia matched."""
    mass, arm = load
    inertia = mass * arm**2
    if kind in ("Jm", "Ja"):
        return inertia / (joint.gear_ratio or 1.0) ** 2
    return inertia * RESONANCE**2 if kind == "K" else FRICTION * GRAVITY * mass * arm
