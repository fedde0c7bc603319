"""Samples that the motion cannot reach, taken out of their stream."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.logs.repair.damage import Damage
from elid_cli.logs.repair.dropouts import impossible
from elid_cli.logs.repair.timeline import Timeline

SHORTEST = 20
"""Samples of a stretch below which it is of no use."""
POSITIONS = {"q": "theta", "theta": "q"}
"""Signals that move without a step, and the other side of the transmission."""
TOGETHER = 2.5
"""Sample times within which both sides of a transmission jump at once."""


Lost = dict[int, list[tuple[int, float]]]
"""Column -> samples that were taken out of every stretch, and how far the farthest was away."""


@dataclass(frozen=True)
class Sampled:
    """One stream in SI units: its columns are `joints` (from 0) of `signal`."""

    signal: str
    joints: tuple[int, ...]
    values: Array
    """Shape (N, len(joints))."""
    t: Array
    """s, shape (N,), in the order of the file."""
    off: NDArray[np.bool_] | None = None
    """Which values were numbers and have been taken out, which is said; None: none."""

    def with_values(self, values: Array) -> Sampled:
        """Return the stream with some of its values taken out (NaN)."""
        if values is self.values:
            return self
        off = np.isfinite(self.values) & np.isnan(values)
        return replace(self, values=values, off=off if self.off is None else off | self.off)

    def missing(self, held: NDArray[np.bool_], columns: Sequence[int]) -> int:
        """Return how many rows that are not `held`, shape (N,), lack what the log itself does not hold in `columns`."""
        lacking = ~held if self.off is None else ~held & ~self.off[:, columns].any(axis=1)
        return int(np.count_nonzero(lacking))


def possible(
    streams: Sequence[Sampled],
    lines: Mapping[int, Timeline | None],
    joints: Sequence[str],
    repairs: list[str],
    sound: set[int],
    name: str,
) -> tuple[list[Sampled], dict[int, Timeline | None]]:
    """Return the streams without samples that the motion cannot reach, and the timelines split where it jumps.

    Raises
    ------
    LogError
        If one side of a transmission jumps and stays away while the other goes on.
    """
    result: list[Sampled] = []
    kept: dict[int, Timeline | None] = {}
    jumps: dict[tuple[int, str], list[tuple[float, float]]] = {}
    for stream in streams:
        line = lines[id(stream)]
        values = stream.values
        if line is not None and stream.signal != "temperature":
            values, lost = _left(stream, line, jumps)
            if values is not stream.values:
                sound.discard(id(stream.values))
            for k, parts in lost.items():
                count, largest = sum(number for number, _ in parts), max(size for _, size in parts)
                where = f"{stream.signal} of {joints[stream.joints[k]]}"
                off = f"{count} sample{'s' * (count > 1)} off the motion left out (by up to {largest:.3g})"
                repairs.append(Damage(f"{where}: {off}"))
        stream = stream.with_values(values)
        result.append(stream)
        kept[id(stream)] = line
    held = {(joint, stream.signal) for stream in result for joint in stream.joints}
    for (joint, signal), places in jumps.items():
        other = (joint, POSITIONS.get(signal, ""))
        for when, size in places:
            near = any(abs(when - at) < TOGETHER * _slowest(kept) for at, _ in jumps.get(other, ()))
            if other in held and not near:
                raise LogError(
                    f"{name}: {signal} of {joints[joint]} jumps by {size:.3g} at t = {when:.6g} s and stays there",
                    detail=f"{other[1]} goes on as before: an encoder lost its place, or was set while recording",
                    hint="cut the log there, and use the parts as logs of their own",
                )
    at = np.unique([when for places in jumps.values() for when, _ in places])
    if at.size:
        who = " ".join(dict.fromkeys(joints[joint] for joint, _ in jumps if jumps[joint, _]))
        times = f"{at.size} time{'s' * (at.size > 1)}"
        repairs.append(Damage(f"the position of {who} jumps and stays, {times}: split there"))
    return result, {key: line.split(at) if line is not None and at.size else line for key, line in kept.items()}


def _left(
    stream: Sampled, line: Timeline, jumps: dict[tuple[int, str], list[tuple[float, float]]]
) -> tuple[Array, Lost]:
    """Return a stream's values without what the motion cannot reach, and what that was; lasting jumps go to `jumps`."""
    values, lost = stream.values, Lost()
    ordered = values if line.rows is None else values[line.rows]
    for start, stop in line.segments:
        found = impossible(ordered[start:stop], line.dt, jumpy=stream.signal not in POSITIONS)
        for k, what in found.items():
            times = [(float(line.t[start + row]), size) for row, size in what.jumps]
            jumps.setdefault((stream.joints[k], stream.signal), []).extend(times)
            if what.rows.size:
                values = values.copy() if values is stream.values else values
                rows = what.rows + start
                values[rows if line.rows is None else line.rows[rows], k] = np.nan
                lost.setdefault(k, []).append((rows.size, what.largest))
    return values, lost


def _slowest(lines: Mapping[int, Timeline | None]) -> float:
    return max((line.dt for line in lines.values() if line is not None), default=0.0)
