"""Normal equations of the links' motion (banded) and of the other unknowns (a border), and their solution."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.banded import BandedFactor
from elid_cli.estimation.motor_side.by_motion import ByMotion
from elid_cli.estimation.motor_side.by_unknowns import by_unknowns
from elid_cli.estimation.motor_side.latent import Latent, Model
from elid_cli.estimation.motor_side.pieces import Pieces


@dataclass(frozen=True)
class Schur:
    """Normal equations of the free unknowns with the links' motion eliminated."""

    matrix: Array
    load: Array
    scale: Array
    half: Array
    """Uᵀ^-1 times the border, and times the gradient (last column)."""
    factor: BandedFactor
    """U of the coefficients' own normal equations."""

    def path(self, move: Array) -> Array:
        """Return the coefficients' move that goes with one of the free unknowns, (K n,)."""
        return self.factor.back(self.half[:, -1:] - self.half[:, :-1] @ move[:, None])[:, 0]

    def fall(self, move: Array) -> float:
        """Return how much the linear equations' cost falls with a move of the free unknowns and the coefficients."""
        own = self.half[:, -1]
        return float(own @ own + self.load @ move)

    @cached_property
    def following(self) -> Array:
        """Return what moves of the free unknowns move the coefficients by, but for the sign, (K n, U)."""
        return self.factor.back(self.half[:, :-1])


class Rows:
    """Rows of the normal equations over their noise, some groups of them at a time.

    Iterating gives groups, which of them, derivatives by their windows' coefficients and by the unknowns, residuals.
    """

    def __init__(
        self, problem: Latent, now: Model, x: Array, residuals: tuple[Array, Array], root: Array,
        free: NDArray[np.intp],
    ) -> None:  # fmt: skip
        friction = problem.friction_slopes(now, x)
        self.problem, self._by_motion = problem, ByMotion(problem, now, x, friction)
        theta, tau = residuals
        self._over = np.broadcast_to(1 / problem.log.theta_noise, theta.shape), root / problem.tau_noise
        self._by_x = (
            [slopes[:, :, free] for slopes in by_unknowns(problem, now, x, friction)]
            if len(free)
            else [np.zeros((*residual.shape, 0)) for residual in residuals]
        )
        self._residual = theta, tau * root

    def __iter__(self) -> Iterator[tuple[Pieces, slice, Array, Array, Array]]:
        kinds = zip((self.problem.positions, self.problem.torques), self._over, self._by_x, self._residual, strict=True)
        for pieces, noise, by_x, residual in kinds:
            for part in pieces.turns(self.problem.log.n):
                over = pieces.of(noise, part)[:, :, None]
                A = self._by_motion.rows(pieces, part)
                A *= over
                yield pieces, part, A, pieces.of(by_x, part) * over, pieces.of(residual, part)


class Normal:
    """Normal equations of coefficients (banded) and free unknowns (a border)."""

    def __init__(self, rows: Rows, pull: Array, miss: Array) -> None:
        problem, n = rows.problem, rows.problem.log.n
        size = problem.spline.count * n
        self._band = np.zeros((size, (max(problem.positions.reach, problem.torques.reach) + 1) * n))
        self._sides = np.zeros((size, len(pull) + 1))
        self._corner, self._edge = np.diag(pull), -pull * miss
        for pieces, part, A, P, r in rows:
            pieces.added_products(A, np.concatenate([P, r[:, :, None]], axis=2), part, self._band, self._sides)
            P = P.reshape(r.size, P.shape[2])
            self._corner += P.T @ P
            self._edge += P.T @ r.ravel()

    def eliminated(self, damping: float) -> Schur | None:
        """Return the Schur complement, or None where the band is not positive definite."""
        band = self._band.copy()
        band[:, -1] = band[:, -1] * (1 + 1e-11 + 1e-3 * damping) + 1e-14 * band[:, -1].max()
        try:
            factor = BandedFactor(band.T)
        except np.linalg.LinAlgError:
            return None
        half = factor.forward(self._sides)
        matrix = self._corner - half[:, :-1].T @ half[:, :-1]
        load = self._edge - half[:, :-1].T @ half[:, -1]
        size = np.maximum(np.diag(matrix), 1e-10 * np.diag(self._corner) + 1e-300)
        return Schur(matrix, load, 1 / np.sqrt(size), half, factor)

    @staticmethod
    def move(schur: Schur, damping: float) -> tuple[Array, Array]:
        """Return the move of the free unknowns and the scaled, damped matrix that gave it."""
        unit = schur.matrix * schur.scale[:, None] * schur.scale
        held = unit + (damping + 1e-9) * np.eye(len(unit))
        return schur.scale * np.linalg.solve(held, schur.scale * schur.load), unit
