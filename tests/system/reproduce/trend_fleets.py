"""How often ``elid trend`` finds wear, and how often it names a change where there is none.

    python -m tests.system.reproduce.trend_fleets [--fleets 200] [--quiet 0] [--first 0]

Every fleet is one machine of 40 parameters over its recordings. Values scatter between recordings by twice the standard
error of one recording, which the standard errors do not know.

A robot has twelve joints, each with viscous friction, Coulomb friction and a rotor inertia that scatter between
recordings by 6, 6 and 2 %, each by its own. Warming up, viscous friction falls by 15 to 25 % from first to last, each
joint by a share of its own. Where sessions differ, viscous friction of all joints has a factor of its own in each
recording, and no trend. The table counts robots of which it is said that viscous friction differs alike at all joints
between recordings (a line included), of which a line is named, and of which any change is named that is none.

--quiet N: nothing but the share of N robots without and N with differing sessions on which a change is named that is
none, or a recording that stands out, with its 95 % interval. --first moves all seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

import numpy as np

from elid_cli.estimation.comparison import Estimate, SavedResult
from elid_cli.estimation.trend.families import Family
from elid_cli.estimation.trend.trends import Trends, trend

PARAMETERS = 40
ERROR, BETWEEN = 0.002, 0.004
"""Standard error of one recording and spread between recordings, as parts of a value."""
WEAR = 0.03 / 100
"""Part of a value by which the worn parameter falls from one recording to the next."""

FOREIGN = 0.05
"""Part by which all parameters of a recording that stands out differ."""

SCATTER = {"fv": 0.06, "fs": 0.06, "Ja": 0.02}
"""Spread between recordings of every kind of a robot's parameters, as a part of a value."""
STILL = (0.0, 0.0)
CASES: tuple[tuple[str, int, dict[str, Any]], ...] = (
    ("nothing changes", 20_000, {"fall": STILL}),
    ("viscous friction falls by 15 to 25 %", 30_000, {}),
    ("sessions differ by 5 %, nothing falls", 40_000, {"fall": STILL, "session": 0.05}),
    ("sessions differ by 5 %, and it falls", 50_000, {"session": 0.05}),
)
"""What robots do, their first seed, and how `robot` makes them."""


def fleet(seed: int, recordings: int, wear: float = 0.0, parameters: int = PARAMETERS, foreign: float = 0.0) -> Trends:
    """Return the trends of one machine; the first parameter wears, and one recording may differ in all by a part."""
    rng = np.random.default_rng(seed)
    values = 1.0 + np.hypot(ERROR, BETWEEN) * rng.standard_normal((recordings, parameters))
    values[:, 0] -= wear * np.arange(recordings)
    values[rng.integers(recordings)] *= 1.0 + foreign
    results = [
        SavedResult(f"{k}.json", "arm", {f"p{j}": Estimate(float(v), ERROR, "N·m") for j, v in enumerate(row)}, {})
        for k, row in enumerate(values)
    ]
    return trend(results)


def robot(
    seed: int,
    fall: tuple[float, float] = (0.15, 0.25),
    recordings: int = 5,
    session: float = 0.0,
    warmth: float = 0.0,
    joints: int = 12,
) -> Trends:
    """Return the trends of a robot that warms up, or of one whose sessions differ.

    Parameters
    ----------
    fall
        Least and largest part by which a joint's viscous friction falls from first to last.
    session
        Spread of a factor of viscous friction that all joints of a recording share.
    warmth
        Part of viscous friction lost per kelvin, at temperatures of their own in each recording, 20 to 35 °C.
    """
    rng = np.random.default_rng(seed)
    falls = rng.uniform(*fall, joints)
    results = []
    for k in range(recordings):
        temperature = rng.uniform(20.0, 35.0) if warmth else None
        shared = 1.0 + session * rng.standard_normal() - (warmth * (temperature - 20.0) if temperature else 0.0)
        values = {
            f"{kind}{j + 1}": (1.0 + scatter * rng.standard_normal())
            * (shared * (1.0 - falls[j] * k / (recordings - 1)) if kind == "fv" else 1.0)
            for kind, scatter in SCATTER.items()
            for j in range(joints)
        }
        told = {name: Estimate(float(value), 0.5 * SCATTER[name[:2]], "N·m") for name, value in values.items()}
        results.append(SavedResult(f"{k}.json", "dog", told, {}, temperature=temperature))
    return trend(results)


