"""Which clock a log is read by, and its stamps in seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.logs.contract import Stream
from elid_cli.logs.repair.damage import Damage

TIME_SOURCES = {"auto": "", "header": "header stamp", "log": "log time"}
"""Values of --time -> the clock's name."""
LONGEST = 1e10
"""s; stamps further than this from the others are broken ones."""
UNRULY = 0.05
"""Share of backward steps above which a clock is not taken as increasing."""
BACKWARDS, ZERO = "run backwards", "are zero"
APART = 0.1
"""Share of a log's duration by which the middle 90 % of header stamps may run apart from the log time, to be stamps
that only come out of order: those of a clock that runs backwards, wraps or is of any other kind run apart by more."""
BLOCK = 1 << 15
"""Stamps looked at at a time."""
EPOCHS = ((1e17, 1e-9, "ns"), (1e14, 1e-6, "µs"), (1e11, 1e-3, "ms"))
"""A time this large can only be counted from 1970 in this unit (1e9 s is 2001)."""


def in_seconds(
    streams: Sequence[Stream],
    *,
    source: str = "auto",
    factor: float | None = None,
    rate: float | None = None,
    name: str = "log",
    notes: list[str],
    repairs: list[str] | None = None,
) -> list[Array]:
    """Return every stream's stamps in s from one common origin; streams sampled together share one array.

    What was decided goes to `notes`, what was mended to `repairs` (None: to the notes).

    Raises
    ------
    UsageError
        If `source` is not one of `TIME_SOURCES`.
    LogError
        If the log has no time and no `rate` is given.
    """
    if source not in TIME_SOURCES:
        raise UsageError(f"--time: unknown clock {source!r}", hint=f"one of {', '.join(TIME_SOURCES)}")
    clock = _choose(streams, TIME_SOURCES[source], notes, notes if repairs is None else repairs)
    if clock is None:
        if rate is None:
            raise LogError(
                f"{name}: no time",
                detail="it has no column, dataset or stamp that elid takes for t",
                hint="name it in a mapping (--map t=PLACE), or give the sample rate: --rate 1000",
            )
        notes.append(f"the log has no time: {rate:g} Hz as given")
        return [np.arange(stream.values.shape[0]) / rate for stream in streams]
    unique: dict[int, NDArray[Any]] = {}
    lost: dict[int, NDArray[np.bool_]] = {}
    zeros = 0
    for stream in streams:
        key = id(stream.clocks[clock])
        if key not in unique:
            unique[key] = stream.clocks[clock]
            if clock == "header stamp":
                unique[key], lost[key] = _mended(unique[key], stream.clocks["log time"])
                mended = (unique[key] != stream.clocks[clock]) & ~lost[key]
                told = np.isfinite(stream.values[mended]).any(axis=1)
                zeros = max(zeros, int(np.count_nonzero(told)))
    if zeros:
        (notes if repairs is None else repairs).append(
            f"{zeros} header stamp{'s are' if zeros > 1 else ' is'} zero: taken by the log time"
        )
    seconds = _from_origin(unique, factor, notes, name, another_clock(streams, source))
    for key, without in lost.items():
        seconds[key][without] = np.nan
    return [seconds[id(stream.clocks[clock])] for stream in streams]


def another_clock(streams: Sequence[Stream], asked: str = "auto") -> str:
    """Return what a log whose time is of no use may be read with: a clock of its own that was not asked for."""
    held = set.intersection(*(set(stream.clocks) for stream in streams)) if streams else set()
    other = "header" if asked == "log" else "log"
    return "--map t=PLACE" + (f", or --time {other}" if TIME_SOURCES[other] in held else "")


def _choose(streams: Sequence[Stream], asked: str, notes: list[str], repairs: list[str]) -> str | None:
    clocks = [set(stream.clocks) for stream in streams]
    common = set.intersection(*clocks) if clocks else set()
    if not common:
        return None
    if asked:
        if asked in common:
            notes.append(f"time is the {asked}, as asked")
            return asked
        notes.append(f"the log has no {asked}: its own time is taken")
    if "t" in common:
        return "t"
    unusable = next((reason for stream in streams if (reason := _unfit(stream))), "")
    if not unusable:
        return "header stamp"
    if any(_unusable(stream.clocks["log time"]) for stream in streams) and unusable != ZERO:
        return "header stamp"
    said = f"header stamps {unusable}: time is the log time"
    if unusable == ZERO:  # nobody set them: the log time is what stands for them
        notes.append(said)
    else:
        repairs.append(Damage(said) if unusable == BACKWARDS else said)
    return "log time"


def _unfit(stream: Stream) -> str:
    """Return why the header stamps of a stream cannot be used, or an empty text.

    Messages are stored as they arrive, and may arrive out of order: their stamps then still go with the log time.
    """
    stamps, logged = stream.clocks["header stamp"], stream.clocks["log time"]
    reason = _unusable(stamps)
    if reason != BACKWARDS:
        return reason
    known = stamps != 0
    apart = np.quantile((stamps[known] - stamps[known][0]) - (logged[known] - logged[known][0]), (0.05, 0.95))
    return reason if float(np.ptp(apart)) > APART * float(np.ptp(logged[known])) else ""


