"""Spline collocation: unknown trajectory and parameters together, by maximum likelihood.

Minimised over spline coefficients c of all channels, linear parameters p and shapes z of declared effects:

    sum ((y - B c) / sigma)^2 + sum ((Y(c; z) p - [0; u]) / rho)^2

Sensor noise is where it belongs, in the positions, so no bias is left. The equations of motion enter as link and
motor rows with fixed rho: a rho estimated from the link rows' own residual would drive every parameter to zero.
This module states the problem; `bordered` solves its linear systems, `gauss_newton` runs the iteration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elid_cli._types import Array
from elid_cli.signals.splines import DEGREE, ORDER, basis

HUBER = 3.0
"""Residual in standard deviations beyond which an equation counts less."""
_STEPS = (1e-6, 1e-6, 1e-4)
"""Relative steps of differences in position, velocity and acceleration."""
_CHUNK = 3000
"""Collocation points whose Jacobian is held at a time."""


@dataclass(frozen=True)
class CollocationSegment:
    """One segment of the log.

    `measured` and `weight` are (channels, intervals, stride): samples and one over their noise (0: missing);
    `torque` is (rows, intervals, points): right-hand side at the collocation points; `mask` scales rows there.
    """

    measured: Array
    weight: Array
    torque: Array
    mask: Array
    start: Array
    """Coefficients to start from, (intervals + 5, channels)."""
    rate: Array
    """Rate of the right-hand side, N·m/s (N/s), (rows, instants); 0 where its delay is no unknown."""

    @property
    def intervals(self) -> int:
        """Number of knot intervals."""
        return int(self.measured.shape[1])


@dataclass(frozen=True)
class States:
    """Values and two derivatives of every channel at collocation points, (3, channels, instants)."""

    values: Array
    piece: int
    first: int
    """First instant within the piece."""


class CollocationEquations(Protocol):
    """What the robot contributes: the model's torques in link and motor rows, and their derivatives."""

    def residual(self, states: States, p: Array, z: Array) -> Array:
        """Return the torques, (rows, instants)."""

    def columns(self, states: States, z: Array) -> Array:
        """Return the columns of p, (rows, parameters, instants)."""

    def slopes(self, states: States, p: Array, z: Array, steps: Array) -> Array:
        """Return derivatives by the states, by differences of `steps` (3, channels): (3, rows, channels, instants)."""

    def shape_slopes(self, states: States, p: Array, z: Array) -> Array:
        """Return derivatives by z, (rows, shapes, instants)."""

    def trust(self, states: States) -> Array:
        """Return the weight of every row, (rows, instants): small where a motor reverses or sticks."""


Further = Callable[[States], Array]
"""Columns of terms that are not in the model, (rows, columns, instants), at given states."""


@dataclass(frozen=True)
class Setting:
    """Knots, points and noise."""

    dt: float
    stride: int
    points: int
    """Collocation points per knot interval."""
    scale: Array
    """Size of each derivative of each channel for finite differences, (3, channels)."""

    @property
    def width(self) -> float:
        """Knot spacing, s."""
        return self.stride * self.dt

    def at_points(self) -> Array:
        """Return basis weights at the collocation points, (3, points, 6)."""
        every = self.stride // self.points
        u = (np.arange(self.points) * every + 0.5 * (every - 1)) / self.stride
        return np.array([basis(u, d) / self.width**d for d in range(3)])

    def at_samples(self) -> Array:
        """Return basis weights at the samples, (stride, 6)."""
        return basis(np.arange(self.stride) / self.stride)


@dataclass
class Iterate:
    """The unknowns."""

    coefficients: list[Array]
    p: Array
    z: Array


def coefficients_to_states(setting: Setting, coefficients: Array) -> Array:
    """Return states at the collocation points, (3, channels, intervals * points)."""
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER, axis=0)
    weights = setting.at_points()
    values = np.einsum("jcl,dpl->dcjp", windows, weights, optimize=True)
    return np.ascontiguousarray(values.reshape(3, coefficients.shape[1], -1))