def changed(found: Trends) -> list[str]:
    """Return what is named as changed: parameters, and kinds of them at all joints."""
    alone = [item.series.name for item in found.of("trend", "step")]
    return alone + [family.kind for family in found.families if family.word == "trend"]


def alarmed(found: Trends) -> bool:
    """Whether ``--fail-on-trend`` fails: something is named as changed, or a recording stands out."""
    return bool(changed(found) or found.stands_out)


def viscous(found: Trends) -> Family:
    """Return the family of viscous friction."""
    return next(item for item in found.families if item.kind == "fv")


def main() -> None:
    """Print all shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fleets", type=int, default=200)
    parser.add_argument("--quiet", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    told = parser.parse_args()
    if told.quiet:
        quiet_robots(told.quiet, told.first)
    else:
        everything(told.fleets, told.first)


def quiet_robots(count: int, begin: int) -> None:
    """Print how often a change is named where there is none."""
    from scipy.stats import binomtest

    for words, first, options in CASES:
        for recordings in (12, 30) if options.get("fall") == STILL else ():
            seeds = range(first + begin, first + begin + count)
            wrong = sum(alarmed(robot(seed, recordings=recordings, **options)) for seed in seeds)
            low, high = binomtest(wrong, count).proportion_ci(method="exact")
            print(f"{words:38} {recordings:10} recordings: {wrong} of {count}, {100 * wrong / count:.2f} % "
                  f"({100 * low:.2f} to {100 * high:.2f})", flush=True)  # fmt: skip


def everything(count: int, begin: int) -> None:
    """Print all shares but those of `quiet_robots`."""
    found = sum(fleet(begin + seed, 60, WEAR).trends[0].word in ("trend", "step") for seed in range(count))
    quiet = sum(alarmed(fleet(begin + 10_000 + seed, 100)) for seed in range(count))
    print(f"wear of 3 % per 100 recordings named by recording 60: {found} of {count}")
    odd = [fleet(begin + seed, 60, WEAR, foreign=FOREIGN) for seed in range(count)]
    seen = sum(len(item.stands_out) == 1 for item in odd)
    worn = sum(item.trends[0].word in ("trend", "step") for item in odd)
    print(f"the same with one recording {FOREIGN:.0%} off: this one named on {seen}, the wear on {worn}")
    print(f"quiet machines of {PARAMETERS} parameters and 100 recordings with an alarm: {quiet} of {count}")
    many = 5 * count
    print(f"\n{f'{many} robots of each kind':38} recordings   alike at all joints   a line   wrong")
    for words, first, options in CASES:
        for recordings in (5, 12, 30):
            told = [robot(begin + first + seed, recordings=recordings, **options) for seed in range(many)]
            own = [viscous(item) for item in told]
            alike, line = sum(item.word != "steady" for item in own), sum(item.word == "trend" for item in own)
            wrong = sum(any(_wrong(name, options) for name in changed(item)) for item in told)
            print(f"{words:38} {recordings:10} {alike:21} {line:8} {wrong:7}")
    own = [viscous(robot(begin + 60_000 + seed, STILL, 12, warmth=0.01)) for seed in range(count)]
    best = [item.explained[0] for item in own if item.explained]
    lone = [item for item in own if item.explained and all(e.ruled_out for e in item.explained[1:])]
    print(
        f"\nfriction that follows temperature, 12 recordings: temperature goes best with it in "
        f"{sum(e.by == 'temperature' for e in best)} of {count}, and time is ruled out in "
        f"{sum(item.explained[0].by == 'temperature' for item in lone)}; temperature is ruled out in "
        f"{sum(item.explained[0].by == 'time' for item in lone)}"
    )


def _wrong(name: str, options: Mapping[str, Any]) -> bool:
    """Return whether a change of this parameter or kind is none of such robots."""
    return options.get("fall") == STILL or not name.startswith("fv")


if __name__ == "__main__":
    main()
