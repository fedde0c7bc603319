"""Text in long form: each row is one sample of the channel that the row itself names (time, name, value).

Every name becomes a channel with stamps of its own, so that mapping, hints and canonical names work as for a table with
one column per channel. With one column of numbers a channel is called as the log names it; with several (joint,
position, effort) it is ``position.<name>``. Several columns of names are joined by ``/``. Numbers in a column of names
get its title: 3 under ``joint`` is ``joint3``.
"""

from __future__ import annotations

import io
import itertools
import math
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, did_you_mean
from elid_cli.logs.contract import Channel, Pick, RawLog, Stream
from elid_cli.logs.formats.csv_dialect import COMMENTS, Dialect, split, to_number
from elid_cli.logs.formats.csv_times import PASSED, is_time_of_day, over_midnight
from elid_cli.logs.mapping.long_table import LongTable
from elid_cli.logs.mapping.suggest import WORDS, words_of

UNITS = {"unit", "units", "einheit", "unité", "unidad"}
"""Titles of a column with the unit of each row's value."""
NUMBERED = {"joint", "axis", "achse", "axe", "eje", "motor", "actuator", "servo", "drive", "channel", "id", "index"}
"""Words of the title of a column whose whole numbers name channels."""
MOST_NAMES = 20_000
CHUNK = 1 << 16
"""Rows whose text is kept before it becomes numbers."""
TOGETHER = 0.3
"""Share of rows with another name and the same stamp as the row before, in long tables with several values a row."""


def recognised(dialect: Dialect, rows: Sequence[Sequence[str]], time: str) -> LongTable | None:
    """Return the columns of a table in long form; None where it has one column per channel.

    Parameters
    ----------
    dialect
        How the text is written; only named columns are judged.
    rows
        Its first rows of numbers, as cells.
    time
        The column with the time; empty: none that is known.
    """
    if not dialect.named or len(rows) < 2:
        return None
    columns = {name: [row[k] for row in rows] for k, name in enumerate(dialect.names) if name}
    texts = [name for name, cells in columns.items() if name != time and _is_text(cells, dialect)]
    texts = [name for name in texts if name.lower() not in UNITS]
    varying = [name for name in texts if len(set(columns[name])) > 1] or texts
    varying += [name for name, cells in columns.items() if name not in texts and _is_numbering(name, cells)]
    clocks = [time] if time else [name for name in columns if set(words_of(name)) & set(WORDS["t"])]
    kept = {*clocks, *texts, *varying}
    values = [n for n, cells in columns.items() if n not in kept and not _is_text(cells, dialect) and any(cells)]
    if not (varying and values and clocks):
        return None
    labels = list(zip(*(columns[name] for name in varying), strict=True))
    if len(set(labels)) > len(labels) // 2 or any(re.search(r"\d", name) for name in values):
        return None  # what never recurs is no name, what is numbered is a channel itself
    stamps = list(zip(labels, columns[clocks[0]], strict=True))
    together = sum(a != c and t == u for (a, t), (c, u) in itertools.pairwise(stamps)) / (len(stamps) - 1)
    return LongTable(tuple(varying), tuple(values)) if len(values) == 1 or together > TOGETHER else None


def _is_numbering(title: str, cells: Sequence[str]) -> bool:
    """Whether a column numbers the channels: by its title, and by whole numbers of which there are several."""
    return bool(set(words_of(title)) & NUMBERED) and len(set(cells)) > 1 and all(c.isdecimal() for c in cells)


def _is_text(cells: Sequence[str], dialect: Dialect) -> bool:
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(to_number(cell, dialect.decimal_comma) is None for cell in filled)


@dataclass(frozen=True)
class _Rows:
    """All rows of a table in long form."""

    names: tuple[str, ...]
    """The channels' names, in the order in which they occur."""
    which: Array
    """Index into `names`, (N,)."""
    numbers: Mapping[str, Array]
    """Every column of numbers, (N,); NaN where a cell is none."""
    units: Mapping[str, str]
    """Unit by name, from a column of units."""
    left_out: int
    notes: Sequence[str] = ()


