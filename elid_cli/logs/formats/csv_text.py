"""CSV text to numbers: separator, header, units row and comments told apart, then columns as float64."""

from __future__ import annotations

import csv
import importlib.util
import io
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import IO, Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.memory import MappedRows

COMMENTS = ("#", "%", "//")
SNIFFED = 60
"""Lines that are looked at to tell the dialect."""
LARGE = 8 << 20
"""Bytes of a file from which starting Arrow pays."""
HEAD = 1 << 16
"""Characters in which the first rows are looked for."""
PART = 1 << 20
"""Bytes that are parsed at a time: text and numbers stay in the cache."""
LONGEST_LINE = 4 << 20
"""Characters of the longest row that is read."""
TABLE = "a CSV log has one header row and one row per sample"
REPORTED = 3
"""Faulty lines that are named; the rest are counted."""


@dataclass(frozen=True)
class Dialect:
    """How a CSV text is written."""

    separator: str
    """``,`` ``;`` tab, or a space for any white space."""
    decimal_comma: bool
    names: tuple[str, ...]
    named: bool
    """Whether the names come from a header row."""
    first: int
    """Offset of the first data line in the text."""
    first_line: int
    """Its line number, from 1."""
    units: tuple[str, ...] = ()
    """Unit of each column, where the header or a row below it tells; empty where not."""


def sniff(text: str, name: str) -> Dialect:
    """Tell separator, decimal mark, header and first data line.

    Raises
    ------
    LogError
        If the text has no line of numbers.
    """
    lines = list(itertools.islice(_lines(text, name), SNIFFED))
    content = [line for line in lines if line[2].strip() and not line[2].lstrip().startswith(COMMENTS)]
    if not content:
        raise LogError(f"{name}: no data", hint=TABLE)
    separator = _separator([line[2] for line in content])
    if separator == "," and _spaced([line[2] for line in content]):
        separator = " "
    decimal_comma = (
        separator in ";\t "
        and any(re.search(r"\d,\d", line[2]) for line in content)
        and not any(re.search(r"\d\.\d", line[2]) for line in content[1:])
    )
    rows = [(offset, number, split(line, separator)) for offset, number, line in content]
    numeric = [k for k, row in enumerate(rows) if _is_numeric(row[2], decimal_comma)]
    if not numeric and separator != " ":
        numeric = [k for k, row in enumerate(rows) if _is_numeric(row[2], decimal_comma, named=True)]
    if not numeric:
        raise LogError(
            f"{name}: no row of numbers in its first {len(lines)} lines",
            detail=f"line {rows[0][1]}: {lines[0][2][:60]!r}",
            hint=TABLE,
        )
    start = numeric[0]
    width = len(rows[start][2])
    header, below = _header(rows[:start], width)
    names, units = without_units(header) if header is not None else (tuple(f"column{k + 1}" for k in range(width)), ())
    units = tuple(own or under for own, under in itertools.zip_longest(units, below, fillvalue=""))
    return Dialect(separator, decimal_comma, names, header is not None, rows[start][0], rows[start][1], units)


def split(line: str, separator: str) -> list[str]:
    """Split one line into stripped cells; quotes keep separators inside a cell."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return []
    return [cell.strip() for cell in cells]


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
        row = [number_of(cells[k]) for k in self._columns]
        if any(value is None for value in row):
            self._unreadable.append(f"line {number}")
        return [math.nan if value is None else value for value in row]

    @property
    def said(self) -> list[str]:
        """What was wrong, a sentence each."""
        said = []
        if self._ragged:
            said.append(f"{len(self._ragged)} CSV rows left out: {_named(self._ragged)}")
        if self._unreadable:
            said.append(f"text where numbers belong taken as missing: {_named(self._unreadable)}")
        return said


def _named(places: Sequence[str]) -> str:
    more = f" and {len(places) - REPORTED} more" if len(places) > REPORTED else ""
    return f"{', '.join(places[:REPORTED])}{more}"


def first_rows(text: str, dialect: Dialect) -> list[list[str]]:
    """Return the first rows of numbers as cells."""
    head = text[dialect.first : dialect.first + HEAD].splitlines()
    lines = head[:-1] if len(text) >= dialect.first + HEAD else head
    rows = [split(line, dialect.separator) for line in lines if line.strip() and not line.lstrip().startswith(COMMENTS)]
    return [row for row in rows if len(row) == len(dialect.names)]


def to_number(cell: str, decimal_comma: bool) -> float | None:
    """Return what a cell says: NaN where it is empty, None where it is text."""
    return number_of(cell.replace(",", ".") if decimal_comma else cell)


def number_of(cell: str) -> float | None:
    """Return a cell's number, or its date and time in s since 1970; NaN where it is empty, None of other text."""
    if not cell or cell.lower() in ("nan", "na", "n/a", "null", "none", "-"):
        return math.nan
    try:
        return float(cell)
    except ValueError:
        return _moment(cell)


