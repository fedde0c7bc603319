"""One tree for everything said to a user: what JSON holds, and the sections that people read.

A command builds one `Report`; every file in `formats/` turns it into text. So n results times m output
formats are n + m functions, and a test can check that the JSON and the tables say the same.

Nothing here knows about colour, width or markup, and nothing here computes: cells hold numbers, not text.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, TypeAlias

from elid_cli.errors import visible

Tone = Literal["plain", "good", "warn", "bad", "dim"]
Role = Literal["heading", "plain", "warning", "code", "next"]


@dataclass(frozen=True)
class Quantity:
    """A number with its unit and the precision that is worth printing.

    Parameters
    ----------
    value
        The number, in `unit`; None or NaN prints as a dash.
    unit
        Printed behind the number where the column does not carry the unit already.
    digits
        Significant digits, when `resolution` is not given.
    resolution
        A standard deviation of the value, in the same unit: its leading digit decides the decimals, or its leading
        two where they are below 30, so that rounding never adds more than a sixth of it.
    tone
        How the cell should strike the eye.
    """

    value: float | None
    unit: str = ""
    digits: int = 4
    resolution: float | None = None
    tone: Tone = "plain"


@dataclass(frozen=True)
class Mark:
    """A word with a tone, such as a verdict."""

    text: str
    tone: Tone = "plain"


@dataclass(frozen=True)
class Folded:
    """A long text with a short form for lines that must end somewhere; whole where nothing is to be left out."""

    text: str
    short: str


Cell: TypeAlias = str | bool | int | float | Quantity | Mark | Folded | None


def percent(fraction: float | None, digits: int = 3, tone: Tone = "plain") -> Quantity:
    """Return a fraction as a quantity in %."""
    return Quantity(None if fraction is None else 100.0 * fraction, "%", digits, tone=tone)


def cell_text(cell: Cell, *, unit: bool = True) -> str:
    """Return a cell as people read it; `unit` False where the column's head already names the unit."""
    if cell is None:
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, Mark | Folded):
        return cell.text
    if isinstance(cell, Quantity):
        number = number_text(cell.value, cell.digits, cell.resolution)
        return f"{number} {cell.unit}" if unit and cell.unit and number != "–" else number
    return number_text(cell)


def number_text(value: float | None, digits: int = 4, resolution: float | None = None) -> str:
    """Return a number with `digits` significant digits, or as many decimals as `resolution` needs.

    Whole numbers keep all their digits up to 1e7, and get no decimals.
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    if not resolution and isinstance(value, float):
        value = float(f"{value:.{digits - 1}e}") if abs(value) < 10 ** (digits - 1) else value
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    if resolution and math.isfinite(resolution):
        leading = math.floor(math.log10(abs(resolution)))
        finest = leading - 1 if abs(resolution) < 2.95 * 10.0**leading else leading
        digits = max(1, min(magnitude - finest + 1, 15))
        decimals = -finest
    elif isinstance(value, int):
        return f"{value:d}"
    else:
        decimals = digits - 1 - magnitude
        while decimals > 0 and round(value, decimals - 1) == value:  # an exact short number stays short
            decimals -= 1
    if magnitude < -4 or magnitude >= 7:
        return f"{value:.{digits - 1}e}"
    text = f"{value:.{min(max(decimals, 0), 12)}f}"
    return text if text.strip("-0.") else text.removeprefix("-")


@dataclass(frozen=True)
class Text:
    """A paragraph; roles ``code`` (text to paste) and ``next`` (a command to run) are never folded."""

    key: str
    text: str
    role: Role = "plain"


@dataclass(frozen=True)
class KeyValues:
    """Facts, one a line; a tuple of cells is printed side by side."""

    key: str
    items: tuple[tuple[str, Cell], ...]
    title: str = ""


@dataclass(frozen=True)
class Column:
    """A column: `unit` stands in its head when every row has the same.

    Where `span` is set (for the first column only), a cell too long for the column takes a line of its own above the
    rest of its row.
    """

    key: str
    title: str
    unit: str = ""
    align: Literal["left", "right"] = "left"
    span: bool = False

    @classmethod
    def texts(cls, **titles: str) -> tuple[Column, ...]:
        """Return columns of words, flush left: key=title."""
        return tuple(cls(key, title) for key, title in titles.items())

    @classmethod
    def numbers(cls, unit: str = "", /, **titles: str) -> tuple[Column, ...]:
        """Return columns of numbers, flush right: key=title; `unit` where all rows of all of them have the same."""
        return tuple(cls(key, title, unit, "right") for key, title in titles.items())

    @property
    def head(self) -> str:
        """Title with unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class Table:
    """Rows of cells, one per column. Readers see `shown` rows (None: all) unless they ask for everything."""

    key: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    shown: int | None = None
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.key}: {len(row)} cells in a row of {len(self.columns)} columns")

    def visible(self, everything: bool, least: int = 0) -> tuple[tuple[Cell, ...], ...]:
        """Return the rows to print, at least `least`; one row more is printed rather than hidden behind a line."""
        shown = None if self.shown is None else max(self.shown, least)
        return self.rows if everything or shown is None or len(self.rows) <= shown + 1 else self.rows[:shown]


