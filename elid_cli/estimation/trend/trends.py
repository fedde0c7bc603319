"""All parameters of one machine over its recordings, with one rate of false alarms for the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.estimation.comparison import Result, as_saved
from elid_cli.estimation.trend.conditions import conditions_of
from elid_cli.estimation.trend.families import LEADER, Family, FamilyWord, explained, families
from elid_cli.estimation.trend.series import LEAST, Series, Word, series_of
from elid_cli.robot.parameter import MOTOR_PARAMETERS
from elid_cli.tables import Shown

FALSE_ALARMS = 0.01
"""Share of machines on which nothing changes and something is named."""


@dataclass(frozen=True)
class Trend:
    """One parameter with its verdict."""

    series: Series
    word: Word

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


def _order(places: Sequence[float], count: int) -> list[int]:
    """Return the order of so many results by their places."""
    at = np.asarray(places, dtype=float)
    if at.shape != (count,) or not np.isfinite(at).all():
        raise UsageError(f"trend: places: {at.size} for {count} results", hint="one finite number per result")
    if np.ptp(at) == 0:
        raise UsageError(
            "trend: all recordings have the same time", hint="give them in their order, without --by time (places=)"
        )
    found: list[int] = np.argsort(at, kind="stable").tolist()
    return found


def trend(results: Sequence[Result], places: Sequence[float] | None = None, axis: str = "recording") -> Trends:
    """Return which base parameters of a machine change over its recordings, and what was corrected beside them.

    A trend or a step is named where its p-value holds among all parameters and both questions (Holm 1979), at
    `FALSE_ALARMS` for the machine; so are lines through the mean of one kind of parameters over all joints. Of a
    parameter with neither, recordings disagree where they scatter farther than their standard errors say; a kind of
    parameters differs together where joints do so alike. Both are judged in the same way.

    Parameters
    ----------
    results
        One per recording, in order: files saved with ``--json``, or what `identify` returns.
    places
        Place of every recording on the axis of the slopes, such as hours, by which they are put in order; default its
        number.
    axis
        What one is on that axis, in a word.

    Raises
    ------
    UsageError
        Fewer than three results, of different robots, or no parameter in three of them; places that are not one number
        per result, or all the same.
    """
    read = as_saved(results)
    if places is not None and len(read) >= LEAST:
        order = _order(places, len(read))
        read, places = [read[k] for k in order], np.asarray(places, dtype=float)[order].tolist()
    if len(read) < LEAST:
        given = "1 recording is" if len(read) == 1 else f"{len(read)} recordings are"
        hint = " ".join(["elid compare", *(r.file for r in read)]) if len(read) > 1 else ""
        raise UsageError(f"trend: {given} given, at least {LEAST} are needed", hint=hint)
    robots = list(dict.fromkeys(result.robot for result in read))
    if len(robots) > 1:
        raise UsageError(f"trend: results of different robots: {', '.join(robots[:4])}")
    at = np.arange(float(len(read))) if places is None else np.asarray(places, dtype=float)
    known = [{**result.parameters, **result.beside} for result in read]
    names = list(dict.fromkeys(name for parameters in known for name in parameters))
    series = []
    for name in names:
        found = [(at[k], e.value, e.std_error, e.unit) for k, parameters in enumerate(known)
                 if (e := parameters.get(name)) and e.value is not None and e.std_error]  # fmt: skip
        if len(found) >= LEAST:
            columns = [np.array([row[c] for row in found], dtype=float) for c in range(3)]
            series.append(series_of(name, found[0][3], columns[0], columns[1], columns[2]))
    if not series:
        raise UsageError("trend: no parameter is estimated in three of the results",
                         detail=", ".join(r.file for r in read[:4]))  # fmt: skip
    lines = [s.slope_p for s in series]
    steps = [s.step.p if s.step else 1.0 for s in series]
    kinds = families(series, len(read))
    named = _holm([*lines, *steps, *(kind.slope_p for kind in kinds)], FALSE_ALARMS)
    scattered = _holm([*(s.heterogeneity_p for s in series), *(kind.together_p for kind in kinds)], FALSE_ALARMS)
    trends = []
    for k, item in enumerate(series):
        line, step = named[k], named[len(series) + k]
        word: Word = "steady"
        if line or step:
            word = "trend" if line and lines[k] <= steps[k] else "step"
        elif scattered[k]:
            word = "disagrees"
        trends.append(Trend(item, word))
    conditions = conditions_of(read)
    told = zip(kinds, named[2 * len(series) :], scattered[len(series) :], strict=True)
    judged = tuple(_judged(kind, line, apart, conditions) for kind, line, apart in told)
    return Trends(read[0].robot, tuple(r.file for r in read), tuple(trends), read[0].joints, axis, judged)


def _judged(kind: Family, line: bool, apart: bool, conditions: Mapping[str, Array]) -> Family:
    word: FamilyWord = "trend" if line else "together" if apart else "steady"
    return replace(kind, word=word, explained=() if word == "steady" else explained(kind, conditions))


def _holm(p: Sequence[float], level: float) -> list[bool]:
    """Return which of several hypotheses are rejected, so that a false one is with a chance of at most `level`."""
    order = np.argsort(p)
    rejected = [False] * len(p)
    for rank, k in enumerate(order.tolist()):
        if p[k] > level / (len(p) - rank):
            break
        rejected[k] = True
    return rejected
