"""CSV text to numbers: the columns of a dialect as float64, read block by block, faulty rows told."""

from __future__ import annotations

import importlib.util
import io
import math
from collections.abc import Callable, Sequence
from typing import IO, Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, first_of
from elid_cli.logs.formats.csv_dialect import COMMENTS, LONGEST_LINE, Dialect, number_of, split
from elid_cli.memory import MappedRows

LARGE = 8 << 20
"""Bytes of a file from which starting Arrow pays."""
PART = 1 << 20
"""Bytes that are parsed at a time: text and numbers stay in the cache."""
REPORTED = 3
"""Faulty lines that are named; the rest are counted."""


def parse_columns(text: str, dialect: Dialect, wanted: Sequence[str], name: str) -> tuple[Array, list[str]]:
    """Return the wanted columns, shape (N, len(wanted)), and what had to be said about faulty lines.

    Empty and unreadable cells are NaN; rows with too few or too many cells are left out and reported.
    """
    care = _Care(dialect, [dialect.names.index(column) for column in wanted])
    rows = care.rows(text[dialect.first :].rstrip())
    if not len(rows):
        raise LogError(f"{name}: no readable row", detail=care.said[0] if care.said else "")
    return rows, care.said


def parse_blocks(
    stream: IO[bytes],
    size: int,
    dialect: Dialect,
    wanted: Sequence[Sequence[str]],
    tell: Callable[[float], None] | None = None,
) -> tuple[list[Array], list[str]]:
    """Return a table per group of columns, (N, len(group)), and what had to be said, of a text read block by block.

    Only blocks with a fault are read row by row, and with care.

    Parameters
    ----------
    stream
        The text, UTF-8, at its first row of numbers.
    size
        Bytes from there to its end.
    dialect
        How it is written.
    wanted
        Groups of columns, by name.
    tell
        Told the share that has been read.

    Raises
    ------
    ValueError
        A row without end, or no row at all.
    """
    columns = [dialect.names.index(column) for group in wanted for column in group]
    parse = _by_arrow if _for_arrow(size, dialect) else _by_numpy
    tables, care, done, rest = [MappedRows(len(group)) for group in wanted], _Care(dialect, columns), 0, b""
    while True:
        block = stream.read(PART)
        done += len(block)
        cut = block.rfind(b"\n") + 1 if block else 0
        lines, rest = (rest + block[:cut], block[cut:]) if cut else (b"", rest + block) if block else (rest, b"")
        if lines and not lines.isspace():
            try:
                found, count = parse(lines, dialect, columns)
                care.passed(count)
            except ValueError:
                found = care.rows(lines.decode("utf-8", errors="replace")).T
            for table, part in zip(tables, _cut(found, wanted), strict=True):
                table.append(part.T)
        if len(rest) > LONGEST_LINE:
            raise ValueError("a row without end")
        if tell is not None and size:
            tell(done / size)
        if not block:
            break
    if not tables[0].rows:
        raise ValueError("no row")
    return [table.finish() for table in tables], care.said


def parted(table: Array, groups: Sequence[Sequence[str]]) -> list[Array]:
    """Return the columns of each group, which stand one after another in a table (N, k)."""
    return [part.T for part in _cut(table.T, groups)]


def _cut(columns: Array, groups: Sequence[Sequence[str]]) -> list[Array]:
    return np.split(columns, np.cumsum([len(group) for group in groups])[:-1])


def _for_arrow(size: int, dialect: Dialect) -> bool:
    """Whether Arrow reads such a text, and is there: of one column it would take an empty line for a row."""
    fits = size > LARGE and dialect.separator != " " and len(dialect.names) > 1
    return fits and importlib.util.find_spec("pyarrow") is not None


def _by_arrow(lines: bytes, dialect: Dialect, columns: Sequence[int]) -> tuple[Array, int]:
    """Parse by Apache Arrow's reader, which refuses what is no table of numbers: (k, m), count of lines."""
    import pyarrow as pa
    from pyarrow import csv as reader

    names = [str(k) for k in range(len(dialect.names))]
    chosen = [names[k] for k in columns]
    table = reader.read_csv(
        pa.BufferReader(lines),
        reader.ReadOptions(column_names=names, block_size=len(lines) + 1, use_threads=False),
        reader.ParseOptions(delimiter=dialect.separator, quote_char=False, ignore_empty_lines=False),
        reader.ConvertOptions(
            include_columns=list(dict.fromkeys(chosen)), column_types=dict.fromkeys(chosen, pa.float64()),
            null_values=[""], decimal_point="," if dialect.decimal_comma else ".", check_utf8=False,
        ),
    )  # fmt: skip
    return np.array([floats_of(table[name].chunk(0)) for name in chosen]), table.num_rows


