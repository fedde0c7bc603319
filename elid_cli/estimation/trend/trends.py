"""All parameters of one machine over its recordings, with one rate of false alarms for the machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.checks import real, several
from elid_cli.errors import UsageError
from elid_cli.estimation.comparison import Result, SavedResult, as_saved
from elid_cli.estimation.trend.apart import Estimates, StandsOut, standing_out
from elid_cli.estimation.trend.conditions import conditions_of
from elid_cli.estimation.trend.families import LEADER, Family, FamilyWord, explained, families
from elid_cli.estimation.trend.given import distinct, logs_of, warnings_of
from elid_cli.estimation.trend.series import LEAST, Series, Word, series_of
from elid_cli.robot.parameter import MOTOR_PARAMETERS
from elid_cli.tables import Shown

FALSE_ALARMS = 0.01
"""Share of machines on which nothing changes and something is named: a change, or a recording that stands out."""
APART = 0.0025
"""Part of that which is left to recordings that stand out: those of another robot are far beyond any level."""


@dataclass(frozen=True)
class Trend:
    """One parameter with its verdict."""

    series: Series
    """Of the recordings that do not stand out."""
    word: Word
    numbers: tuple[int, ...] = ()
    """Of the recordings of the series' values, from 0; empty: all."""
    scattered: bool = False
    """Whether recordings differ by more than their errors say, those that stand out left out."""
    outside: Array = field(default_factory=lambda: np.empty((0, 3)))
    """Place, estimate and standard error of recordings that stand out, (K, 3)."""

    def number(self, k: int) -> int:
        """Return the number of the recording of the series' value `k`, both from 0."""
        return self.numbers[k] if self.numbers else k

    @property
    def drives(self) -> bool:
        """Whether it is of a drive or a transmission, or beside the base parameters."""
        leader = LEADER.match(self.series.name)
        return leader is None or leader.group(1) in (*MOTOR_PARAMETERS, "K")


@dataclass(frozen=True, repr=False)
class Trends(Shown):
    """What the recordings of one machine say together."""

    robot: str
    files: tuple[str, ...]
    trends: tuple[Trend, ...]
    joints: tuple[str, ...] = ()
    axis: str = "recording"
    """Of what slopes are given per one: ``recording``, ``hour``."""
    families: tuple[Family, ...] = ()
    """Kinds of parameters that enough joints have."""
    stands_out: tuple[StandsOut, ...] = ()
    """Recordings that are far from all others, and left out of everything else."""
    warnings: tuple[str, ...] = ()
    """What results warn of, with their files; which are the same result, or of the same log."""
    conditions: tuple[str, ...] = ()
    """What all recordings tell beside time that joints together are compared with: ``temperature``, ``delay``."""
    logs: tuple[tuple[str, str], ...] = ()
    """Name and SHA-256 of every log that the recordings were identified from, as far as they tell."""

    def joint_of(self, item: Trend) -> str:
        """Return the joint of a parameter: that of a sum's leading term, or the one that its name ends in."""
        _, of, rest = item.series.name.partition(" of ")
        if of and ": " in rest:
            return rest.partition(": ")[0]
        leader = LEADER.match(item.series.name)
        number = int(leader.group(2)) if leader else 0
        return self.joints[number - 1] if 0 < number <= len(self.joints) else f"joint {number}" if number else "robot"

    def of(self, *words: Word) -> tuple[Trend, ...]:
        """Return the parameters with these verdicts."""
        return tuple(item for item in self.trends if item.word in words)

    @property
    def disagreeing(self) -> tuple[Trend, ...]:
        """Parameters in which recordings that do not stand out disagree."""
        return tuple(item for item in self.of("disagrees") if item.scattered)


def _checked(places: Sequence[float], count: int) -> Array:
    """Return the places of so many results, (R,); refuse others."""
    several(real, "numbers")("trend: places", places if isinstance(places, str) else list(places))
    at = np.asarray(places, dtype=float)
    if at.shape != (count,) or not np.isfinite(at).all():
        raise UsageError(f"trend: places: {at.size} for {count} results", hint="one finite number per result")
    return at


def _order(at: Array) -> list[int]:
    """Return the order of results by their places."""
    if np.ptp(at) == 0:
        raise UsageError(
            "trend: all recordings have the same time", hint="give them in their order, without --by time (places=)"
        )
    found: list[int] = np.argsort(at, kind="stable").tolist()
    return found