class LongLog:
    """A text in long form: one channel per name and column of values."""

    def __init__(
        self, text: str, dialect: Dialect, table: LongTable, time: str, name: str,
        canonical: Sequence[Mapping[str, Any]], again: Callable[[LongTable], RawLog],
    ) -> None:  # fmt: skip
        for column in (*table.names, *table.values):
            if column not in dialect.names:
                raise LogError(f"{name}: long: no column {column!r}", hint=did_you_mean(column, dialect.names))
        rows = _read(text, dialect, table, name)
        self._rows, self._time, self._name = rows, time, name
        self._order = np.argsort(rows.which, kind="stable")
        self._ends = np.searchsorted(rows.which[self._order], np.arange(len(rows.names) + 1))
        several = len(table.values) > 1
        self._places = {
            f"{value}.{called}" if several else called: (k, value)
            for value in table.values
            for k, called in enumerate(rows.names)
        }
        counts = np.diff(self._ends)
        self.channels: Sequence[Channel] = (
            *(Channel(c, kind="rows", rows=int(counts[k])) for c, (k, _) in self._places.items()),
            *(Channel(c, kind="column") for c in rows.numbers if c not in table.values and c not in self._places),
        )
        units = dict(zip(dialect.names, dialect.units, strict=False))
        self.units = {
            channel: unit
            for channel, (k, value) in self._places.items()
            if (unit := rows.units.get(rows.names[k]) or units.get(value, ""))
        } | {c: unit for c in rows.numbers if c not in table.values and (unit := units.get(c, ""))}  # fmt: skip
        self.canonical, self._again = canonical, again
        self.long = table
        self.losses = [f"{rows.left_out} rows of other lengths left out"] if rows.left_out else []
        named, read = (" and ".join(columns) for columns in (table.names, table.values))
        self.notes = [
            f"long form: each row holds {read} of the channel in {named}, {len(rows.names)} in all",
            *rows.notes,
        ]
        self.timeless = True  # without a column for it there is none

    def in_long_form(self, table: LongTable) -> RawLog:
        """Return the text by other columns."""
        return self if table == self.long else self._again(table)

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        """Return the rows of each picked channel with their own stamps."""
        return [self._stream(pick) for pick in picks]

    def _stream(self, pick: Pick) -> Stream:
        numbers = self._rows.numbers
        if pick.source in self._places:
            k, value = self._places[pick.source]
            chosen: Any = self._order[self._ends[k] : self._ends[k + 1]]
        else:
            value, chosen = pick.source, slice(None)
        if value not in numbers:
            raise LogError(f"{self._name}: no channel {value!r}", hint=did_you_mean(value, self._places))
        clock = "" if pick.source in (pick.time, self._time) else pick.time or self._time
        clocks = {"t": numbers[clock][chosen]} if clock in numbers else {}
        return Stream(numbers[value][chosen][:, None], clocks)


def _read(text: str, dialect: Dialect, table: LongTable, name: str) -> _Rows:
    """Read all rows, what is no number as NaN; LogError where there are none or too many names."""
    at = {column: k for k, column in enumerate(dialect.names)}
    naming = [at[column] for column in table.names]
    unit = next((k for column, k in at.items() if column.lower() in UNITS), None)
    counted = [k for column, k in at.items() if column and k not in (*naming, unit)]
    cells: dict[int, list[str]] = {k: [] for k in counted}
    numbers: dict[int, array[float]] = {k: array("d") for k in counted}
    codes: dict[tuple[str, ...], int] = {}
    units: dict[int, str] = {}
    which, left_out = array("q"), 0
    times: list[int] = []
    for row in _cells(text, dialect):
        if len(row) != len(dialect.names):
            left_out += 1
            continue
        if not which:
            times = [k for k in counted if is_time_of_day(row[k])]
        code = codes.setdefault(tuple([row[k] for k in naming]), len(codes))
        which.append(code)
        if unit is not None:
            units.setdefault(code, row[unit])
        for k in counted:
            cells[k].append(row[k])
        if len(cells[counted[0]]) >= CHUNK:
            _flush(cells, numbers, dialect.decimal_comma)
        if len(codes) > MOST_NAMES:
            raise LogError(f"{name}: more than {MOST_NAMES} names of channels in {' '.join(table.names)}")
    _flush(cells, numbers, dialect.decimal_comma)
    if not which:
        raise LogError(f"{name}: no readable row")
    columns = {dialect.names[k]: np.array(numbers[k]) for k in counted}
    notes = []
    for title in (dialect.names[k] for k in times):
        columns[title], passed = over_midnight(columns[title])
        notes += [PASSED.format(title)] if passed else []
    called = ["/".join(_called(c, part) for c, part in zip(table.names, code, strict=True)) for code in codes]
    return _Rows(
        tuple(called), np.array(which), columns,
        {called[code]: written for code, written in units.items() if written}, left_out, notes,
    )  # fmt: skip


def _flush(cells: Mapping[int, list[str]], numbers: Mapping[int, array[float]], decimal_comma: bool) -> None:
    for k, texts in cells.items():
        numbers[k].frombytes(_numbers(texts, decimal_comma).tobytes())
        texts.clear()


def _numbers(texts: list[str], decimal_comma: bool) -> Array:
    try:
        return np.array([text.replace(",", ".") for text in texts] if decimal_comma else texts, dtype=float)
    except ValueError:
        found = (to_number(text, decimal_comma) for text in texts)
        return np.array([math.nan if value is None else value for value in found])


def _cells(text: str, dialect: Dialect) -> Iterator[list[str]]:
    for line in io.StringIO(text[dialect.first :]):
        stripped = line.strip()
        if stripped and not stripped.startswith(COMMENTS):
            yield split(line.rstrip("\r\n"), dialect.separator)


def _called(title: str, cell: str) -> str:
    """Return a name; a bare number after the title of its column, whole numbers without a decimal point."""
    number = to_number(cell, False)
    if number is None or not math.isfinite(number):
        return cell
    return f"{title}{int(number) if number == int(number) else cell}"
