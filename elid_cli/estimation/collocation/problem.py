"""Spline collocation: unknown trajectory and parameters together, by maximum likelihood.

Minimised over spline coefficients c of all channels, linear parameters p and shapes z of declared effects:

    sum ((y - B c) / sigma)^2 + sum ((Y(c; z) p - [0; u]) / rho)^2

Sensor noise is where it belongs, in the positions, so no bias is left. The equations of motion enter as link and
motor rows with fixed rho: a rho estimated from the link rows' own residual would drive every parameter to zero.
This module states the problem; `bordered_banded` solves its linear systems, `gauss_newton` runs the iteration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.signals.splines import DEGREE, ORDER, basis

if TYPE_CHECKING:
    from elid_cli.estimation.collocation.equations import RobotEquations

HUBER = 3.0
"""Residual in standard deviations beyond which an equation counts less."""
_STEPS = (1e-6, 1e-6, 1e-4)
"""Relative steps of differences in position, velocity and acceleration."""
_CHUNK = 3000
"""Collocation points whose Jacobian is held at a time."""
KEPT = 20_000
"""Collocation points of all pieces, times the joints, up to which what is computed at an iterate is kept for the next
question about it: an iteration asks for its cost, its spread and its slopes in turn."""


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

    @cached_property
    def information(self) -> Array:
        """What measured positions say of two coefficients of a channel, that many knots apart, (knots, channels, 6).

        At a knot it is that of it and of the one so many knots further on.
        """
        channels, intervals, stride = self.weight.shape
        weights = basis(np.arange(stride) / stride)
        found = np.zeros((intervals + DEGREE, channels, ORDER))
        for low in range(ORDER):
            for high in range(low, ORDER):
                between = self.weight**2 @ (weights[:, low] * weights[:, high])
                found[low : low + intervals, :, high - low] += between.T
        return found


@dataclass(frozen=True, eq=False)
class States:
    """Values and two derivatives of every channel at collocation points, (3, channels, instants)."""

    values: Array
    piece: int
    first: int
    """First instant within the piece."""
    of: Array | None = None
    """The coefficients, which live as long as the states do."""


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

    @cached_property
    def at_points(self) -> Array:
        """Basis weights at the collocation points, (3, points, 6)."""
        every = self.stride // self.points
        u = (np.arange(self.points) * every + 0.5 * (every - 1)) / self.stride
        return np.array([basis(u, d) / self.width**d for d in range(3)])

    @cached_property
    def at_samples(self) -> Array:
        """Basis weights at the samples, (stride, 6)."""
        return basis(np.arange(self.stride) / self.stride)


@dataclass
class Iterate:
    """The unknowns."""

    coefficients: list[Array]
    p: Array
    z: Array

    def moved(self, size: float, by: Iterate) -> Iterate:
        """Return the unknowns moved by so many times a move."""
        coefficients = [own + size * move for own, move in zip(self.coefficients, by.coefficients, strict=True)]
        return Iterate(coefficients, self.p + size * by.p, self.z + size * by.z)


def coefficients_to_states(setting: Setting, coefficients: Array) -> Array:
    """Return states at the collocation points, (3, channels, intervals * points)."""
    points = setting.at_points
    values = _windows(coefficients) @ points.reshape(-1, ORDER).T
    by_interval = values.reshape(-1, coefficients.shape[1], *points.shape[:2])
    return np.ascontiguousarray(by_interval.transpose(2, 1, 0, 3)).reshape(3, coefficients.shape[1], -1)


def _windows(coefficients: Array) -> Array:
    """Return the coefficients that meet in each knot interval, channel by channel, (J * channels, 6)."""
    return np.lib.stride_tricks.sliding_window_view(coefficients, ORDER, axis=0).reshape(-1, ORDER)


class Problem:
    """A collocation problem: pieces of a log, the robot's equations, noise."""

    def __init__(
        self, setting: Setting, pieces: Sequence[CollocationSegment], equations: RobotEquations, rho: Array
    ) -> None:
        self.setting = setting
        self.pieces = tuple(pieces)
        self.equations = equations
        self.rho = rho
        self.followed = np.ones(len(rho))
        """Part of each row's assumed noise that is the sensors', the rest being assumed for what knots are too free to
        leave in the residual, (rows,)."""
        self._trust = [np.ones((len(rho), p.intervals * setting.points)) for p in self.pieces]
        self._states: Recent[States] = Recent(equations.kept)
        self.samples = setting.at_samples
        own = np.eye(setting.scale.shape[1])
        self._turns = [np.kron(weights, own) for weights in setting.at_points.transpose(1, 0, 2)]
        """What turns slopes by a point's states (3, channels) into those by coefficients (6, channels), per point."""

    def trust(self, *now: Iterate) -> None:
        """Decide anew where motors reverse, from the trajectory as it is now; of several, where any does."""
        for number in range(len(self.pieces)):
            states = (self._whole(number, n.coefficients[number]) for n in now)
            self._trust[number] = np.minimum.reduce([self.equations.trust(each) for each in states])

    @property
    def trusted(self) -> list[Array]:
        """What was decided last of where motors reverse, (rows, instants) per piece: small there."""
        return list(self._trust)

    def _mask(self, number: int) -> Array:
        return np.asarray(self.pieces[number].mask.reshape(len(self.rho), -1) * self._trust[number])

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
        fitted = _windows(coefficients) @ self.samples.T
        fitted = fitted.reshape(-1, coefficients.shape[1], len(self.samples)).swapaxes(0, 1)
        return np.asarray(np.where(piece.weight > 0, piece.measured - fitted, 0.0) * piece.weight)

    def _whole(self, number: int, coefficients: Array) -> States:
        """Return the states of a whole piece, the same object for the same coefficients as long as it is kept."""

        def made() -> States:
            return States(coefficients_to_states(self.setting, coefficients), number, 0, coefficients)

        return self._states.of(id(coefficients), made)

    def _residual(self, number: int, now: Iterate) -> Array:
        piece = self.pieces[number]
        states = self._whole(number, now.coefficients[number])
        return np.asarray(self.equations.residual(states, now.p, now.z) - piece.torque.reshape(len(self.rho), -1))

    def parts(self, piece: CollocationSegment) -> list[slice]:
        """Return the stretches of knot intervals that are linearised at a time."""
        size = max(1, _CHUNK // self.setting.points)
        return [slice(a, min(a + size, piece.intervals)) for a in range(0, piece.intervals, size)]

    def linearised(
        self, number: int, now: Iterate, part: slice, further: Further | None = None, *, held: bool = False
    ) -> tuple[Array, Array]:
        """Return the weighted equations about the unknowns, knot interval by knot interval.

        Columns of `further` terms follow those of p and z; no columns where these are `held`.

        Returns
        -------
        tuple
            d residual / d coefficients, (J, points * rows, 6 * channels); d residual / d (p, z) and last the residual
            itself, (J, points * rows, p + z + 1).

        """
        setting, piece, rows = self.setting, self.pieces[number], len(self.rho)
        coefficients = now.coefficients[number]
        if part.stop - part.start == piece.intervals:
            here = self._whole(number, coefficients)
        else:
            own = coefficients[part.start : part.stop + DEGREE]
            here = States(coefficients_to_states(setting, own), number, part.start * setting.points, own)
        error = self.equations.residual(here, now.p, now.z) - piece.torque[:, part].reshape(rows, -1)
        mask = self._mask(number)[:, part.start * setting.points : part.stop * setting.points]
        scaled = np.abs(error) * mask / self.rho[:, None]
        weight = mask / self.rho[:, None] * np.where(scaled > HUBER, np.sqrt(HUBER / np.maximum(scaled, 1e-300)), 1.0)
        slopes = self.equations.slopes(here, now.p, now.z, np.array(_STEPS)[:, None] * setting.scale)
        columns = []
        if not held:
            columns.append(self.equations.columns(here, now.z))
        if len(now.z) and not held:
            columns.append(self.equations.shape_slopes(here, now.p, now.z))
        if further is not None:
            columns.append(further(here))
        border = np.concatenate([*columns, error[:, None]], axis=1)
        by_instant = weight.T[:, :, None]
        return (
            self._by_coefficients(slopes.transpose(3, 1, 0, 2) * by_instant[..., None]),
            (border.transpose(2, 0, 1) * by_instant).reshape(part.stop - part.start, -1, border.shape[1]),
        )

    def _by_coefficients(self, slopes: Array) -> Array:
        """Return slopes by states (N, rows, 3, channels) as those by coefficients, (J, points * rows, 6 * channels)."""
        (instants, rows, _, channels), points = slopes.shape, self.setting.points
        slopes = np.ascontiguousarray(slopes).reshape(-1, points, rows, 3 * channels)
        found = np.empty((instants // points, points, rows, ORDER * channels))
        for point, turn in enumerate(self._turns):
            for row in range(rows):
                np.matmul(slopes[:, point, row], turn, out=found[:, point, row])
        return found.reshape(len(found), points * rows, -1)