@dataclass(frozen=True)
class Figure:
    """What a plotter needs: `kind` names the way of drawing, `data` holds its arrays by name. Text formats skip it."""

    key: str
    title: str
    kind: str
    data: Mapping[str, Any] = field(default_factory=dict)
    caption: str = ""


Section: TypeAlias = Text | KeyValues | Table | Figure


@dataclass(frozen=True)
class Report:
    """What one command answers.

    Parameters
    ----------
    command
        The verb.
    payload
        The JSON object without ``schema``, ``version`` and ``command``; arrays, scalars of NumPy and NaN are allowed.
    sections
        What people read, in order; every key is unique and stable.
    invocation
        The command line that gave this report, for pages that are read later; never in JSON.
    """

    command: str
    payload: Mapping[str, Any]
    sections: tuple[Section, ...]
    invocation: str = ""

    def __post_init__(self) -> None:
        keys = [section.key for section in self.sections]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise ValueError(f"report {self.command}: two sections called {', '.join(twice)}")

    def section(self, key: str) -> Section:
        """Return the section of that key (KeyError where there is none)."""
        for section in self.sections:
            if section.key == key:
                return section
        raise KeyError(key)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures, in order."""
        return tuple(section for section in self.sections if isinstance(section, Figure))


def upper(text: str) -> str:
    """Return a sentence with its first letter large."""
    return text[:1].upper() + text[1:]


def warned(lines: Iterable[str], key: str = "warning") -> tuple[Text, ...]:
    """Return sentences that stand out, one section each."""
    return tuple(Text(f"{key}{k}", line, "warning") for k, line in enumerate(lines))


def picked(record: object, names: str) -> dict[str, Any]:
    """Return attributes of a record by their names, which stand in one text, for a payload that calls them the same."""
    return {name: getattr(record, name) for name in names.split()}


def shown(report: Report) -> Report:
    """Return the report with every text as people may see it (`visible`); the payload, which JSON escapes, as it is."""
    return replace(report, sections=tuple(_seen(s) for s in report.sections), invocation=visible(report.invocation))


def _seen(value: Any, *, lines: bool = False) -> Any:
    """Return a part of a report with its texts made visible; only paragraphs have lines."""
    if isinstance(value, str):
        return visible(value, lines=lines)
    if type(value) in (tuple, list):
        return type(value)(_seen(item) for item in value)
    if is_dataclass(value) and not isinstance(value, type):
        texts = isinstance(value, Text | Table)
        if isinstance(value, Figure):  # a drawing has little room for a name
            return Figure(value.key, visible(value.title), value.kind, _cut(value.data), visible(value.caption))
        parts = {f.name: getattr(value, f.name) for f in fields(value) if f.name != "key"}
        changed = {
            name: seen
            for name, part in parts.items()
            if (seen := _seen(part, lines=texts and name in ("text", "note"))) is not part
        }
        return replace(value, **changed) if changed else value
    return value


DRAWN = 48
"""Characters of a name in a drawing."""


def _cut(value: Any) -> Any:
    """Return what a plotter is given with its texts made visible and short; arrays as they are."""
    if isinstance(value, str):
        text = visible(value)
        return text if len(text) <= DRAWN else f"{text[: DRAWN - 14]}…{text[-12:]}"
    if type(value) in (tuple, list):
        return type(value)(_cut(item) for item in value)
    if isinstance(value, Mapping):  # a key may be a joint's name, which must stay unlike the others
        return {visible(key) if isinstance(key, str) else key: _cut(item) for key, item in value.items()}
    return value


def file_name(key: str) -> str:
    """Return a section's key as a name for a file or an anchor, of letters, digits, ``_``, ``-`` and ``.``.

    Unlike keys have unlike names. Joints may be called ``arm/joint1`` (a ROS name space).
    """
    plain = re.sub(r"[^\w.-]|^\.", "_", key)[:100]
    return plain if plain == key else f"{plain}-{zlib.crc32(key.encode('utf-8', 'surrogateescape')):08x}"
