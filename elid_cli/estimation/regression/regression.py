"""Least squares of one equation, with standard errors that know how long its residual remembers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.regression.covariance import bandwidth_of, long_run
from elid_cli.estimation.regression.long_run import uncertain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Regression:
    """A fitted equation."""

    values: Array
    """Coefficients, (k,)."""
    spread: Array
    """Their standard deviations, (k,)."""
    alone: Array
    """Mean square of each column that the others do not explain, (k,)."""


def regression(columns: Array, target: Array, stretch: NDArray[np.intp]) -> Regression:
    """Fit a target (M,) by columns (M, k), its residual correlated within each stretch (number of every instant, (M,)).

    Standard errors are autocorrelation-aware (Newey and West 1987; `longrun`).
    """
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    unit = columns / scale
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-12)
    fitted = inverse @ (unit.T @ target)
    scores = unit * (target - unit @ fitted)[:, None]
    meat = long_run(scores, stretch) * uncertain(len(scores), bandwidth_of(scores))
    spread = np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0))
    own = np.diag(inverse)
    alone = np.where(own > 0, scale**2 / np.where(own > 0, own, 1.0), 0.0) / len(target)
    return Regression(fitted / scale, spread / scale, alone)
