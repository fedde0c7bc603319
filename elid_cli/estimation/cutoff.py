"""The cut-off of the parallel filter, chosen by what the data say of the errors that each leaves.

Noise of the positions enters with their second derivative, so it grows steeply with frequency, while what a motion
tells of the parameters lies at the frequencies of the motion. Row weights cannot tell the two apart; a lower cut-off
can. Rows and right-hand side are filtered alike, so any cut-off gives a consistent answer as far as the filtered
regressor is free of noise, and a lower one is freer of it. The one whose standard errors, which know of the
residual's colour, are least on average is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elid_cli.errors import DataError
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.result import EstimateOptions
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import Regressor
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.signals import DEFAULT_CUTOFF, Signals

LOWER = (7.0, 5.0, 3.5)
"""Cut-offs tried besides the usual one, Hz."""
WORTH = 0.25
"""Fall of the standard errors' mean logarithm from which a lower cut-off is taken: below it the usual one stands."""
TREND = 0.02
"""The same by which one step down must be better for the next to be tried: noise of positions grows so steeply with
frequency that where the lowest cut-off is worth taking the first step shows it."""
HINT = 24_000
"""Samples of a long log that the first step is tried on."""
HINTED = 0.0
"""The same as `WORTH`, up to which that part speaks for a lower cut-off, more cautiously than a whole log does."""
SHORTEST = 3.0
"""Length of each of its stretches, s, at least: a lower cut-off's filter is a third of a second long."""
ENOUGH = 3.0
"""Independent instants per joint and base parameter of one joint that a cut-off must leave."""


def fit_best(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> DefaultFit:
    """Fit a log at the usual cut-off, or at the lower one that leaves clearly smaller standard errors.

    A cut-off that the user gave stands, and so does that for declared effects, whose shapes lie in faster changes.
    """
    best = _best(model, base, signals, options)
    if isinstance(best, DefaultFit):
        return best
    return fit_log(model, base, signals if best is None else signals.refiltered(best), options)


def at_best_cutoff(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> Signals:
    """Return the signals with the cut-off that `fit_best` fits them at; a long log is never held whole for it."""
    best = _best(model, base, signals, options)
    if best is None:
        return signals
    return best.signals if isinstance(best, DefaultFit) else signals.refiltered(best)


def _best(
    model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions
) -> DefaultFit | float | None:
    """Return the fit at the best cut-off; of a long log, by stretches of which it is judged, that cut-off, Hz.

    None: the cut-off that the signals have.
    """
    if not signals.cutoff_free or model.robot.effects:
        return None
    hint = replace(signals, segments=excerpts(signals.segments, signals.dt, HINT, shortest=SHORTEST))
    if hint.duration < signals.duration:
        other = _tried(base, hint, LOWER[0], lambda lower: fit_log(model, base, lower, options))
        if other is not None and not _compared(other, fit_log(model, base, hint, options)) < HINTED:
            return None
    shown = replace(signals, segments=excerpts(signals.segments, signals.dt))
    usual = fit_log(model, base, shown, options)
    best, least, before = usual, -WORTH, -TREND
    for cutoff in LOWER:
        tried = _tried(base, shown, cutoff, lambda lower: fit_log(model, base, lower, options))
        gain = np.inf if tried is None else _compared(tried, usual)
        if tried is not None and gain < least:
            best, least = tried, gain
        if not gain < before:
            break
        before = gain - TREND
    if shown.duration == signals.duration and len(shown.segments) == len(signals.segments):
        return best
    return None if best is usual else best.signals.filter.cutoff


def _tried(
    base: BaseParameters, signals: Signals, cutoff: float, fit: Callable[[Signals], DefaultFit]
) -> DefaultFit | None:
    """Return the fit at a cut-off, or None where too little is left to judge it by."""
    signals = signals.refiltered(cutoff)
    instants = 2.0 * cutoff * len(signals.outputs) / signals.rate
    if cutoff >= DEFAULT_CUTOFF or instants * len(signals.still) < ENOUGH * base.count:
        return None
    try:
        return fit(signals)
    except DataError:
        return None


def _compared(one: DefaultFit, other: DefaultFit) -> float:
    """Return the mean logarithm of the ratio of standard errors over what both determine; inf if one lacks some."""
    known, also = (fit.solution.estimable(fit.transform) for fit in (one, other))
    if (also & ~known).any() or not known.any():
        return float("inf")
    mine, its = (_deviations(fit)[also] for fit in (one, other))
    good = (mine > 0) & (its > 0)
    return float(np.mean(np.log(mine[good] / its[good]))) if good.any() else float("inf")


def _deviations(fit: DefaultFit) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    used = fit.transform[:, fit.solution.basis]
    return np.sqrt(np.maximum(np.diag(used @ fit.covariance @ used.T), 0.0))
