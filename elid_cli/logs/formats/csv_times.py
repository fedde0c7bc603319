"""Dates and times of day in the cells of a CSV."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np

from elid_cli._types import Array

DAY = 86400.0
"""s."""
TIME_OF_DAY = re.compile(r"(\d{1,2}):([0-5]\d):([0-5]\d(?:[.,]\d*)?)")

PASSED = "{}: times of day that pass midnight"
"""The note of a column, by its name."""


def moment(cell: str) -> float | None:
    """Return a date and time as ISO 8601 in s since 1970 (UTC where it names no zone), a time of day since midnight.

    None where a cell is neither.
    """
    if re.match(r"\d{4}-\d\d-\d\d[T ]\d\d:", cell):
        try:
            found = datetime.fromisoformat(cell)
        except ValueError:
            return None
        return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
    if (found_at := TIME_OF_DAY.fullmatch(cell)) is None:
        return None
    hours, minutes, seconds = found_at.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))


def is_time_of_day(cell: str) -> bool:
    """Return whether a cell is a time of day, ``HH:MM:SS`` and perhaps a fraction."""
    return TIME_OF_DAY.fullmatch(cell) is not None


def over_midnight(values: Array) -> tuple[Array, bool]:
    """Return times of day (N,) in s that go on over midnight, and whether they pass it: steps of half a day back."""
    known = np.flatnonzero(np.isfinite(values))
    if not (np.diff(values[known]) < -DAY / 2).any():
        return values, False
    values = values.copy()
    values[known] = np.unwrap(values[known], period=DAY)
    return values, True
