"""Whitening by the propagated sensor noise, jointly over the rows of a joint.

One torque channel drives a joint's sum and motor rows, and the deflection's noise enters only the motor row, so the
two rows' noises are correlated with each other and in time. A vector autoregression fitted to *propagated noise* (never
to the residual: that would treat a missing effect as noise and remove it) takes the correlation in time away; the
correlation between the rows is that of the present residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.validation.noise_floor import Floor
from elid_cli.model.regressor import EstimationRow

ORDER = 4
"""Order of the autoregression."""
AT_ONCE = 1 << 16
"""Products held at once: in the processor's cache, many columns take half the time."""
LEAST = 2e-4
"""Smallest noise assumed in any row, as a part of its torque: no simulation or spline is exact beyond it."""


@dataclass(frozen=True)
class JointWhitener:
    """Whitens the rows of one joint: (r, d, M) residual-like series to r channels of unit variance."""

    rows: tuple[EstimationRow, ...]
    lags: Array
    """Coefficients of the autoregression, (order, r, r)."""
    mix: Array
    """Inverse Cholesky factor of the innovations' covariance, (r, r)."""
    use: NDArray[np.bool_]
    """Instants whose whole history counts, (M,)."""

    def mixed_by(self, residual: Array, seen: NDArray[np.bool_]) -> JointWhitener:
        """Return the whitener whose rows are decorrelated as the residual's innovations are.

        Which combination of a joint's rows is quiet depends on what dominates: torque noise and motor-side effects
        leave the link row clean, link-side errors the motor row. Only the colour must come from propagated noise.

        Parameters
        ----------
        residual
            Residuals of the joint's rows, (r, 1, M).
        seen
            Instants that count, (M,).
        """
        plain = JointWhitener(self.rows, self.lags, np.eye(len(self.rows)), self.use)
        innovations = plain.apply(residual)[:, 0, seen]
        least = np.linalg.inv(self.mix)
        covariance = innovations @ innovations.T / max(innovations.shape[1], 1) + 1e-6 * least @ least.T
        scale = np.sqrt(np.diag(covariance))
        unit = covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        mix = np.linalg.inv(np.linalg.cholesky(unit)) / scale[None]
        return JointWhitener(self.rows, self.lags, mix, self.use)

    def apply(self, series: Array) -> Array:
        """Return whitened series, (r, d, M) to (r, d, M); instants outside `use` are zero."""
        clean = series if np.isfinite(series).all() else np.nan_to_num(series)
        # one product for all lags: the rows of a joint are one or two, and such flat products take their time each
        taps = np.concatenate([self.mix, *(self.mix @ self.lags)])
        mixed: Array = np.empty(clean.shape)
        each = max(1, AT_ONCE // (len(taps) * clean.shape[2]))
        for first in range(0, clean.shape[1], each):
            some = clean[:, first : first + each]
            parts = (taps @ some.reshape(len(self.rows), -1)).reshape(-1, *some.shape)
            here = mixed[:, first : first + each]
            here[:] = parts[0]
            for number in range(1, len(parts)):
                here[:, :, number:] -= parts[number, :, :, :-number]
            here *= self.use
        return mixed


def whiteners(observation: Observation, floor: Floor) -> tuple[JointWhitener, ...]:
    """Return one whitener per joint that has data.

    Parameters
    ----------
    observation
        Filtered equations; their masks say which instants count.
    floor
        Propagated noise of the same rows.
    """
    found = []
    for joint in range(observation.robot.n):
        groups = [g for g in observation.independent if g.row.joint == joint and g.count > 8 * ORDER]
        if not groups:
            continue
        rows = tuple(g.row for g in groups)
        use = np.logical_and.reduce([g.use for g in groups])
        series = np.array([floor.series[row] for row in rows])
        # a joint without motor torque has its sensor's only
        scale = observation.tau[joint] if observation.known[joint].any() else groups[0].target
        torque = np.sqrt(np.mean(scale[use] ** 2)) if use.any() else 1.0
        lags, mix = _autoregression(series, LEAST * torque)
        found.append(JointWhitener(rows, lags, mix, history(use, observation.segment)))
    return tuple(found)


def history(use: NDArray[np.bool_], stretch: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the instants of which the `ORDER` instants before count too and belong to the same segment."""
    whole = use.copy()
    for lag in range(1, ORDER + 1):
        whole[:lag] = False
        whole[lag:] &= use[:-lag] & (stretch[lag:] == stretch[:-lag])
    return whole


def _autoregression(series: Array, least: float) -> tuple[Array, Array]:
    """Fit a vector autoregression to noise histories (r, replicates, M) with a white part of size `least`."""
    r, _, instants = series.shape
    covariances = []
    for lag in range(ORDER + 1):
        late, early = series[:, :, lag:], series[:, :, : instants - lag]
        # of as many instants whatever the lag: sums of fewer, each by its own number, need not be any process's
        covariances.append(np.einsum("apm,bpm->ab", late, early) / series[0].size)
    covariances[0] = covariances[0] + least**2 * np.eye(r)
    scale = np.sqrt(np.diag(covariances[0]))
    unit = [c / np.outer(scale, scale) for c in covariances]
    blocks = np.block([[unit[j - i] if j >= i else unit[i - j].T for j in range(ORDER)] for i in range(ORDER)])
    target = np.concatenate(unit[1:], axis=1)
    solution = np.linalg.solve((blocks + 1e-8 * np.eye(r * ORDER)).T, target.T).T
    innovation = unit[0] - solution @ target.T
    innovation = 0.5 * (innovation + innovation.T) + 1e-9 * np.eye(r)
    mix = np.linalg.inv(np.linalg.cholesky(innovation)) / scale[None]
    lags = np.array([solution[:, r * k : r * (k + 1)] * scale[:, None] / scale[None] for k in range(ORDER)])
    return lags, mix


def stack(rows: Mapping[EstimationRow, Array], whitener: JointWhitener, instants: int) -> Array | None:
    """Return the columns (d, M) that act on a joint's rows as (r, d, M), or None where none does."""
    present = [rows[row] for row in whitener.rows if row in rows]
    if not present:
        return None
    width = present[0].shape[0]
    return np.array([rows.get(row, np.zeros((width, instants))) for row in whitener.rows])
