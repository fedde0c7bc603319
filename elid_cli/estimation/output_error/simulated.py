"""Windows simulated under their torques: errors and what they change with, as Gram matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.output_error.equations import MotionEquations
from elid_cli.estimation.output_error.march import Steps, march
from elid_cli.estimation.output_error.windows import Windows

BATCH = 64 << 20
"""Bytes of sensitivities that are held at a time."""


@dataclass(frozen=True)
class Unknowns:
    """Places in one vector z (C,): base parameters, an offset of every joint's torque, one delay of all."""

    equations: MotionEquations

    @property
    def base(self) -> int:
        """Number of base parameters."""
        return self.equations.base.count

    @property
    def offsets(self) -> slice:
        """Place of the offsets, N·m (N): logged torque minus what acts."""
        return slice(self.base, self.base + self.equations.robot.n)

    @property
    def delay(self) -> int:
        """Place of the delay, s, by which the torques act later than logged."""
        return self.base + self.equations.robot.n

    @property
    def count(self) -> int:
        """Number of unknowns C."""
        return self.delay + 1

    def possible(self, z: Array) -> Array:
        """Return unknowns without Coulomb friction that drives, (C,)."""
        found, dry = z.copy(), self.equations.coulomb[self.equations.coulomb >= 0]
        found[dry] = np.maximum(found[dry], 0.0)
        return found


@dataclass(frozen=True)
class Simulated:
    """S windows simulated with unknowns and states at their starts, linear about a motion that is near."""

    z: Array
    """(C,)."""
    start: Array
    """Positions and velocities, (S, 2m)."""
    x: Array
    """The motion, rad (m), (K + 1, S, m)."""
    v: Array
    gram: Array
    """Gram matrices of [unknowns, states, error], weighted, by piece of time, (S, P, C + 2m + 1, C + 2m + 1)."""
    squares: Array
    """Squared errors of every coordinate, (S, m)."""
    counts: Array
    """Their number, (S, m)."""

    @property
    def costs(self) -> Array:
        """Weighted squared error of every window, (S,)."""
        return np.asarray(self.gram[:, :, -1, -1].sum(axis=1))

    @property
    def rms(self) -> Array:
        """Rms error of every coordinate, rad (m), (m,)."""
        return np.asarray(np.sqrt(self.squares.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1.0)))

    def with_windows(self, use: NDArray[np.bool_], other: Simulated) -> Simulated:
        """Return the windows with those marked in `use`, (S,), from another simulation of only these."""
        start, x, v, gram, squares, counts = (
            part.copy() for part in (self.start, self.x, self.v, self.gram, self.squares, self.counts)
        )
        start[use], gram[use], squares[use], counts[use] = other.start, other.gram, other.squares, other.counts
        x[:, use], v[:, use] = other.x, other.v
        return Simulated(self.z, start, x, v, gram, squares, counts)

    def of(self, use: NDArray[np.bool_]) -> Simulated:
        """Return some of the windows."""
        return replace(self, start=self.start[use], x=self.x[:, use], v=self.v[:, use], gram=self.gram[use],
                       squares=self.squares[use], counts=self.counts[use])  # fmt: skip


def simulate(
    own: Unknowns, windows: Windows, z: Array, start: Array, about: tuple[Array, Array], weights: Array
) -> Simulated:
    """Simulate windows once.

    Parameters
    ----------
    own, windows
        What is unknown, and S windows.
    z, start
        Unknowns (C,), and the windows' states at their starts, (S, 2m).
    about
        Motion that the equations are linear about, (K + 1, S, m).
    weights
        Of every coordinate's error, 1/rad (1/m), (m,).
    """
    m, c, pieces = about[0].shape[2], own.count, windows.pieces
    batch = max(1, BATCH // (windows.length * windows.each * m * (4 * c + 6 * m) * 8))
    gram = np.zeros((windows.count, pieces, c + 2 * m + 1, c + 2 * m + 1))
    squares, counts = np.zeros((2, windows.count, m))
    xs, vs = np.empty((2, *about[0].shape))
    edges = np.linspace(0, windows.length + 1, pieces + 1).astype(int)
    for first in range(0, windows.count, batch):
        part = slice(first, first + batch)
        steps = _steps(own, windows, z, (about[0][:, part], about[1][:, part]), part)
        with np.errstate(over="ignore", invalid="ignore"):
            x, v, dx = march(steps, start[part, :m], start[part, m:], windows.each)
            xs[:, part], vs[:, part] = x, v
            error = x[:: windows.each] - windows.seen[:, part]
            missing = np.isnan(windows.seen[:, part])
            error[missing] = 0.0
            squares[part], counts[part] = np.sum(error**2, axis=0), np.sum(~missing, axis=0)
            whole = np.concatenate([dx, error[..., None]], axis=-1) * np.where(missing, 0.0, weights)[..., None]
            whole = np.moveaxis(whole, 1, 0)
            for p in range(pieces):
                flat = whole[:, edges[p] : edges[p + 1]].reshape(len(whole), -1, whole.shape[-1])
                gram[part, p] = np.swapaxes(flat, 1, 2) @ flat
    return Simulated(z, start, xs, vs, gram, squares, counts)


def _steps(own: Unknowns, windows: Windows, z: Array, about: tuple[Array, Array], part: slice) -> Steps:
    equations, n, h = own.equations, own.equations.robot.n, windows.h
    (x, v), m = about, about[0].shape[2]
    shape = (len(x) - 1, x.shape[1])
    middle = (0.5 * (x[1:] + x[:-1]), 0.5 * (v[1:] + v[:-1]), np.diff(v, axis=0) / h)
    values, dry = z[: own.base], equations.coulomb
    at, speed, change = (value.reshape(-1, m) for value in middle)
    along = equations.about(at, speed, change, values)
    columns = np.zeros((*shape, m, own.count))
    columns[..., : own.base] = along.columns.reshape(*shape, m, own.base)
    motors = equations.coordinates.motors
    columns[:, :, motors, np.arange(own.offsets.start, own.offsets.stop)] = 1.0
    columns[:, :, motors, own.delay] = windows.rate[:, part]
    drive = -along.rest.reshape(*shape, m)
    drive[:, :, motors] += windows.told[:, part] - z[own.delay] * windows.rate[:, part] - z[own.offsets]
    grip = np.broadcast_to(np.where(dry >= 0, np.maximum(values[dry], 0.0), 0.0), (*shape, n))
    grips = np.zeros((1, 1, n, own.count))
    grips[0, 0, dry >= 0, dry[dry >= 0]] = 1.0
    mass, damping, slope = (part.reshape(*shape, m, m) for part in (along.mass, along.damping, along.slope))
    return Steps(mass, damping, slope, drive, columns, grip, grips, motors, h)
