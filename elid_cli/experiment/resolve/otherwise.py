"""What would tell two effects apart where the planned motion does not: more of it, more speed, another experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from elid_cli.experiment.information import States
from elid_cli.experiment.resolve.decision import Distance
from elid_cli.experiment.resolve.question import Hypothesis

LIKELY = 0.9
"""Probability of a right decision from which a log promises one."""
TIMES = (2, 3, 5, 10, 20)
"""How many times as long a log is asked for."""
SPEEDS = (0.5, 2.0)
"""Speeds, in times the planned one, that are asked for."""

Judged = Callable[[States], Mapping[tuple[str, str], Distance]]
"""Judges a motion given by its samples: (truth, rival) -> distance."""


@dataclass(frozen=True)
class Remedy:
    """Something that would decide a pair."""

    kind: str
    """``longer``, ``speed``, or ``record`` (what an effect's description says, which no motion shows)."""
    words: str
    probability: float | None = None


def remedies(
    first: Hypothesis, second: Hypothesis, states: States, judged: Judged, *, hopeless: bool
) -> tuple[Remedy, ...]:
    """Return what would decide a pair that a planned motion does not, as far as it can be computed, and the rest.

    Parameters
    ----------
    first, second
        The pair.
    states
        The planned motion, (N, n) each.
    judged
        Judges other motions.
    hopeless
        Whether the two are the same in every row: then no motion is tried.
    """
    found: list[Remedy] = []
    if not hopeless:
        found += _longer(first, second, judged(states)) or _faster(first, second, states, judged)
    records = dict.fromkeys((first.kind.record, second.kind.record))
    if hopeless and first.kind is second.kind:  # what shows such an effect shows it at either joint
        records = dict.fromkeys((f"{first.kind.name.replace('_', ' ')} of one of the joints, measured by itself",))
    return (*found, *(Remedy("record", words) for words in records))


def _probability(pair: tuple[Hypothesis, Hypothesis], distances: Mapping[tuple[str, str], Distance]) -> float:
    names = pair[0].name, pair[1].name
    ways = [distances[key].probability for key in (names, names[::-1]) if key in distances]
    return sum(ways) / len(ways) if ways else 0.0


def _longer(first: Hypothesis, second: Hypothesis, distances: Mapping[tuple[str, str], Distance]) -> list[Remedy]:
    for times in TIMES:
        longer = {key: distance.times(times) for key, distance in distances.items()}
        probability = _probability((first, second), longer)
        if probability >= LIKELY:
            return [Remedy("longer", f"the motion {times} times over, in one log", probability)]
    return []


def _faster(first: Hypothesis, second: Hypothesis, states: States, judged: Judged) -> list[Remedy]:
    """Return at which other speed the motion would decide, beyond the limits or slower at the same length."""
    q, dq, ddq = states
    found = []
    for speed in SPEEDS:
        size = round(len(q) / speed)
        places = [min(round(k * speed), len(q) - 1) for k in range(size)]
        moved = (q[places], speed * dq[places], speed**2 * ddq[places])
        probability = _probability((first, second), judged(moved))
        if probability >= LIKELY:
            how = f"{speed:g} times the speed, beyond the limits" if speed > 1 else "half the speed, in twice the time"
            found.append(Remedy("speed", f"the motion at {how}", probability))
    return found
