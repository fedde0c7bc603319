"""Motions among which the one that decides is sought: slow and fast, small and wide, together and one at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.experiment.bounds import ROOM, Bounds
from elid_cli.experiment.excitation import ENDS
from elid_cli.experiment.reference import DEGREE, ReferenceSpline, SplineReference

PER_LIMIT = 1.0
"""Knots in the time in which a joint comes from rest to its top speed and back."""
FEWEST = 12
"""Least control points of a joint between its ends."""
PACES = (1, 2, 3, 5, 8)
"""Knots between the way-points of a start."""
CHECKED = 50.0
"""Instants per second at which limits are checked while motions are sought."""


@dataclass(frozen=True)
class Family:
    """Quintic splines of one duration from rest to rest in the middle of every joint's range."""

    bounds: Bounds
    duration: float
    knots: tuple[Array, ...]
    home: Array

    @classmethod
    def of(cls, bounds: Bounds, duration: float, interval: float | None = None) -> Family:
        """Return the family within some limits; `interval` is the time between knots, s."""
        knots = []
        for speed, acceleration in zip(bounds.velocity, bounds.acceleration, strict=True):
            step = interval or PER_LIMIT * np.pi / 2 * speed / acceleration
            count = max(round(duration / step), FEWEST)
            inner = np.linspace(0.0, duration, count + 1)
            knots.append(np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, duration)]))
        return cls(bounds, duration, tuple(knots), 0.5 * (bounds.low + bounds.high))

    @property
    def reach(self) -> Array:
        """Half of every joint's range, at most half a turn, (n,)."""
        return np.minimum(0.5 * ROOM * (self.bounds.high - self.bounds.low), np.pi)

    def counts(self) -> list[int]:
        """Return the free control points of every joint."""
        return [len(knots) - DEGREE - 1 - 2 * ENDS for knots in self.knots]

    def motion(self, points: list[Array]) -> SplineReference:
        """Return the motion of free control points, in units of the reach, made as small as the joints' limits ask."""
        t = np.linspace(0.0, self.duration, max(round(self.duration * CHECKED), 20))
        splines = []
        for k, (knots, free) in enumerate(zip(self.knots, points, strict=True)):
            whole = np.concatenate([np.zeros(ENDS), self.reach[k] * free, np.zeros(ENDS)])
            unit = ReferenceSpline(knots, whole)
            most = [float(np.abs(unit.evaluate(t, order)).max()) for order in range(3)]
            allowed = (self.reach[k], ROOM * self.bounds.velocity[k], ROOM * self.bounds.acceleration[k])
            size = min([1.0, *(a / m for a, m in zip(allowed, most, strict=True) if m > 0)])
            splines.append(ReferenceSpline(knots, self.home[k] + size * whole))
        return SplineReference(tuple(splines), self.duration)

    def start(self, generator: np.random.Generator) -> list[Array]:
        """Return free control points of a random motion of random pace and size, joint by joint."""
        return [self._random(count, generator) for count in self.counts()]

    def changed(self, points: list[Array], size: float, generator: np.random.Generator) -> list[Array]:
        """Return control points of which a stretch of one joint, or all of one joint, is changed."""
        new = [part.copy() for part in points]
        k = int(generator.integers(len(new)))
        count = len(new[k])
        kind = generator.random()
        if kind < 0.15:
            new[k] = self._random(count, generator)
        elif kind < 0.25:
            new[k] = new[k] * float(np.exp(0.5 * generator.standard_normal()))
        else:
            width = int(generator.integers(1, max(count // 2, 2)))
            first = int(generator.integers(0, count - width + 1))
            smooth = np.interp(np.arange(width), *_few(width, generator))
            new[k][first : first + width] += size * smooth
        return new

    def _random(self, count: int, generator: np.random.Generator) -> Array:
        """Return a random motion of one joint: way-points some knots apart, at a size of its own in each half."""
        pace = int(generator.choice(PACES))
        ways = generator.uniform(-1.0, 1.0, count // pace + 2)
        sizes = np.exp(generator.uniform(np.log(0.15), 0.0, 2))
        envelope = np.where(np.arange(count) < count // 2, sizes[0], sizes[1])
        return np.asarray(envelope * np.interp(np.arange(count) / pace, np.arange(len(ways)), ways))


def _few(width: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return places and heights of a few corners over a stretch, so that slow changes are tried as well as quick."""
    corners = int(generator.integers(1, max(width, 2)))
    return np.linspace(0, max(width - 1, 1), corners + 1), generator.standard_normal(corners + 1)


def improved(
    family: Family,
    worth: Callable[[SplineReference], float],
    starts: int,
    steps: int,
    generator: np.random.Generator,
    progress: Callable[[float], None] | None = None,
) -> tuple[SplineReference, float]:
    """Return the best motion that is found by changing the best of some random ones, and its worth."""
    trials = [family.start(generator) for _ in range(starts)]
    worths = []
    for number, trial in enumerate(trials):
        worths.append(worth(family.motion(trial)))
        if progress is not None:
            progress((number + 1) / (starts + steps))
    order = np.argsort(worths)[::-1]
    best, value, size = trials[order[0]], worths[order[0]], 0.3
    for number in range(steps):
        if number % 7 == 6:  # one joint's motion from another start
            other = trials[order[int(generator.integers(min(len(order), 6)))]]
            k = int(generator.integers(len(best)))
            trial = [*best[:k], other[k], *best[k + 1 :]]
        else:
            trial = family.changed(best, size, generator)
        got = worth(family.motion(trial))
        if got > value:
            best, value, size = trial, got, min(1.5 * size, 1.0)
        else:
            size = max(0.93 * size, 0.05)
        if progress is not None:
            progress((starts + number + 1) / (starts + steps))
    return family.motion(best), value