def trend(results: Sequence[Result], places: Sequence[float] | None = None, axis: str = "recording") -> Trends:
    """Return which base parameters of a machine change over its recordings, and what was corrected beside them.

    Recordings that stand out are named first, at `APART`, and all the rest is of the others. A trend or a step is named
    where its p-value holds among all parameters and both questions (Holm 1979), at what is left of `FALSE_ALARMS` for
    the machine; so are lines through the mean of one kind of parameters over all joints. Of a parameter with neither,
    recordings disagree where they scatter farther than their standard errors say, or where one stands out; a kind of
    parameters differs together where joints do so alike. Scatter is judged in the same way, at `FALSE_ALARMS`.

    Parameters
    ----------
    results
        One per recording, in order: files saved with ``--json``, or what `identify` returns. The same result given
        again is counted once.
    places
        Place of every recording on the axis of the slopes, such as hours, by which they are put in order; default its
        number.
    axis
        What one is on that axis, in a word.

    Raises
    ------
    UsageError
        Fewer than three different results, of different robots, or no parameter in three of them; places that are not
        one number per result, or all the same.
    """
    every = as_saved(results, "trend: results")
    read, again = every, list[str]()
    if len(every) >= LEAST:
        numbers, again = distinct(every)
        places = None if places is None else _checked(places, len(every))[numbers].tolist()
        read = [every[k] for k in numbers]
    if places is not None and len(read) >= LEAST:
        order = _order(np.asarray(places, dtype=float))
        read, places = [read[k] for k in order], np.asarray(places, dtype=float)[order].tolist()
    if len(read) < LEAST:
        given = "1 recording is" if len(read) == 1 else f"{len(read)} recordings are"
        hint = " ".join(["elid compare", *(r.file for r in read)]) if len(read) > 1 else ""
        raise UsageError(f"trend: {given} given, at least {LEAST} are needed", detail="; ".join(again), hint=hint)
    robots = list(dict.fromkeys(result.robot for result in read))
    if len(robots) > 1:
        raise UsageError(f"trend: results of different robots: {', '.join(robots[:4])}")
    told = _estimates(read, np.arange(float(len(read))) if places is None else np.asarray(places, dtype=float))
    apart = standing_out(told, APART)
    kept = np.ones(len(read), dtype=bool)
    kept[[item.number for item in apart]] = False
    followed = _followed(told, kept)
    if not followed:
        raise UsageError("trend: no parameter is estimated in three of the results",
                         detail=", ".join(r.file for r in read[:4]))  # fmt: skip
    trends, kinds = _named(followed, apart, int(kept.sum()))
    conditions = conditions_of([result for result, keep in zip(read, kept, strict=True) if keep])
    judged = tuple(replace(kind, explained=explained(kind, conditions)) if kind.word != "steady" else kind
                   for kind in kinds)  # fmt: skip
    return Trends(read[0].robot, tuple(r.file for r in read), trends, read[0].joints, axis, judged, apart,
                  (*again, *warnings_of(read)), tuple(conditions), logs_of(read))  # fmt: skip


def _estimates(read: Sequence[SavedResult], places: Array) -> Estimates:
    """Return what results estimate, as arrays: parameters with a standard error alone."""
    known = [{**result.parameters, **result.beside} for result in read]
    names = tuple(dict.fromkeys(name for parameters in known for name in parameters))
    found = np.full((2, len(read), len(names)), np.nan)
    units = [""] * len(names)
    for k, parameters in enumerate(known):
        for j, name in enumerate(names):
            estimate = parameters.get(name)
            if estimate is not None and estimate.value is not None and estimate.std_error:
                found[:, k, j] = estimate.value, estimate.std_error
                units[j] = units[j] or estimate.unit
    return Estimates(names, tuple(units), places, found[0], found[1])


def _followed(told: Estimates, kept: NDArray[np.bool_]) -> list[Trend]:
    """Return the parameters that enough of the recordings kept, (R,), estimate, not yet judged."""
    found = []
    for j, (name, unit) in enumerate(zip(told.names, told.units, strict=True)):
        known = np.isfinite(told.values[:, j])
        use, out = known & kept, known & ~kept
        if use.sum() >= LEAST:
            series = series_of(name, unit, told.places[use], told.values[use, j], told.errors[use, j])
            outside = np.stack([told.places[out], told.values[out, j], told.errors[out, j]], axis=1)
            found.append(Trend(series, "steady", tuple(np.flatnonzero(use).tolist()), outside=outside))
    return found


def _named(
    followed: list[Trend], apart: Sequence[StandsOut], recordings: int
) -> tuple[tuple[Trend, ...], list[Family]]:
    """Return parameters and kinds of them with their verdicts, over so many recordings that do not stand out."""
    series = [item.series for item in followed]
    lines = [s.slope_p for s in series]
    steps = [s.step.p if s.step else 1.0 for s in series]
    kinds = families(series, recordings)
    named = _holm([*lines, *steps, *(kind.slope_p for kind in kinds)], FALSE_ALARMS - APART)
    scattered = _holm([*(s.heterogeneity_p for s in series), *(kind.together_p for kind in kinds)], FALSE_ALARMS)
    far = {item.name for recording in apart for item in recording.parameters}
    trends = []
    for k, item in enumerate(followed):
        line, step = named[k], named[len(series) + k]
        word: Word = "disagrees" if scattered[k] or item.series.name in far else "steady"
        if line or step:
            word = "trend" if line and lines[k] <= steps[k] else "step"
        trends.append(replace(item, word=word, scattered=scattered[k]))
    told = zip(kinds, named[2 * len(series) :], scattered[len(series) :], strict=True)
    return tuple(trends), [replace(kind, word=_family_word(line, alike)) for kind, line, alike in told]


def _family_word(line: bool, alike: bool) -> FamilyWord:
    return "trend" if line else "together" if alike else "steady"


def _holm(p: Sequence[float], level: float) -> list[bool]:
    """Return which of several hypotheses are rejected, so that a false one is with a chance of at most `level`."""
    order = np.argsort(p)
    rejected = [False] * len(p)
    for rank, k in enumerate(order.tolist()):
        if p[k] > level / (len(p) - rank):
            break
        rejected[k] = True
    return rejected
