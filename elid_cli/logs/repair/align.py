"""Bring every signal of a log onto one even time base; what was done is said, gaps are never interpolated across."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.logs.mapping.language import COMMANDS
from elid_cli.logs.repair.asked import without
from elid_cli.logs.repair.damage import Damage
from elid_cli.logs.repair.drives_off import drives_off
from elid_cli.logs.repair.grid import Grid, grid_of, identical, interpolate, onto, regularised
from elid_cli.logs.repair.reachable import SHORTEST, Sampled, possible
from elid_cli.logs.repair.samples import fill, without_glitches
from elid_cli.logs.repair.timeline import Timeline, build
from elid_cli.memory import let_go, passed, writable

REQUIRED = ("theta", "tau", "q")
"""Signals that decide the time base, in this order among equally fast ones."""
UNPLACED = 0.5
"""Share of samples whose stamp is that of another one above which the clock is of no use."""
COVERED = 0.9
"""Share of the samples that an optional signal has to cover to be kept."""
NAMED_GAPS = 3
LARGEST = 1e12
"""A larger value, in SI units, is a broken one."""
SLOWEST = 0.2
"""s; a signal sampled at longer intervals tells nothing about a motion."""
DENSE = 0.8
"""Share of numbers in a column below which it has stamps of its own rather than missing values."""


@dataclass(frozen=True)
class Aligned:
    """All signals on one time base, shape (N, n) each; NaN columns where a joint has none."""

    t: Array
    dt: float
    signals: Mapping[str, Array]
    segments: tuple[tuple[int, int], ...]
    repairs: tuple[str, ...]
    bridged: tuple[tuple[str, int, Array], ...] = ()
    """Signal, joint and the times, s, shape (K,), of samples that were missing and are interpolated."""


@dataclass(frozen=True)
class _Track:
    signal: str
    joints: tuple[int, ...]
    values: Array
    line: Timeline


def align(
    streams: Sequence[Sampled], joints: Sequence[str], name: str, other: str = "--map t=PLACE",
    spans: Sequence[tuple[float, float]] = (),
) -> Aligned:  # fmt: skip
    """Return all signals on the time base of the fastest required one; `other` names clocks to try in its place.

    `spans` are left out, s from the first sample.

    Raises
    ------
    LogError
        If the time of the required signals never advances or no usable stretch is left.
    UsageError
        If there is no sample in one of the spans.
    """
    repairs: list[str] = []
    sound: set[int] = set()
    streams = [_unbroken(stream, joints, repairs) for stream in streams]
    whole = [piece for stream in streams for piece in _without_holes(stream, repairs, sound)]
    lines = _timelines(whole, repairs, name, other)
    whole, lines = possible(whole, lines, joints, repairs, sound, name)
    tracks = [track for stream in whole for track in _tracks(stream, lines[id(stream)], joints, repairs, sound)]
    required = [track for track in tracks if track.signal in REQUIRED]
    if not required:
        raise LogError(f"{name}: no usable samples", detail="theta, q and tau hold no numbers")
    leader = min(
        required, key=lambda track: (round(track.line.dt, 9), -track.line.t.size, REQUIRED.index(track.signal))
    )
    grid = grid_of(leader.line)
    signals = _assemble(tracks, grid, joints, leader, repairs)
    bridged = fill(signals, grid, joints, repairs, sound)
    usable = _usable(signals, grid, joints, repairs, sound)
    shown = grid.shortened().times()
    shown -= shown[np.argmax(usable)]
    mask = drives_off(signals, grid, without(spans, shown, grid.dt, usable, name, repairs), shown, repairs)
    cut = _cut(signals, grid, mask, shown, repairs, name)
    if not bridged:
        return cut
    return replace(cut, bridged=tuple((signal, joint, shown[where]) for signal, joint, where in bridged))


def _without_holes(stream: Sampled, repairs: list[str], sound: set[int]) -> Iterator[Sampled]:
    """Yield a stream without the rows that hold nothing for it; columns with stamps of their own become streams.

    A topic may be shared by publishers that each know some joints, a CSV table by channels of different rates.
    """
    if _sound(stream.values):
        sound.add(id(stream.values))
        let_go(stream.values)
        yield stream
        return
    finite = _numbers(stream.values)
    groups: dict[bytes, list[int]] = {}
    for k in range(len(stream.joints)):
        share = np.count_nonzero(finite[:, k]) / max(finite.shape[0], 1)
        if share > 0:
            groups.setdefault(finite[:, k].tobytes() if share < DENSE else b"", []).append(k)
    for columns in groups.values():
        held = np.asarray(finite[:, columns].any(axis=1))
        missing = stream.missing(held, columns)
        if 0 < missing < (1 - DENSE) * held.size:
            repairs.append(Damage(f"{stream.signal}: {missing} of {held.size} samples hold no number, left out"))
        t, values, off = stream.t, stream.values, stream.off
        if not held.all():
            t, values, off = t[held], values[held], off if off is None else off[held]
        if len(columns) < len(stream.joints):
            values, off = values[:, columns], off if off is None else off[:, columns]
        yield Sampled(stream.signal, tuple(stream.joints[k] for k in columns), values, t, off)


def _unbroken(stream: Sampled, joints: Sequence[str], repairs: list[str]) -> Sampled:
    """Return a stream with its broken samples as NaN."""
    values = without_glitches(stream.signal, [joints[j] for j in stream.joints], stream.values, repairs)
    return stream.with_values(values)


def _sound(values: Array) -> bool:
    """Whether all values are numbers of a believable size (NaN spread through min and max)."""
    return values.size > 0 and all(bool(b.min() > -LARGEST and b.max() < LARGEST) for b in passed(values))


def _numbers(values: Array) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < LARGEST)


def _timelines(streams: Sequence[Sampled], repairs: list[str], name: str, other: str) -> dict[int, Timeline | None]:
    """Return the timeline of every stream (by identity); equal clocks share one. None: its time never advances."""
    groups: list[list[Sampled]] = []
    for stream in streams:
        twin = next((group for group in groups if _same(group[0].t, stream.t)), None)
        if twin is None:
            groups.append([stream])
        else:
            twin.append(stream)
    lines: dict[int, Timeline | None] = {}
    shifts: tuple[tuple[float, float], ...] = ()
    for members in groups:
        label = "/".join(dict.fromkeys(stream.signal for stream in members)) if len(groups) > 1 else "time"
        judge = next((stream for stream in members if stream.signal in ("theta", "q")), members[0])
        line = build(judge.t, judge.values, label, shifts)
        if line is None and any(stream.signal in REQUIRED for stream in members):
            raise _at_one_instant(name, label, judge.t.size, other)
        if line is not None and line.unplaced > UNPLACED * judge.t.size:
            raise _stands_still(name, label, line.unplaced, judge.t.size, other)
        if line is not None:
            line = regularised(line, judge.values, label)
            repairs.extend(line.repairs)
            shifts = shifts or line.shifts
        lines.update((id(stream), line) for stream in members)
    return lines


def _tracks(
    stream: Sampled, line: Timeline | None, joints: Sequence[str], repairs: list[str], sound: Collection[int]
) -> Iterator[_Track]:
    """Yield a stream without its sporadic missing values: columns that miss the same samples stay together."""
    if line is None:
        return
    if id(stream.values) in sound or _sound(stream.values):
        yield _Track(stream.signal, stream.joints, stream.values, line)
        return
    finite = _numbers(stream.values)
    groups: dict[bytes, list[int]] = {}
    for k in range(len(stream.joints)):
        groups.setdefault(finite[:, k].tobytes(), []).append(k)
    for columns in groups.values():
        held = finite[:, columns[0]]
        missing = stream.missing(held, columns)
        if missing:
            who = " ".join(joints[stream.joints[k]] for k in columns)
            count = f"{missing} of {held.size} values"
            repairs.append(Damage(f"{stream.signal} of {who}: {count} are not numbers, left out"))
        sub = line if held.all() else line.subset(held)
        if sub.t.size >= 2:
            yield _Track(stream.signal, tuple(stream.joints[k] for k in columns), stream.values[:, columns], sub)


def _assemble(
    tracks: Sequence[_Track], grid: Grid, joints: Sequence[str], leader: _Track, repairs: list[str]
) -> dict[str, Array]:
    n = len(joints)
    signals: dict[str, Array] = {}
    apart: dict[str, float] = {}
    even = {id(line): identical(line, grid) for line in {id(track.line): track.line for track in tracks}.values()}
    for track in tracks:
        if track.line.dt > SLOWEST and grid.dt < SLOWEST and track.signal != "temperature":
            who = " ".join(joints[j] for j in track.joints)
            repairs.append(f"{track.signal} of {who} comes at {1 / track.line.dt:.3g} Hz, too slow: not used")
            continue
        if track.joints == tuple(range(n)) and track.signal not in signals and even[id(track.line)]:
            signals[track.signal] = track.values
            continue
        target = signals.setdefault(track.signal, np.full((grid.samples, n), np.nan))
        values, interpolated = onto(grid, track.line, track.values, held=track.signal in COMMANDS)
        target[:, list(track.joints)] = values
        if interpolated and track.line is not leader.line:
            apart[track.signal] = 1 / track.line.dt
    if apart:
        who = ", ".join(f"{signal} ({rate:.5g} Hz)" for signal, rate in apart.items())
        repairs.append(f"interpolated to the sample times of {leader.signal} ({1 / grid.dt:.5g} Hz): {who}")
    return signals


def _usable(
    signals: dict[str, Array], grid: Grid, joints: Sequence[str], repairs: list[str], sound: Collection[int]
) -> NDArray[np.bool_]:
    """Return where every signal that the log has is known; optional ones with long holes are dropped."""
    mask = np.ones(grid.samples, dtype=bool)
    for signal in sorted(signals, key=lambda name: name not in REQUIRED):
        values = signals[signal]
        if id(values) in sound or np.isfinite(values.sum()):
            continue
        for j, joint in enumerate(joints):
            finite = np.isfinite(values[:, j])
            if not finite.any() or signal == "temperature":
                continue
            if signal not in REQUIRED and np.count_nonzero(finite & mask) < COVERED * np.count_nonzero(mask):
                values = signals[signal] = writable(values)
                values[:, j] = np.nan
                repairs.append(f"{signal} of {joint} misses too many samples and is not used")
                continue
            mask &= finite
    return mask


def _cut(
    signals: Mapping[str, Array], grid: Grid, mask: NDArray[np.bool_], shown: Array, repairs: list[str], name: str
) -> Aligned:
    """Cut the log into segments where everything is known; `shown` is the time of every sample, s, (N,)."""
    whole: list[tuple[int, int]] = []
    short = 0
    for start, stop in grid.bounds():
        edges = np.diff(np.concatenate([[False], mask[start:stop], [False]]).astype(np.int8))
        for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            if b - a >= SHORTEST:
                whole.append((start + int(a), start + int(b)))
            else:
                short += 1
    if not whole:
        known = int(np.count_nonzero(mask))
        raise LogError(
            f"{name}: {known} usable samples, at least {SHORTEST} in a row are needed",
            detail="; ".join(repairs[:2]),
            hint="elid info LOG shows rates and gaps of every channel",
        )
    if len(whole) > 1:
        t = grid.times()
        gaps = [(float(t[stop - 1]), float(t[begin] - t[stop - 1])) for (_, stop), (begin, _) in pairwise(whole)]
        longest = sorted(gaps, key=lambda gap: -gap[1])[:NAMED_GAPS]
        named = ", ".join(f"{length:.4g} s after t = {when - t[0]:.6g} s" for when, length in sorted(longest))
        more = f" and {len(gaps) - NAMED_GAPS} shorter" if len(gaps) > NAMED_GAPS else ""
        said = f"{len(gaps)} gap{'s' * (len(gaps) > 1)}, split there: {named}{more}"
        lost = len(grid.bounds()) > 1  # else all are of drives that were off, or were asked for
        repairs.append(Damage(said) if lost else said)
    if short:
        repairs.append(f"{short} segment{'s' * (short > 1)} of fewer than {SHORTEST} samples between gaps left out")
    segments: list[tuple[int, int]] = []
    for start, stop in whole:
        begin = segments[-1][1] if segments else 0
        segments.append((begin, begin + stop - start))
    if segments[-1][1] == grid.samples:
        kept, rows = dict(signals), None
    else:
        rows = np.concatenate([np.arange(start, stop) for start, stop in whole])
        kept = {signal: values[rows] for signal, values in signals.items()}
    return Aligned(shown if rows is None else shown[rows], grid.dt, kept, tuple(segments), tuple(repairs))


def _at_one_instant(name: str, label: str, samples: int, other: str) -> LogError:
    if samples < SHORTEST:
        return LogError(
            f"{name}: {samples} sample{'s' * (samples != 1)} of {label}",
            detail=f"at least {SHORTEST} in a row are needed",
            hint="record a longer motion",
        )
    return LogError(
        f"{name}: time never advances",
        detail=f"the stamps of {label} hold a single instant in {samples} samples",
        hint=f"name another clock: {other}",
    )


def _stands_still(name: str, label: str, repeated: int, samples: int, other: str) -> LogError:
    return LogError(
        f"{name}: time stands still",
        detail=f"{repeated} of {samples} samples of {label} have the same stamp as another, different one",
        hint=f"name another clock: {other}",
    )


def _same(a: Array, b: Array) -> bool:
    return a is b or (a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=True)))


def resampled(
    aligned: Aligned, signals: Mapping[str, Array], dt: float
) -> tuple[Array, dict[str, Array], list[tuple[int, int]]]:
    """Bring a log to another sample time, stretch by stretch."""
    pieces: dict[str, list[Array]] = {signal: [] for signal in signals}
    times: list[Array] = []
    bounds: list[tuple[int, int]] = []
    for start, stop in aligned.segments:
        t = aligned.t[start:stop]
        at = t[0] + dt * np.arange(int(np.floor((t[-1] - t[0]) / dt + 1e-9)) + 1)
        for signal, values in signals.items():
            pieces[signal].append(interpolate(t, values[start:stop], at))
        first = bounds[-1][1] if bounds else 0
        bounds.append((first, first + at.size))
        times.append(at)
    return np.concatenate(times), {signal: np.concatenate(parts) for signal, parts in pieces.items()}, bounds
