"""Motion of a described robot under drives, many variants and stretches side by side.

The equations of motion are linearised about a motion that is near (the measured one, then the simulated one, until
both agree), which is vectorised over time; what is left is a short recursion in time, vectorised over variants. Its
steps are those of the trapezoidal rule, of second order and stable however stiff a spring is. Coulomb friction holds a
joint at rest: it is the torque, at most `fs` in size, that brings the velocity at the step's end nearest to zero
(projected Gauss-Seidel over the joints that couple).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.coordinates import chains_of, coordinates_of, side_by_side
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import inputs_of
from elid_cli.model.rollout_loops import SWEEPS, compiled_steps
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

STEP = 1.1e-3
"""Longest step, s: 1 ms at the usual rates."""
ROUNDS = 12
"""Times that the equations are linearised about the motion that came out."""
SETTLED = 2e-6
"""Change of the motion, rad (m), below which it is the one that the equations were linearised about."""
FASTEST = 1e3
"""Largest velocity, rad/s (m/s), about which equations are linearised: beyond, the motion runs away."""
SLIGHT = 1e-5
"""Change of position, rad (m), for the slope of the torques."""


@dataclass(frozen=True)
class Local:
    """Equations of motion about a motion at N instants of S stretches: mass·v' + force + slope·(x - place) = drive.

    Those of L chains of s coordinates have two axes, L and s, for m.
    """

    mass: Array
    """kg·m² (kg), (N, S, m, m)."""
    force: Array
    """Gravity, centrifugal terms and springs, N·m (N), (N, S, m)."""
    slope: Array
    """Its change with position, N·m/rad, (N, S, m, m)."""
    place: Array
    """Motion linearised about, rad (m), (N, S, m)."""


@dataclass(frozen=True)
class Drives:
    """What acts on the motors of S stretches in K steps: ``clip(told - kp x - kd x') - offset``, at most `limit`."""

    told: Array
    """kp q_des + kd dq_des + tau_ff of every step, N·m (N), (K, S, n)."""
    kp: Array
    """Gains, N·m/rad and N·m·s/rad, (S, n); 0 where a torque is given."""
    kd: Array
    limit: Array
    """Torque limits, N·m (N), (n,); infinite where there is none."""


@dataclass(frozen=True)
class Joints:
    """Drive parameters of V variants of a robot, (V, n), SI at the joint."""

    inertia: Array
    """Inertia of the rotor beyond what the equations hold, kg·m² (kg)."""
    coulomb: Array
    viscous: Array
    offset: Array
    """Torque that the drives lack, N·m (N)."""
    push: Array | None = None
    """Torque of effects on every coordinate between one instant and the next, on the model's side, N·m (N),
    (N - 1, V, S, m)."""
    grip: Array | None = None
    """Coulomb friction beyond `coulomb` between one instant and the next, N·m (N), (N - 1, V, S, m)."""
    damping: Array | None = None
    """Viscous friction of every coordinate beyond `viscous`, N·m·s/rad, (m,), the same of all variants."""


class Linearised:
    """The equations of motion of a robot without its drives' friction.

    Parameters
    ----------
    robot
        Its parameters must be known, but for drive parameters that `without` takes out.
    without
        Kinds of drive parameters that count as 0: friction always does, `Ja` where it is a variant's.

    Raises
    ------
    RobotError
        Parameters that the motion depends on are unknown.
    """

    def __init__(self, robot: Robot, without: tuple[str, ...] = ("fs", "fv")) -> None:
        values = robot.reference().copy()
        values[[name.kind in without for name in robot.parameter_names()]] = 0.0
        dynamics = Dynamics(robot, values)
        self._program = dynamics.inverse_program
        self.robot = robot
        self.coordinates = coordinates_of(robot)
        self._chain = chains_of(robot)

    def about(self, x: Array, v: Array) -> Local:
        """Return the equations about a motion x (N, S, m) with velocities v."""
        count = x.shape[2]
        flat, speed = x.reshape(-1, count), v.reshape(-1, count)
        still, none = np.zeros_like(flat), np.zeros_like(flat)
        force = self._torques(flat, speed, none)
        rest = self._torques(flat, still, none)
        mass, slope = np.empty((2, *flat.shape, count))
        for moved in side_by_side(self._chain):
            unit = np.zeros_like(flat)
            unit[:, moved] = 1.0
            pulled = self._torques(flat, still, unit) - rest
            bent = (self._torques(flat + SLIGHT * unit, still, none) - rest) / SLIGHT
            for k in moved:
                own = self._chain == self._chain[k]
                mass[:, :, k], slope[:, :, k] = np.where(own, pulled, 0.0), np.where(own, bent, 0.0)
        return Local(mass.reshape(*x.shape, count), force.reshape(x.shape), slope.reshape(*x.shape, count), x)

    def _torques(self, x: Array, v: Array, a: Array) -> Array:
        """Return the torque on every coordinate, (N, m)."""
        n, own = self.robot.n, self.coordinates.motors
        motion = Motion(np.zeros(len(x)), x[:, :n], v[:, :n], a[:, :n], x[:, own], v[:, own], a[:, own])
        inputs = inputs_of(motion)
        inputs[7::9] = 0.0
        out = np.empty((2 * n, len(x)))
        self._program.run(inputs, out)
        found = np.zeros((len(x), self.coordinates.count))
        found[:, :n] = out[:n].T
        found[:, own] += out[n:].T
        return found


@dataclass(frozen=True)
class Added:
    """What effects add along a motion: `Joints.push` and `Joints.grip`, and how the push changes about that motion."""

    push: Array
    grip: Array
    stiffness: Array
    """Usual change of the push with the position of its coordinate, N·m/rad, (m,); at least 0."""
    damping: Array
    """The same with velocity, N·m·s/rad, (m,)."""


Along = Callable[[Local, Array, Array], Added]
"""What effects add along a motion x, v (N, S, m) about which equations are."""


def motion_of(
    equations: Linearised,
    start: tuple[Array, Array],
    near: Array,
    drives: Drives,
    joints: Joints,
    dt: float,
    along: Along | None = None,
) -> tuple[Array, Array]:
    """Return positions x and velocities at N instants, (N, S, m), of one robot.

    Parameters
    ----------
    equations, joints
        The robot, and its drives, one variant.
    start
        Positions and velocities that the stretches start from, (S, m).
    near
        A motion to linearise about at first, (N, S, m).
    drives
        What acts.
    dt
        Time between instants, s; the steps of `drives` divide it.
    along
        What effects add, of the motion that they act along; None: there are none.
    """
    x, v = near, np.gradient(near, dt, axis=0)
    for _ in range(ROUNDS):
        local = equations.about(x, v)
        if along is not None:
            # a spring or damper that is stiff beside the masses must act on the motion that comes out, too
            added = along(local, x, v)
            local = replace(local, slope=local.slope + np.diag(added.stiffness))
            push = added.push - (added.damping * 0.5 * (v[1:] + v[:-1]))[:, None]
            joints = replace(joints, push=push, grip=added.grip, damping=added.damping)
        found, speed = variants_of(equations, local, start, drives, joints, dt)
        found, speed = found[:, 0], speed[:, 0]
        wild = np.array(~np.isfinite(found).all(axis=(0, 2)))
        change = np.abs(found - x)[:, ~wild].max(initial=0.0)
        # a stretch that runs away has no motion to linearise about
        x = np.where(wild[:, None], x, np.clip(found, x - 1.0, x + 1.0))
        v = np.where(wild[:, None], v, np.clip(speed, -FASTEST, FASTEST))
        if change < SETTLED:
            break
    return found, speed


def variants_of(
    equations: Linearised, local: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float
) -> tuple[Array, Array]:
    """Return positions and velocities at N instants, (N, V, S, m), of V variants by equations that are linear.

    As `motion_of`; joints that do not couple are taken apart.
    """
    instants, stretches, count = local.force.shape
    variants = joints.coulomb.shape[0]
    positions = np.empty((instants, variants, stretches, count))
    velocities = np.empty_like(positions)
    places = equations.coordinates.motors
    for group in _coupled(equations.robot):
        coordinates = [np.unique(np.concatenate([chain, places[chain]])) for chain in group]
        taken = np.array(coordinates)  # (L, s)
        motors = np.array([[np.flatnonzero(places == c) for c in row] for row in taken], dtype=object)
        moved = Local(
            local.mass[:, :, taken[:, :, None], taken[:, None]],
            local.force[:, :, taken],
            local.slope[:, :, taken[:, :, None], taken[:, None]],
            local.place[:, :, taken],
        )
        owner = np.array([[int(own[0]) if len(own) else -1 for own in row] for row in motors])
        x, v = _advance(
            moved, (start[0][:, taken], start[1][:, taken]), _on(drives, owner), _of(joints, owner, taken), dt
        )
        positions[..., taken.ravel()] = x.reshape(*x.shape[:3], -1)
        velocities[..., taken.ravel()] = v.reshape(*v.shape[:3], -1)
    return positions, velocities


def _on(drives: Drives, owner: NDArray[np.intp]) -> Drives:
    """Return what acts on the coordinates of chains; nothing on links behind a spring."""
    held = owner >= 0
    told, kp, kd = (np.where(held, values[..., owner], 0.0) for values in (drives.told, drives.kp, drives.kd))
    return Drives(told, kp, kd, np.where(held, drives.limit[owner], np.inf))


def _of(joints: Joints, owner: NDArray[np.intp], taken: NDArray[np.intp]) -> Joints:
    """Return the drives of the motors that own coordinates, and what effects do at the coordinates themselves."""
    held = owner >= 0

    def over_time(values: Array | None) -> Array:
        return np.zeros((1, 1, 1, *owner.shape)) if values is None else values[..., taken]

    inertia, coulomb, viscous, offset = (
        np.where(held, values[:, owner], 0.0)[:, None]
        for values in (joints.inertia, joints.coulomb, joints.viscous, joints.offset)
    )
    if joints.damping is not None:
        viscous = viscous + joints.damping[taken]
    return Joints(inertia, coulomb, viscous, offset, over_time(joints.push), over_time(joints.grip))


def _advance(part: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float) -> tuple[Array, Array]:
    """Return positions and velocities (N, V, S, L, s), by compiled loops where Numba is installed."""
    compiled = compiled_steps()
    if compiled is None:
        return advance_arrays(part, start, drives, joints, dt)
    shape = np.broadcast_shapes(joints.coulomb.shape, part.force.shape[1:])
    x, v = np.empty((2, len(part.force), *shape))
    flat = [np.broadcast_to(values, shape) for values in (
        joints.inertia, joints.coulomb, joints.viscous, joints.offset, drives.limit)]  # fmt: skip
    flat += [np.broadcast_to(values, (len(values), *shape)) for values in _over_time(joints)]
    arrays = (part.mass, part.force, part.slope, part.place, drives.told, drives.kp, drives.kd, *start)
    # contiguous and writable, as a broadcast view is not: of every other kind of array Numba compiles the loops anew
    compiled(*(np.require(values, requirements=("C", "W")) for values in (*arrays, *flat)), dt, x, v)
    return x, v


def _over_time(joints: Joints) -> tuple[Array, Array]:
    """Return push and grip of every interval; one that stands for all where there are none."""
    none = np.zeros((1, *joints.coulomb.shape))
    return (none if joints.push is None else joints.push, none if joints.grip is None else joints.grip)


def advance_arrays(
    part: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float
) -> tuple[Array, Array]:
    """Return what `_advance` does, vectorised over variants, stretches and chains."""
    instants = len(part.force)
    steps = len(drives.told) // max(instants - 1, 1)
    h, size = dt / steps, part.force.shape[-1]
    diagonal = np.arange(size)
    shape = np.broadcast_shapes(joints.coulomb.shape, part.force.shape[1:])
    x, v = (np.broadcast_to(value, shape).copy() for value in start)
    positions, velocities = np.empty((2, instants, *shape))
    positions[0], velocities[0] = x, v
    held, gained = np.zeros((2, *shape))
    push, grip = (np.broadcast_to(values, (len(values), *shape)) for values in _over_time(joints))
    every, own = np.arange(size), [np.index_exp[..., k] for k in range(size)]
    for k in range(instants - 1):
        bend = 0.5 * (part.slope[k] + part.slope[k + 1])
        mass = np.broadcast_to(0.5 * (part.mass[k] + part.mass[k + 1]), (*shape, size)).copy()
        mass[..., diagonal, diagonal] += joints.inertia
        full = mass + 0.25 * h * h * bend
        full[..., diagonal, diagonal] += 0.5 * h * (joints.viscous + drives.kd) + 0.25 * h * h * drives.kp
        inverse = np.linalg.inv(full)
        give = np.maximum(np.diagonal(inverse, axis1=-2, axis2=-1), 1e-300)
        columns = [inverse[..., :, i] for i in every]
        bound = h * np.maximum(joints.coulomb + grip[k if len(grip) > 1 else 0], 0.0)
        pulled, place = part.force[k] + joints.offset + push[k if len(push) > 1 else 0], part.place[k]
        pull, move = (part.force[k + 1] - part.force[k]) / steps, (part.place[k + 1] - part.place[k]) / steps
        for j in range(steps):
            middle = x + 0.5 * h * v
            drive = drives.told[k * steps + j] - drives.kp * middle - drives.kd * v
            # what a drive gives as the velocity changes is in `inverse`: at its limit it gives none
            given = (0.5 * drives.kd + 0.25 * h * drives.kp) * gained
            drive = np.clip(drive - given, -drives.limit, drives.limit) + given - joints.viscous * v
            drive -= pulled + (j + 0.5) * pull
            drive -= _times(bend, middle - (place + (j + 0.5) * move))
            faster = v + _times(inverse, h * drive - held)
            for _ in range(SWEEPS):
                for i in every:
                    here = own[i]
                    free, slid = faster[here] + give[here] * held[here], np.sign(v[here]) * bound[here]
                    # of one that passes through rest, friction turns when it does
                    end = free - give[here] * slid
                    with np.errstate(divide="ignore", invalid="ignore"):
                        turned = np.where(end * v[here] < 0, slid * (v[here] + end) / (v[here] - end), -slid)
                    still = v[here] == 0
                    low = np.where(still, -bound[here], np.minimum(slid, turned))
                    high = np.where(still, bound[here], np.maximum(slid, turned))
                    now = np.clip(free / give[here], low, high)
                    faster -= columns[i] * (now - held[here])[..., None]
                    held[here] = now
            x = x + 0.5 * h * (v + faster)
            gained, v = faster - v, faster
        positions[k + 1], velocities[k + 1] = x, v
    return positions, velocities


def _times(matrix: Array, vector: Array) -> Array:
    product: Array = (matrix @ vector[..., None])[..., 0]
    return product


def _coupled(robot: Robot) -> list[list[NDArray[np.intp]]]:
    """Return the chains of joints that carry each other or a common joint, those of one length together."""
    roots: dict[int, list[int]] = {}
    for k in range(robot.n):
        roots.setdefault(robot.ancestors[k][0], []).append(k)
    lengths: dict[tuple[bool, ...], list[NDArray[np.intp]]] = {}
    for chain in roots.values():
        kinds = tuple(robot.joints[k].elastic for k in chain)
        lengths.setdefault(kinds, []).append(np.array(chain, dtype=np.intp))
    return list(lengths.values())
