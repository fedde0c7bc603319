"""Where in a log the robot stands: no joint moves further than noise, or a small part of what it moves elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.grid import Grid
from elid_cli.memory import let_go
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import noise_between_jumps

PACE = 0.05
"""s over which a joint at rest moves a small part of what it moves elsewhere …"""
STILL = 0.03
"""… at most this much of it …"""
NOISES = 8.0
"""… or this many standard deviations of its position's noise."""
FEWEST = 4
"""Samples that `PACE` is at least."""
LOOKED_AT = 50_000
"""Samples that tell what a joint moves elsewhere, and its noise."""
GLANCE = 200
"""Samples that tell which side of a joint is known."""


@dataclass(frozen=True)
class Standing:
    """Positions of a log, one side of every joint, and how far each may move in `PACE` and still stand."""

    places: tuple[Array, ...]
    """(N,) each; joints without a position have none."""
    still: tuple[float, ...]
    """rad (m), of each of these."""
    grid: Grid

    @classmethod
    def of(cls, signals: Mapping[str, Array], grid: Grid) -> Standing:
        """Return it of signals on a grid, (N, n) each: of both sides of a joint that of which more is known."""
        sides = [signals[side] for side in ("theta", "q") if side in signals]
        known = [np.isfinite(side[:: max(1, len(side) // GLANCE)]).sum(axis=0) for side in sides]
        best = np.argmax(known, axis=0) if sides else ()
        places = tuple(sides[side][:, joint] for joint, side in enumerate(best) if known[side][joint])
        start, stop = longest(grid)
        lag = _lag(start, stop, grid)
        still = []
        for place in places:
            part = place[start:stop]
            usual = float(np.nanpercentile(np.abs(part[lag:] - part[:-lag]), 90))
            (noise,) = noise_between_jumps(part[:, None], (Segment(0, len(part)),), grid.dt)
            still.append(max(STILL * usual, NOISES * float(np.nan_to_num(noise))))
        let_go(*places)
        return cls(places, tuple(still), grid)

    def moves(self, start: int, stop: int) -> NDArray[np.bool_]:
        """Return from which samples of a part of one segment on some joint moves, but for its last `PACE`."""
        lag = _lag(start, stop, self.grid)
        found = np.zeros(stop - start - lag, dtype=bool)
        for place, still in zip(self.places, self.still, strict=True):
            found |= ~(np.abs(place[start + lag : stop] - place[start : stop - lag]) <= still)  # a hole tells nothing
        let_go(*self.places)
        return found

    def about(self, row: int) -> bool:
        """Whether the robot stands `PACE` before and after a sample, as far as its segment goes."""
        first, last = segment_of(row, self.grid)
        lag = round(PACE / self.grid.dt)
        start, stop = max(first, row - lag), min(last, row + lag + 1)
        return stop - start > FEWEST + 1 and not self.moves(start, stop).any()

    def until_rest(self, start: int, stop: int) -> int | None:
        """Return for how many samples of a part of a segment the robot moves; None where it does not come to rest.

        It may still move where the segment ends.
        """
        moves = np.flatnonzero(found := self.moves(start, stop))
        if not moves.size:
            return 0
        rests = moves[-1] + 1 < found.size or stop == segment_of(start, self.grid)[1]
        return int(moves[-1]) + _lag(start, stop, self.grid) if rests else None


def longest(grid: Grid) -> tuple[int, int]:
    """Return the first samples, `LOOKED_AT` at most, of the longest segment: from, to."""
    start, stop = max(grid.bounds(), key=lambda bounds: bounds[1] - bounds[0])
    return start, min(stop, start + LOOKED_AT)


def segment_of(row: int, grid: Grid) -> tuple[int, int]:
    """Return the segment that a sample lies in: from, to."""
    return next(bounds for bounds in grid.bounds() if bounds[0] <= row < bounds[1])


def _lag(start: int, stop: int, grid: Grid) -> int:
    return min(max(FEWEST, round(PACE / grid.dt)), stop - start - 1)
