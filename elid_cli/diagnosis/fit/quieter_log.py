"""Logs whose residual is far below what their torques' noise would leave: that noise is a drive's own torque.

A drive that differentiates a coarse encoder chatters, and what its motor received is no noise. Judged by a floor that
is far too high, a search passes by what is missing and takes what is left for anything. What is left at most
frequencies is then the noise: an effect fills some of them.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.observation import RowGroup

QUIET = 0.5
"""Residual over the torque's noise at some joint, at the median of frequencies, below which that noise is none …"""
AGAIN = 0.7
"""… and, in a log in which it is none, below which it is still too large with what was found."""
LEAST = 1e-4
"""Least noise, as a part of the torque: no simulation or spline is exact beyond it."""
_FEWEST = 60
"""Instants that a row needs to be asked."""


def quieter(state: State, below: float = QUIET) -> Log:
    """Return a state's log with its torques' noise brought down to what the state leaves at most frequencies.

    Parameters
    ----------
    state
        The log's model, fitted.
    below
        What some joint has to leave less of; else the log stays as it is.
    """
    found: dict[int, float] = {}
    for group in state.log.training.independent:
        if group.row.kind in ("sum", "motor", "drive") and np.count_nonzero(group.use) >= _FEWEST:
            found[group.row.joint] = min(found.get(group.row.joint, 1.0), _left(state, group))
    if not found or min(found.values()) >= below:
        return state.log
    factors = np.array([found.get(k, 1.0) for k in range(state.log.model.robot.n)])
    return state.log.with_noise(state.log.signals.noise.tau * factors)


def _left(state: State, group: RowGroup) -> float:
    """Return what a row leaves over its noise, at the median of the frequencies that the filter passes."""
    observation = state.log.training
    left = residuals(observation, state.solution.values, state.extras)[group.row]
    power, noise = (_power(series, group) for series in (left[None], state.floor.series[group.row]))
    frequencies = np.fft.rfftfreq(len(left), 1.0 / observation.rate)
    passed = (frequencies > 0) & (frequencies < state.log.signals.filter.cutoff)
    if not passed.any() or not np.median(noise[:, passed]) > 0:
        return 1.0
    torque = float(np.sqrt(np.mean(observation.tau[group.row.joint][group.use] ** 2)))
    least = LEAST * torque / max(state.floor.rms[group.row], 1e-300)
    return max(least, float(np.sqrt(np.median(power[:, passed]) / np.median(noise[:, passed]))))


def _power(series: Array, group: RowGroup) -> Array:
    """Return the periodograms of series (p, M), (p, M // 2 + 1); instants that do not count are 0."""
    return np.asarray(np.abs(np.fft.rfft(np.where(group.use, series, 0.0))) ** 2)
