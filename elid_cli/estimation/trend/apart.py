"""Recordings that stand out from all others: of another robot, with another load, or after a sudden change.

One such recording widens the spread between recordings so far that no trend of the others is seen beside it. Each
recording is compared with what the others say, by their mean and by a line through them, so that one stands out of a
drift as well. Of each parameter the farthest is left out and the rest are judged again: two that are alike hide each
other (Rosner 1983, the generalised extreme studentised deviate), so one counts if it or one left out after it is clear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from elid_cli._types import Array
from elid_cli.estimation.trend.series import LEAST

MODELS = 2
"""Ways in which the others predict a recording: by their mean, and by a line."""
PART = 10
"""One in so many recordings may stand out, or fewer than a step needs."""
FAR = 5.0
"""Least distance over the largest of the others: sessions may scatter with heavier tails than the normal law's."""
ALONE = 1e-9
"""Least share of a recording's place that the others must know for a line to predict it."""


@dataclass(frozen=True)
class Deviation:
    """A parameter in which a recording stands out, in the parameter's unit."""

    name: str
    unit: str
    value: float
    expected: float
    """What the other recordings predict for it."""
    deviations: float
    """Its distance from that over the standard error of the distance."""


@dataclass(frozen=True)
class StandsOut:
    """A recording that is far from what all others say."""

    number: int
    """Of the recording, from 0."""
    parameters: tuple[Deviation, ...]
    """Where, clearest first."""


@dataclass(frozen=True)
class Estimates:
    """Parameters of recordings as arrays; NaN where a recording does not estimate one."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    places: Array
    """Places of recordings on the axis of slopes, (R,)."""
    values: Array
    """SI of the units, (R, P)."""
    errors: Array
    """Standard errors, (R, P)."""


@dataclass(frozen=True)
class _Distances:
    """How far recordings are from what the others say, (R, P) each; p is 1 where nothing can be said."""

    p: Array
    t: Array
    away: Array
    """From what the others say by `line` or by their mean, in units of the parameters."""
    line: NDArray[np.bool_]
    by_mean: Array
    by_line: Array
    """The distances by either, 0 where there is none."""


def standing_out(told: Estimates, level: float) -> tuple[StandsOut, ...]:
    """Return the recordings that stand out, in order.

    Among recordings that only scatter, one is named with a chance of at most `level`, all recordings and parameters
    together. Recordings at the begin or end that are as many as a step needs are a step, and are not named.
    """
    count, parameters = told.values.shape
    most = min(max(LEAST - 1, count // PART), count - LEAST)
    bound = level / (MODELS * count * parameters)
    alive = np.ones((count, parameters), dtype=bool)
    every = np.arange(parameters)
    gone: list[NDArray[np.intp]] = []
    clear = np.zeros(parameters, dtype=int)
    chance = np.ones(count)
    for step in range(most):
        p = _distances(told, alive).p
        worst = np.argmin(p, axis=0)
        gone.append(worst)
        alive[worst, every] = False
        clear = np.where(p[worst, every] <= bound, step + 1, clear)
        np.minimum.at(chance, worst, p[worst, every])
    far = {int(gone[k][j]) for j in every.tolist() for k in range(int(clear[j]))}
    left = _no_steps(sorted(far, key=lambda number: chance[number])[: max(most, 0)], count)
    found = [item for number in sorted(left) if (item := _judged(told, number, left, level)) is not None]
    return tuple(found)


def _no_steps(numbers: list[int], count: int) -> set[int]:
    """Return recordings without those that are a whole side of a step."""
    left = set(numbers)
    for side in (range(count), range(count - 1, -1, -1)):
        run = next(k for k, number in enumerate(side) if number not in left)
        left -= set(side[:run]) if run >= LEAST else set()
    return left


def _judged(told: Estimates, number: int, left: set[int], level: float) -> StandsOut | None:
    """Return in what one recording stands out from those that are not left out; None where it is not clear."""
    count, parameters = told.values.shape
    alive = np.array([k == number or k not in left for k in range(count)])
    found = _distances(told, np.repeat(alive[:, None], parameters, axis=1))
    p, t = found.p[number], found.t[number]
    alive[number] = False
    others = _distances(told, np.repeat(alive[:, None], parameters, axis=1))
    widest = np.abs(np.where(found.line[number], others.by_line, others.by_mean)).max(axis=0)
    lone = np.abs(found.away[number]) > FAR * widest
    if not np.any(lone & (p <= level / (MODELS * count * parameters))):
        return None
    order = [k for k in np.argsort(-np.abs(t)).tolist() if p[k] <= level / (MODELS * parameters)]
    values = told.values[number]
    expected = values - found.away[number]
    return StandsOut(number, tuple(
        Deviation(told.names[k], told.units[k], float(values[k]), float(expected[k]), float(t[k])) for k in order
    ))  # fmt: skip


def _distances(told: Estimates, alive: NDArray[np.bool_]) -> _Distances:
    """Return how far each recording that is alive, (R, P), is from the others, by the model that shows it better."""
    known = np.isfinite(told.values) & alive
    count = known.sum(axis=0)
    with np.errstate(all="ignore"):  # parameters of too few recordings divide by zero and say nothing
        values = np.where(known, told.values, 0.0)
        values = np.where(known, values - values.sum(axis=0) / count, 0.0)
        places = np.where(known, told.places[:, None], 0.0)
        places = np.where(known, places - places.sum(axis=0) / count, 0.0)
        spread = (places**2).sum(axis=0)
        slope = np.where(spread > 0, (places * values).sum(axis=0) / spread, np.nan)
        errors = np.where(known, told.errors, 0.0)
        mean = _deleted(values, errors, 1.0 / count, (count - 1, count - 2))
        line = _deleted(values - slope * places, errors, 1.0 / count + places**2 / spread, (count - 1, count - 3))
    usable = known & (count > LEAST)
    p_mean, p_line = (np.where(usable & np.isfinite(p), p, 1.0) for p, *_ in (mean, line))
    better = p_line < p_mean
    by_mean, by_line = (np.where(known & np.isfinite(away), away, 0.0) for *_, away in (mean, line))
    t = np.where(usable, np.where(better, line[1], mean[1]), 0.0)
    away = np.where(better, by_line, by_mean)
    return _Distances(np.where(better, p_line, p_mean), t, away, better, by_mean, by_line)


def _deleted(left: Array, errors: Array, leverage: Array, others: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return p-value, Student's t and distance of each recording from the fit of the others, (R, P) each.

    `left`: residuals of the fit to all, 0 where there is none; `others`: their number, and degrees of freedom, (P,).
    """
    number, freedom = others[0], np.where(others[1] > 0, others[1], np.nan)
    rest = np.where(1.0 - leverage > ALONE, 1.0 - leverage, np.nan)
    away = left / rest
    scatter = np.maximum((left**2).sum(axis=0) - left * away, 0.0) / freedom
    own = np.maximum((errors**2).sum(axis=0) - errors**2, 0.0) / number
    # others scatter no less than their errors say; a recording whose own error is larger may be farther off
    variance = np.maximum(scatter, own) / rest + np.maximum(errors**2 - own, 0.0)
    t = away / np.sqrt(variance)
    return 2.0 * stdtr(freedom, -np.abs(t)), t, away
