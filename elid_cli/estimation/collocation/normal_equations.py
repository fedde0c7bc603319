"""Normal equations of one piece of a collocation: a band of the trajectory's coefficients with a border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.problem import Further, Iterate, Problem
from elid_cli.signals.splines import ORDER


@dataclass(frozen=True)
class NormalEquations:
    """A piece's normal equations; coefficients are ordered knot by knot, the channels of a knot side by side."""

    band: Array
    """Lower band of the coefficients' matrix: of each, what it shares with those that follow, (knots * C, 6 C)."""
    border: Array
    """Columns of p, z and further terms, and last the gradient, (knots * C, size + 1)."""
    corner: Array
    """The matrix of p, z and further terms, and last their gradient, (size + 1, size + 1)."""


def normal_equations(
    problem: Problem, number: int, now: Iterate, size: int, further: Further | None
) -> NormalEquations:
    """Return the normal equations of piece `number` with `size` columns of p, z and further terms; 0: they are held."""
    piece, coefficients = problem.pieces[number], now.coefficients[number]
    knots, channels = coefficients.shape
    width = ORDER * channels
    band, border = np.zeros((knots, channels, width)), np.zeros((knots, channels, size + 1))
    band[:, :, ::channels] = piece.information
    corner = np.zeros((size + 1, size + 1))
    for part in problem.parts(piece):
        slopes, columns = problem.linearised(number, now, part, further, held=not size)
        turned = slopes.transpose(0, 2, 1)
        inner, across = np.matmul(turned, slopes), np.matmul(turned, columns)
        for k in range(width):
            later, channel = divmod(k, channels)
            band[part.start + later : part.stop + later, channel, : width - k] += inner[:, k, k:]
        for k in range(ORDER):
            border[part.start + k : part.stop + k] += across[:, k * channels : (k + 1) * channels]
        flat = columns.reshape(-1, size + 1)
        corner += flat.T @ flat
    pulls = (problem.misfit(piece, coefficients) * piece.weight) @ problem.samples
    for k in range(ORDER):
        border[k : k + piece.intervals, :, size] -= pulls[:, :, k].T
    band[:, :, 0] += 1e-12 * band[:, :, 0].max()
    return NormalEquations(band.reshape(-1, width), border.reshape(-1, size + 1), corner)
