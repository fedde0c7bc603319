"""How a CSV is written: separator, decimal mark, header, units, and what a cell stands for."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from elid_cli.errors import LogError
from elid_cli.logs.formats.csv_times import moment
from elid_cli.logs.mapping.language import UNIT_WORDS

COMMENTS = ("#", "%", "//")
HEAD = 1 << 16
"""Characters in which the first rows are looked for."""
SNIFFED = 60
"""Lines that are looked at to tell the dialect."""
LONGEST_LINE = 4 << 20
"""Characters of the longest row that is read."""
MEASURED = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?\s*([^\W\d_][^\s\d]*|[°%‰][^\s\d]*)")
"""A cell that holds a number and something behind it."""
TABLE = "a CSV log has one header row and one row per sample"


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
    """Unit of each column, where the header, a row below it or every cell tells; empty where not."""
    in_cells: tuple[str, ...] = ()
    """Unit that stands in every cell of a column behind its number, as in ``0.5 s``; empty where none does."""


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
    if not numeric and separator != " ":
        numeric = [k for k, row in enumerate(rows) if _is_numeric(map(_bare, row[2]), decimal_comma)]
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
    in_cells = tuple(unit_of(cell) for cell in rows[start][2])
    told = itertools.zip_longest(units, below, in_cells, fillvalue="")
    units = tuple(own or under or inside for own, under, inside in told)
    return Dialect(separator, decimal_comma, names, header is not None, rows[start][0], rows[start][1], units, in_cells)


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


def first_rows(text: str, dialect: Dialect) -> list[list[str]]:
    """Return the first rows of numbers as cells."""
    head = text[dialect.first : dialect.first + HEAD].splitlines()
    lines = head[:-1] if len(text) >= dialect.first + HEAD else head
    rows = [split(line, dialect.separator) for line in lines if line.strip() and not line.lstrip().startswith(COMMENTS)]
    return [row for row in rows if len(row) == len(dialect.names)]


def to_number(cell: str, decimal_comma: bool) -> float | None:
    """Return what a cell says: NaN where it is empty, None where it is text."""
    return number_of(cell.replace(",", ".") if decimal_comma else cell)


def unit_of(cell: str) -> str:
    """Return the unit behind a cell's number, as in ``0.5 s`` or ``30°``; empty where none is known there."""
    match = MEASURED.fullmatch(cell)
    return match[1] if match and re.sub(r"[\s*·.]", "", match[1].lower()) in UNIT_WORDS else ""


def _bare(cell: str) -> str:
    """Return a cell without the unit behind its number."""
    return cell.removesuffix(unit_of(cell)).rstrip()


def number_of(cell: str, unit: str = "") -> float | None:
    """Return a cell's number, or its date or time of day in s; NaN where it is empty, None of other text.

    `unit` is what stands behind every number of its column.
    """
    if unit:
        cell = cell.removesuffix(unit).rstrip()
    if not cell or cell.lower() in ("nan", "na", "n/a", "null", "none", "-"):
        return math.nan
    try:
        return float(cell)
    except ValueError:
        return moment(cell)


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
