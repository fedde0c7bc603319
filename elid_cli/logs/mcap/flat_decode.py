"""Decode JSON and protobuf messages one by one: values by dotted path, then the columns that are wanted."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.logs.mcap.bulk_decode import SECOND, MessageTable, match_columns
from elid_cli.logs.mcap.container import Messages
from elid_cli.logs.mcap.fields import MessageShape

Flat = dict[str, list[Any]]
"""Values of a message by dotted path; ``path\\x00`` holds where each list of strings at that path begins."""
DEEPEST = 20
BYTES_OF_A_VALUE = 8
"""Bytes of a message that count as one step."""


class FlatDecoder:
    """Message-by-message decoder of channels whose messages flatten to values by path."""

    def __init__(self, flatten: Callable[[bytes], Flat | None]) -> None:
        self._flatten = flatten

    def shapes(self, messages: Messages, chosen: NDArray[np.intp]) -> list[MessageShape]:
        """Return the distinct shapes of some messages (for discovery)."""
        shapes: dict[str, MessageShape] = {}
        for index in chosen:
            flat = self._flat(messages, int(index))
            if flat is not None:
                shape = shape_of(flat)
                shapes.setdefault(repr(shape), shape)
        return list(shapes.values())

    def texts(self, messages: Messages, index: int) -> tuple[dict[str, list[str]], dict[str, float]]:
        """Return the strings and the single numbers of one message, by path."""
        flat = self._flat(messages, index) or {}
        shape = shape_of(flat)
        strings = {path: list(values) for path, values in shape.strings.items()}
        return strings, {path: flat[path][0] for path, width in shape.widths.items() if width == 1}

    def decode(self, messages: Messages, chosen: NDArray[np.intp], table: MessageTable) -> None:
        """Append the messages `chosen` (indices) to a table."""
        rows, stamps = table.extend(messages.log_times[chosen])
        for target in rows:
            target[:] = np.nan
        for row, index in enumerate(chosen):
            flat = self._flat(messages, int(index))
            if flat is None:
                table.undecodable += 1
                table.problem = table.problem or "not what its encoding says"
                continue
            shape = shape_of(flat)
            for (field, columns), target in zip(table.wanted, rows, strict=True):
                found = shape.columns(field)
                if found is None:
                    continue
                for put, take in match_columns(columns, found.labels, len(found.indices)):
                    target[row, put] = flat[found.path][found.indices[take]]
            stamps[row] = stamp_of(flat)
            if stamps[row] == 0 and misstamped(flat):
                table.misstamped += 1

    def _flat(self, messages: Messages, index: int) -> Flat | None:
        start, length = int(messages.offsets[index]), int(messages.lengths[index])
        messages.budget.step(1 + length // BYTES_OF_A_VALUE)
        return self._flatten(messages.data[start : start + length])


def flat_json(data: bytes) -> Flat | None:
    """Return the values of a JSON object by path, or None where it is none."""
    try:
        decoded = json.loads(data)
    except (ValueError, RecursionError):
        return None
    if not isinstance(decoded, dict):
        return None
    flat: Flat = {}
    _flatten(decoded, "", flat, 0)
    return flat


def _flatten(value: Any, path: str, flat: Flat, depth: int) -> None:
    if depth > DEEPEST:
        return
    if isinstance(value, Mapping):
        for key, item in value.items():
            _flatten(item, f"{path}.{key}" if path else str(key), flat, depth + 1)
    elif isinstance(value, list):
        if (value and isinstance(value[0], str)) or not value:
            flat.setdefault(f"{path}\x00", []).append(len(flat.get(path, [])))  # where a list of strings starts
        for item in value:
            _flatten(item, path, flat, depth + 1)
    elif isinstance(value, str):
        flat.setdefault(path, []).append(value)
    else:
        try:
            number = float("nan") if value is None else float(value)
        except OverflowError:  # an integer of hundreds of digits
            number = float("nan")
        flat.setdefault(path, []).append(number)


def shape_of(flat: Flat) -> MessageShape:
    """Return the numbers and strings that a message has."""
    widths, strings, starts = {}, {}, {}
    for path, values in flat.items():
        if path.endswith("\x00"):
            starts[path[:-1]] = values
        elif all(isinstance(value, float) for value in values):
            widths[path] = len(values)
        else:
            strings[path] = [str(value) for value in values]
    return MessageShape(widths, strings, starts)


_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
_PREFIXES = ("header.stamp", "stamp", "header.timestamp", "timestamp")
_STAMPS = (*_PARTS, *((whole, "") for whole, _ in _PARTS))
"""Names of a stamp's seconds and nanoseconds; seconds alone where a message has nothing else."""
_PLACES = (
    *((f"{prefix}.{whole}", part and f"{prefix}.{part}") for prefix in _PREFIXES for whole, part in _STAMPS),
    ("time_stamp_sec", "time_stamp_nano_sec"),
)


LATEST = 9e9
"""s; stamps up to the year 2255 fit into 64 bits of nanoseconds."""


def stamp_of(flat: Flat) -> int:
    """Return the header stamp in ns, 0 where the message has none or one with impossible nanoseconds."""
    parts = _stamp_parts(flat)
    if parts is None or not 0 <= parts[1] < SECOND:
        return 0
    seconds, nanoseconds = parts
    whole = math.floor(seconds)  # a fraction of a second, where a maker writes one, apart: it keeps its digits so
    return whole * SECOND + round((seconds - whole) * SECOND) + int(nanoseconds)


def misstamped(flat: Flat) -> bool:
    """Return whether the message has a stamp of less than none or a second and more of nanoseconds."""
    parts = _stamp_parts(flat)
    return parts is not None and not 0 <= parts[1] < SECOND


def _stamp_parts(flat: Flat) -> tuple[float, float] | None:
    """Return the seconds and nanoseconds of the header stamp; None where the message has none."""
    for whole, part in _PLACES:
        if whole in flat and (not part or part in flat):
            seconds, parts = flat[whole][0], flat[part][0] if part else 0.0
            if isinstance(seconds, float) and isinstance(parts, float) and abs(seconds) < LATEST:
                return seconds, parts
    return None
