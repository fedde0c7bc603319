"""Parts of a log that the user wants left out: seconds from its first sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

from elid_cli.errors import UsageError

KEY = "leave_out"
"""Beside the signals of a mapping; on the command line ``--leave-out``."""
EXAMPLE = "leave_out: [[6, 6.4], [11.2, 12]], in s from the first sample"
Spans: TypeAlias = tuple[tuple[float, float], ...]


def parse_left_out(entry: Any, where: str) -> Spans:
    """Return the spans (start, stop), s, that a mapping leaves out.

    Raises
    ------
    UsageError
        If they are no pairs of numbers, or end before they start.
    """
    spans = []
    for item in entry if isinstance(entry, list | tuple) else [entry]:
        pair = item if isinstance(item, list | tuple) else ()
        numbers = [float(x) for x in pair if isinstance(x, int | float) and not isinstance(x, bool)]
        if len(pair) != 2 or len(numbers) != 2 or not all(map(math.isfinite, numbers)):
            raise UsageError(f"{where}: {KEY}: expected a start and an end", detail=f"found {item!r:.60}", hint=EXAMPLE)
        if not 0 <= numbers[0] < numbers[1]:
            raise UsageError(f"{where}: {KEY}: {numbers[0]:g} to {numbers[1]:g} s is no part of a log", hint=EXAMPLE)
        spans.append((numbers[0], numbers[1]))
    return tuple(spans)


def left_out_of(mapping: Mapping[str, Any] | None, logs: int, what: str = "logs") -> Spans:
    """Return the spans that the mapping of some logs leaves out; `what` they are.

    Raises
    ------
    UsageError
        If there are any, and several logs: it is not said of which.
    """
    spans = parse_left_out(mapping[KEY], "--map") if mapping and KEY in mapping else ()
    if spans and logs > 1:
        raise UsageError(
            f"parts to leave out of {logs} {what}",
            detail="their times are those of one log",
            hint="elid reduce each of them, from a file of its own, with its own --leave-out, then identify all",
        )
    return spans