class Problem:
    """A collocation problem: pieces of a log, the robot's equations, noise."""

    def __init__(
        self, setting: Setting, pieces: Sequence[CollocationSegment], equations: CollocationEquations, rho: Array
    ) -> None:
        self.setting = setting
        self.pieces = tuple(pieces)
        self.equations = equations
        self.rho = rho
        self.followed = np.ones(len(rho))
        """Part of each row's assumed noise that is the sensors', the rest being assumed for what knots are too free to
        leave in the residual, (rows,)."""
        self._trust = [np.ones((len(rho), p.intervals * setting.points)) for p in self.pieces]
        self._weights = setting.at_points()
        self.samples = setting.at_samples()

    def trust(self, *now: Iterate) -> None:
        """Decide anew where motors reverse, from the trajectory as it is now; of several, where any does."""
        for number in range(len(self.pieces)):
            states = (States(coefficients_to_states(self.setting, n.coefficients[number]), number, 0) for n in now)
            self._trust[number] = np.minimum.reduce([self.equations.trust(each) for each in states])

    def _mask(self, number: int) -> Array:
        mask: Array = self.pieces[number].mask.reshape(len(self.rho), -1) * self._trust[number]
        return mask

    def cost(self, now: Iterate) -> float:
        """Return the Huber cost."""
        return float(sum(part.sum() for part in self.costs(now)))

    def costs(self, now: Iterate) -> list[Array]:
        """Return the Huber cost of every knot interval, (intervals,) of each piece."""
        found = []
        for number, piece in enumerate(self.pieces):
            misfit = self.misfit(piece, now.coefficients[number])
            scaled = np.abs(self._residual(number, now)) / self.rho[:, None] * self._mask(number)
            huber = np.where(scaled < HUBER, scaled**2, 2 * HUBER * scaled - HUBER**2)
            found.append(
                np.einsum("cjs,cjs->j", misfit, misfit)
                + huber.reshape(len(huber), piece.intervals, -1).sum(axis=(0, 2))
            )
        return found

    def deviance(self, now: Iterate, least: Array) -> float:
        """Return minus twice the logarithm of the likelihood, the equations' noise as their residual shows it.

        It is no smaller than `least` (rows,). An additive constant is left out.
        """
        held, self.rho = self.rho, np.maximum(least, self.spread(now))
        counted = sum(self._mask(number).sum(axis=1) for number in range(len(self.pieces)))
        total = self.cost(now) + 2.0 * float(counted @ np.log(self.rho / least))
        self.rho = held
        return total

    def spread(self, now: Iterate) -> Array:
        """Return a robust standard deviation of every row's residual where it counts, (rows,)."""
        parts: list[list[Array]] = [[] for _ in self.rho]
        for number in range(len(self.pieces)):
            residual = self._residual(number, now)
            mask = self._mask(number)
            for r in range(len(self.rho)):
                parts[r].append(residual[r][mask[r] > 0.5])
        counted = [np.concatenate(p) if p else np.zeros(0) for p in parts]
        return np.array([1.4826 * float(np.median(np.abs(c))) if c.size else 0.0 for c in counted])

    def misfit(self, piece: CollocationSegment, coefficients: Array) -> Array:
        """Return measured minus fitted positions over their noise, (channels, intervals, stride)."""
        windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER, axis=0)
        fitted = np.einsum("jcl,sl->cjs", windows, self.samples, optimize=True)
        misfit: Array = np.where(piece.weight > 0, piece.measured - fitted, 0.0) * piece.weight
        return misfit

    def _residual(self, number: int, now: Iterate) -> Array:
        piece = self.pieces[number]
        states = States(coefficients_to_states(self.setting, now.coefficients[number]), number, 0)
        residual: Array = self.equations.residual(states, now.p, now.z) - piece.torque.reshape(len(self.rho), -1)
        return residual

    def parts(self, piece: CollocationSegment) -> list[slice]:
        """Return the stretches of knot intervals that are linearised at a time."""
        size = max(1, _CHUNK // self.setting.points)
        return [slice(a, min(a + size, piece.intervals)) for a in range(0, piece.intervals, size)]

    def linearised(
        self, number: int, now: Iterate, part: slice, further: Further | None = None, *, held: bool = False
    ) -> tuple[Array, Array, Array]:
        """Return (d residual / d coefficients, d residual / d (p, z), residual), all weighted, interval by interval.

        Shapes (J, rows * points, 6 * channels), (J, rows * points, p + z), (J, rows * points). Columns of `further`
        terms follow those of p and z; no columns where these are `held`.
        """
        setting, piece, rows = self.setting, self.pieces[number], len(self.rho)
        coefficients = now.coefficients[number][part.start : part.stop + DEGREE]
        count = part.stop - part.start
        values = coefficients_to_states(setting, coefficients)
        here = States(values, number, part.start * setting.points)
        channels = values.shape[1]
        residual = self.equations.residual(here, now.p, now.z)
        torque = piece.torque[:, part].reshape(rows, -1)
        mask = self._mask(number)[:, part.start * setting.points : part.stop * setting.points]
        error = residual - torque
        scaled = np.abs(error) * mask / self.rho[:, None]
        weight = mask / self.rho[:, None] * np.where(scaled > HUBER, np.sqrt(HUBER / np.maximum(scaled, 1e-300)), 1.0)
        steps = np.array(_STEPS)[:, None] * setting.scale
        slopes = self.equations.slopes(here, now.p, now.z, steps)
        shaped = (slopes * weight[None, :, None]).reshape(3, rows, channels, count, setting.points)
        G = np.einsum("drcjp,dpl->jrplc", shaped, self._weights, optimize=True)
        columns = np.zeros((rows, 0, error.shape[1])) if held else self.equations.columns(here, now.z)
        if len(now.z) and not held:
            columns = np.concatenate([columns, self.equations.shape_slopes(here, now.p, now.z)], axis=1)
        if further is not None:
            columns = np.concatenate([columns, further(here)], axis=1)
        P = (columns * weight[:, None]).reshape(rows, columns.shape[1], count, setting.points).transpose(2, 0, 3, 1)
        r = (error * weight).reshape(rows, count, setting.points).transpose(1, 0, 2)
        return (
            G.reshape(count, rows * setting.points, ORDER * channels),
            P.reshape(count, rows * setting.points, columns.shape[1]),
            r.reshape(count, -1),
        )