def _unusable(stamps: NDArray[np.int64]) -> str:
    """Return why a clock cannot be used, or an empty text."""
    if stamps.size < 2:
        return ""
    if np.count_nonzero(stamps) < 0.5 * stamps.size:
        return ZERO
    moving, backwards = False, 0
    for start in range(0, stamps.size - 1, BLOCK):
        steps = np.diff(stamps[start : start + BLOCK + 1])
        moving = moving or bool(steps.any())
        backwards += int(np.count_nonzero(steps < 0))
    if not moving:
        return "never advance"
    if backwards > UNRULY * (stamps.size - 1):
        return BACKWARDS
    return ""


def _mended(stamps: NDArray[np.int64], logged: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return header stamps in which single zero ones follow the log time, and which have none and so are any number.

    The two clocks may be apart and drift: a stamp lies between its neighbours as its log time does between theirs.
    """
    zero = stamps == 0
    nothing = np.zeros(stamps.size, dtype=bool)
    if np.count_nonzero(zero) in (0, stamps.size):  # one message alone may have a stamp of zero
        return stamps, nothing
    known = np.flatnonzero(~zero)
    span = int(stamps[known].max()) - int(stamps[known].min()) + 10**9
    if stamps[known].min() < span:  # a clock that starts at zero, as simulators' do: only amid its run is zero wrong
        after = np.searchsorted(known, np.arange(stamps.size))
        before, behind = stamps[known[np.maximum(after - 1, 0)]], stamps[known[np.minimum(after, known.size - 1)]]
        zero &= (after > 0) & (after < known.size) & (before < behind)
    if not zero.any():
        return stamps, nothing
    mended = stamps.copy()
    if _unusable(logged):
        mended[zero] = stamps[known[0]]
        return mended, zero
    order = known[np.argsort(logged[known], kind="stable")]
    apart = stamps[order] - logged[order]
    first, start = int(apart[0]), int(logged.min())  # what is left of them floats hold exactly
    there = np.interp(
        (logged[zero] - start).astype(float), (logged[order] - start).astype(float), (apart - first).astype(float)
    )
    mended[zero] = logged[zero] + first + np.rint(there).astype(np.int64)
    nothing[zero] = np.abs(mended[zero] - float(stamps[known].mean())) > 2 * span  # no log time either
    mended[nothing] = stamps[known[0]]
    return mended, nothing


def _from_origin(
    unique: Mapping[int, NDArray[Any]], factor: float | None, notes: list[str], name: str, other: str
) -> dict[int, Array]:
    """Subtract the earliest stamp while the numbers are exact, then scale to s."""
    ends = {key: found for key, stamps in unique.items() if (found := _extremes(stamps)) is not None}
    if not ends:
        raise LogError(f"{name}: its time holds no numbers", hint=f"name another clock: {other}")
    whole = all(stamps.dtype.kind == "i" for stamps in unique.values())
    if whole:
        factor = 1e-9
    elif factor is None:
        largest = max(abs(end) for pair in ends.values() for end in pair)
        epoch = largest > EPOCHS[-1][0]  # else no stamp can be one
        factor = _epoch_unit(max(abs(_middle(unique[key])) for key in ends), notes) if epoch else 1.0
    first, last = min(low for low, _ in ends.values()), max(high for _, high in ends.values())
    if not (last - first) * factor < LONGEST:  # broken stamps among them: those near the middle tell the origin
        first = _believed_origin([unique[key] for key in ends], factor)
    return {key: _scaled(stamps, first, factor) for key, stamps in unique.items()}


def _extremes(stamps: NDArray[Any]) -> tuple[Any, Any] | None:
    """Return the smallest and the largest number, exactly; None where there is none."""
    if not stamps.size:
        return None
    low, high = stamps.min().item(), stamps.max().item()
    if np.isfinite(low) and np.isfinite(high):
        return low, high
    known = stamps[np.isfinite(stamps)]
    return (known.min().item(), known.max().item()) if known.size else None


def _middle(stamps: NDArray[Any]) -> float:
    return float(np.median(stamps[np.isfinite(stamps)]))


def _believed_origin(clocks: Sequence[NDArray[Any]], factor: float) -> Any:
    """Return the earliest stamp that is not far from the middle of the first clock."""
    middle = _middle(clocks[0])
    believed = [stamps[np.abs(stamps - middle) < LONGEST / factor] for stamps in clocks]
    return min((stamps.min() for stamps in believed if stamps.size), default=middle)


def _scaled(stamps: NDArray[Any], origin: Any, factor: float) -> Array:
    """Return stamps in s from an origin, NaN where they are broken; a block at a time, to touch no further memory."""
    t = np.empty(stamps.size)
    for start in range(0, stamps.size, BLOCK):
        here = t[start : start + BLOCK]
        with np.errstate(over="ignore"):
            np.multiply(stamps[start : start + BLOCK] - origin, factor, out=here)
        broken = ~(np.abs(here) < 2 * LONGEST)
        if broken.any():
            here[broken] = np.nan
    return t


def _epoch_unit(largest: float, notes: list[str]) -> float:
    for limit, factor, unit in EPOCHS:
        if largest > limit:
            notes.append(f"time is {unit} since 1970, by its size")
            return factor
    return 1.0
