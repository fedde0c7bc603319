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

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.slow_effects import CUTOFFS, declares_slow, highest_that_holds
from elid_cli.estimation.validation.noise_floor import noise_floor
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects.shifts import Shifts, corrected
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
LATE = 0.05
"""Phase, rad at the cut-off, up to which a torque's delay is left to its column: a thousandth is then lost."""
ROUNDS = 4
"""Times that torques are moved at most."""
ENOUGH = 3.0
"""Independent instants per joint and base parameter of one joint that a cut-off must leave."""


def fit_best(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> DefaultFit:
    """Fit a log at the usual cut-off, or at the lower one that leaves clearly smaller standard errors, torques in time.

    A cut-off that the user gave stands, and so does that for declared effects, whose shapes lie in faster changes.
    """
    if _given(model, signals, options):
        fit = fit_log(model, base, signals, options)
    else:
        fit, whole = _best(model, base, signals, options)
        if not whole:
            fit = fit_log(model, base, _like(signals, fit.signals), options)
    return in_time(signals, fit, lambda moved: fit_log(model, base, moved, options))


def at_best_cutoff(
    model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions
) -> tuple[Signals, DefaultFit | None]:
    """Return the signals as `fit_best` fits them, and the fit that says so, of a long log to stretches of it only."""
    try:
        fit, _ = _best(model, base, signals, options)
    except DataError:  # too little for a fit of its own; others may join it
        return signals, None
    fit = in_time(fit.signals, fit, lambda moved: fit_log(model, base, moved, options))
    return _like(signals, fit.signals), fit


def in_time(signals: Signals, fit: DefaultFit, again: Callable[[Signals], DefaultFit]) -> DefaultFit:
    """Return the fit with torques moved to where they act, where their delay is more than a column can correct.

    Parameters
    ----------
    signals
        The log as it came.
    fit
        A fit to it.
    again
        Fit other signals.
    """
    for _ in range(ROUNDS):
        if float(np.max(np.abs(fit.late), initial=0.0)) * 2 * np.pi * fit.signals.filter.cutoff <= LATE:
            break
        moved = fit.data.facts.moved + fit.late
        fit = again(_moved(replace(signals, filter=fit.signals.filter), moved))
    return fit


def _given(model: Regressor, signals: Signals, options: EstimateOptions) -> bool:
    """Whether the cut-off stands: the user gave it, or shapes of effects lie in faster changes."""
    declared = bool(model.robot.effects) and not options.hold and not declares_slow(model.robot)
    return not signals.cutoff_free or declared


def _like(signals: Signals, other: Signals) -> Signals:
    """Return a log filtered, and its torques moved, as a part of it was."""
    return _moved(replace(signals, filter=other.filter), other.moved)


def _moved(signals: Signals, by: Array) -> Signals:
    if not np.any(by):
        return signals
    return replace(corrected(signals, replace(Shifts.none(signals.n), torque=by)), moved=by)


def _best(
    model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions
) -> tuple[DefaultFit, bool]:
    """Return the fit at the best cut-off to the stretches that it is judged by, and whether they are the whole log."""
    shown = replace(signals, segments=excerpts(signals.segments, signals.dt))
    whole = shown.duration == signals.duration and len(shown.segments) == len(signals.segments)
    if _given(model, signals, options):
        whole = whole or signals.cutoff_free
        return fit_log(model, base, signals if whole else shown, options), whole
    if declares_slow(model.robot):
        return _where_it_holds(base, shown, lambda lower: fit_log(model, base, lower, options)), whole
    hint = replace(signals, segments=excerpts(signals.segments, signals.dt, HINT, shortest=SHORTEST))
    if hint.duration < signals.duration:
        other = _tried(base, hint, LOWER[0], lambda lower: fit_log(model, base, lower, options))
        if other is not None:
            usual = fit_log(model, base, hint, options)
            if not _compared(other, usual) < HINTED:
                return usual, False
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
    return best, whole


def _where_it_holds(base: BaseParameters, signals: Signals, fit: Callable[[Signals], DefaultFit]) -> DefaultFit:
    """Return the fit at the highest cut-off at which effects whose form holds at low frequencies alone hold."""
    own = signals.filter.cutoff
    fits = [fit(signals), *(_tried(base, signals, lower, fit) for lower in CUTOFFS if lower < own)]
    return highest_that_holds([(_left(one), one) for one in fits if one is not None])


def _left(fit: DefaultFit) -> float:
    """Return the residual over what the sensors' noise alone would leave, of the row that has most of it."""
    floor = noise_floor(fit.model, fit.signals, fit.observation, fit.standard).rms
    rest = {row: fit.triangles.rms(fit.solution.values, row) for row in floor if row in fit.triangles.rows}
    return max((rest[row] / floor[row] for row in rest if floor[row] > 0), default=0.0)


def _tried(
    base: BaseParameters, signals: Signals, cutoff: float, fit: Callable[[Signals], DefaultFit]
) -> DefaultFit | None:
    """Return the fit at a cut-off, or None where too little is left to judge it by."""
    signals = signals.refiltered(cutoff)
    instants = 2.0 * cutoff * len(signals.outputs) / signals.rate
    if cutoff > DEFAULT_CUTOFF or instants * len(signals.still) < ENOUGH * base.count:
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
    mine, its = (fit.deviations(fit.covariance)[also] for fit in (one, other))
    good = (mine > 0) & (its > 0)
    return float(np.mean(np.log(mine[good] / its[good]))) if good.any() else float("inf")