def _moment(cell: str) -> float | None:
    """Return a date and time as ISO 8601 in s since 1970 (UTC where it names no zone), None where it is none."""
    if not re.match(r"\d{4}-\d\d-\d\d[T ]\d\d:", cell):
        return None
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _lines(text: str, name: str) -> Iterator[tuple[int, int, str]]:
    """Yield (offset, line number, line); LogError where one is longer than any row of a log."""
    offset, number = 0, 0
    while offset < len(text):
        number += 1
        stop = text.find("\n", offset, offset + LONGEST_LINE) + 1 or min(len(text), offset + LONGEST_LINE)
        line = text[offset:stop]
        if len(line) == LONGEST_LINE:
            raise LogError(f"{name}: line {number} has more than {LONGEST_LINE >> 20} MiB", hint=TABLE)
        yield offset, number, line.rstrip("\r\n")
        offset = stop


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that splits the lines most alike; fields of text may hold the others."""
    for candidate in ("\t", ";", ","):
        counts = [line.count(candidate) for line in lines[-20:]]
        if min(counts) > 0 or sum(count > 0 for count in counts) > 0.8 * len(counts):
            return candidate
    return " " if all(len(line.split()) > 1 for line in lines[1:] or lines) else ","


def _is_numeric(cells: Iterable[str], decimal_comma: bool, *, named: bool = False) -> bool:
    """Whether a row is data: mostly numbers or nothing, and at least one number; two, where text `names` them."""
    numbers = texts = 0
    for cell in cells:
        value = number_of(cell.replace(",", ".") if decimal_comma else cell)
        if value is None:
            texts += 1
        elif cell:
            numbers += 1
    return numbers > 1 if named else numbers > 0 and texts <= numbers


def _header(rows: Sequence[tuple[int, int, list[str]]], width: int) -> tuple[tuple[str, ...] | None, tuple[str, ...]]:
    """Return the names and what stands below them: the first text rows of the data's width (a second one is units)."""
    found = []
    for _, _, cells in rows:
        if len(cells) == width + 1 and cells[-1] == "":
            cells = cells[:-1]
        if len(cells) in (width, width - 1) and any(cells):
            found.append(tuple([*cells, *[""] * (width - len(cells))]))
    return (found[0] if found else None), (found[1] if len(found) > 1 else ())


def without_units(names: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of columns, ``q.joint1 [deg]`` as ``q.joint1`` and ``deg``, unless names become alike."""
    matches = [re.fullmatch(r"(.*\S)\s*[\[(]\s*([^\[\]()]*[A-Za-zµ°%][^\[\]()]*)[\])]", name) for name in names]
    short = tuple(match[1] if match else name for name, match in zip(names, matches, strict=True))
    if len(set(short)) < len(set(names)):
        return names, ("",) * len(names)
    return short, tuple(match[2].strip() if match else "" for match in matches)


def _spaced(lines: Sequence[str]) -> bool:
    """Whether lines are numbers with decimal commas between white space, which look separated by commas."""
    rows = [line.split() for line in lines[1:] or lines]
    width = len(rows[-1])
    number = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")
    return width > 1 and all(len(row) == width and all(map(number.fullmatch, row)) for row in rows[-20:])