def floats_of(column: Any) -> Array:
    """Return an array of Arrow's float64, NaN where it has none; Arrow's own way would import pandas."""
    if column.null_count:
        column = column.fill_null(math.nan)
    return np.frombuffer(column.buffers()[1], np.float64, len(column), 8 * column.offset)


def _by_numpy(lines: bytes, dialect: Dialect, columns: Sequence[int]) -> tuple[Array, int]:
    """Parse alike by NumPy's reader, which refuses empty cells, text and rows of other lengths."""
    separator = None if dialect.separator == " " else dialect.separator
    if b"#" in lines or b"%" in lines:
        raise ValueError("comments between the rows")
    if separator is not None:
        _check_rectangular(lines, separator, len(dialect.names))
    text = lines.decode("utf-8")
    rows = io.StringIO(text.replace(",", ".") if dialect.decimal_comma else text)
    found = np.loadtxt(rows, delimiter=separator, usecols=columns, comments=None, ndmin=2, dtype=float)
    return found.T, lines.count(b"\n")


def _check_rectangular(lines: bytes, separator: str, width: int) -> None:
    """Raise ValueError unless every line has `width` cells; numpy does not look at columns it is not asked for."""
    letters = np.frombuffer(lines.rstrip(), np.uint8)
    ends = np.append(np.flatnonzero(letters == ord("\n")), letters.size)
    before = np.searchsorted(np.flatnonzero(letters == ord(separator)), ends)
    if not np.all(np.diff(before, prepend=0) == width - 1):
        raise ValueError("rows of different lengths")


class _Care:
    """Reads rows that may be faulty, one by one, and counts what was wrong with them."""

    def __init__(self, dialect: Dialect, columns: Sequence[int]) -> None:
        self._dialect, self._columns = dialect, columns
        self._number = dialect.first_line - 1
        self._ragged: list[str] = []
        self._unreadable: list[str] = []

    def passed(self, lines: int) -> None:
        """Count lines that others have read."""
        self._number += lines

    def rows(self, body: str) -> Array:
        """Return the wanted columns of some lines, (m, k)."""
        found = [row for line in io.StringIO(body) if (row := self._row(line)) is not None]
        return np.array(found, dtype=float).reshape(-1, len(self._columns))

    def _row(self, line: str) -> list[float] | None:
        """Return the wanted cells of a line, or None where it is none of the table."""
        self._number += 1
        number, width, stripped = self._number, len(self._dialect.names), line.strip()
        if not stripped or stripped.startswith(COMMENTS):
            return None
        if len(line) > LONGEST_LINE:
            self._ragged.append(f"line {number} has more than {LONGEST_LINE >> 20} MiB")
            return None
        if self._dialect.decimal_comma:
            line, stripped = line.replace(",", "."), stripped.replace(",", ".")
        cells = split(stripped.split(" #")[0] if " #" in stripped else line.rstrip("\r\n"), self._dialect.separator)
        if len(cells) == width + 1 and cells[-1] == "":
            cells.pop()  # a separator at the end of every row
        if len(cells) != width:
            self._ragged.append(f"line {number} has {len(cells)} cells of {width}")
            return None
        units = self._dialect.in_cells or ("",) * width
        row = [number_of(cells[k], units[k]) for k in self._columns]
        if any(value is None for value in row):
            self._unreadable.append(f"line {number}")
        return [math.nan if value is None else value for value in row]

    @property
    def said(self) -> list[str]:
        """What was wrong, a sentence each."""
        said = []
        if self._ragged:
            said.append(f"{len(self._ragged)} CSV rows left out: {first_of(self._ragged, REPORTED)}")
        if self._unreadable:
            said.append(f"text in place of numbers, taken as missing: {first_of(self._unreadable, REPORTED)}")
        return said
