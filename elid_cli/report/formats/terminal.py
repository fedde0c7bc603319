"""The terminal, and any text pipe: tables that never break at 80 columns and lose nothing at 40.

A table that does not fit its width folds its words; where a word would have to break, every row becomes a record
of ``column: value`` lines instead. In a pipe a row is one line, however long, for ``grep`` and ``awk``. Nothing is ever
cut. Data are never read as markup, so ``[N·m]`` survives.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from elid_cli.report.formats import Style
from elid_cli.report.formats._ascii import to_ascii
from elid_cli.report.tree import (
    Cell,
    Figure,
    Folded,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    Tone,
    cell_text,
)  # fmt: skip

if TYPE_CHECKING:
    from rich.console import Console

SUFFIXES = (".txt",)
TIE = "\N{NO-BREAK SPACE}"
UNITS = re.compile(r"(?<=[±×]) |(?<=\d) (?=(?:%|s|ms|µs|Hz|rad|mrad|N·m|N|kg|sd)(?:[\s,;:.)]|$))")
PASTED = re.compile(r"--[a-z][a-z-]* (?=[\w./])|\w+: \{from: [^{}]*(?:\{[^{}]*\}[^{}]*)*\}")
"""What a reader pastes out of a sentence: an option with its value, a line of a mapping."""
INDENT = 2
GAP = 2
LABEL = 60
"""Percent of the width that a label may take, its value behind it; a longer one is folded."""
LONG, BESIDE = 10, 8
"""Rows from which on a table is two blocks side by side where the terminal is wide, and the columns between them."""
_STYLE: dict[Tone, str] = {"plain": "", "good": "green", "warn": "yellow", "bad": "bold red", "dim": "dim"}


def render(report: Report, style: Style) -> str:
    """Return the report as lines for a terminal of `style.width` columns."""
    from rich.console import Console

    buffer = io.StringIO()
    # color_system None takes away bold as well, which rich's own NO_COLOR does not; _environ keeps rich from
    # looking for COLUMNS, FORCE_COLOR and the like a second time.
    console = Console(
        file=buffer, width=10_000, force_terminal=style.color, color_system="standard" if style.color else None,
        markup=False, emoji=False, highlight=False, soft_wrap=True, legacy_windows=False, _environ={},
    )  # fmt: skip
    writer = _Writer(console, style)
    shown = [section for section in report.sections if not isinstance(section, Figure)]
    for number, section in enumerate(shown):
        if number and not _joined(shown[number - 1], section):
            console.print()
        writer.section(section)
    return buffer.getvalue()


def _joined(before: Section, after: Section) -> bool:
    """Whether two sections stand without an empty line between them."""
    return isinstance(before, Text) and before.role == "heading" and not getattr(after, "title", "")


class _Writer:
    """Lays sections out as lines of at most `style.width` columns, words longer than that excepted."""

    def __init__(self, console: Console, style: Style) -> None:
        self.console = console
        self.style = style

    def section(self, section: Section) -> None:
        if isinstance(section, Text):
            self._text(section)
        elif isinstance(section, KeyValues):
            self._title(section.title)
            self._key_values(section)
        elif isinstance(section, Table):
            self._title(section.title)
            self._table(section)

    def _line(self, *parts: tuple[str, str]) -> None:
        """Print styled parts as one line, without spaces at its end."""
        from rich.text import Text as RichText

        line = RichText()
        for text, style in parts:
            line.append(text.replace(TIE, " "), style=style)
        line.rstrip()
        self.console.print(line)

    def _said(self, text: str) -> str:
        return to_ascii(text) if self.style.ascii else text

    def _fold(self, text: str, width: int) -> list[str]:
        """Return lines of at most `width` columns, broken between words only."""
        lines = [
            line
            for paragraph in _joined_units(self._said(text)).split("\n")
            for line in textwrap.wrap(paragraph, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]
        ]
        return lines or [""]

    def _title(self, title: str) -> None:
        for line in self._fold(title, self.style.width) if title else []:
            self._line((line, "bold"))

    def _text(self, section: Text) -> None:
        if section.role == "next":
            self._line(("Next: ", "bold"), (self._said(section.text), ""))
            return
        if section.role == "code":
            for line in self._said(section.text).split("\n"):
                self._line((" " * INDENT + line, ""))
            return
        style = {"heading": "bold", "warning": "yellow"}.get(section.role, "")
        prefix = "warning: " if section.role == "warning" else ""
        for line in self._fold(prefix + section.text, self.style.width):
            self._line((line, style))

    def _key_values(self, section: KeyValues) -> None:
        label_width = max((_columns(self._said(label)) for label, _ in section.items), default=0)
        side_by_side = self.style.width - INDENT - label_width - GAP >= 24
        for label, cell in section.items:
            if side_by_side:
                self._hanging(_pad(self._said(label), label_width + GAP), cell, INDENT + label_width + GAP)
            else:
                whole = f"{label}{'' if label.endswith('?') else ':'}"
                *lines, last = self._fold(whole, LABEL * self.style.width // 100)
                for line in lines:
                    self._line((" " * INDENT, ""), (line, "dim"))
                self._hanging(f"{last} ", cell, 2 * INDENT)

    def _hanging(self, label: str, cell: Cell, indent: int) -> None:
        """Print ``label value``, the value folded and its further lines indented by `indent`."""
        first = INDENT + _columns(label)
        value = _joined_units(self._said(cell_text(cell)))
        lines = textwrap.wrap(
            value, max(self.style.width, first + 1), initial_indent=" " * first, subsequent_indent=" " * indent,
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
        head, *rest = lines or [" " * first]
        if not head.strip() and rest:  # a first word too long for the rest of the line stays beside its label
            head, rest = " " * first + rest[0].strip(), rest[1:]
        self._line((" " * INDENT, ""), (label, "dim"), (head[first:], _style(cell)))
        for line in rest:
            self._line((line, _style(cell)))

    def _table(self, table: Table) -> None:
        rows: Sequence[Sequence[Cell]] = table.visible(self.style.everything, self.style.rows)
        texts = self._texts(table, rows)
        heads = [self._said(column.head) for column in table.columns]
        width = self.style.width - INDENT
        if len(rows) >= LONG and not self.style.whole_rows and 2 * _taken(heads, texts) + BESIDE <= width:
            rows = self._beside(table, heads, width)
            return self._foot(table, len(rows))
        widths: list[int] | None
        if self.style.whole_rows:
            widths = _natural(heads, texts)
        elif table.columns[0].span:
            widths = fit_spanning(heads, texts, width)
        else:
            widths = fit(heads, texts, [c.align == "right" for c in table.columns], width)
        if widths is None:
            self._records(heads, texts, rows)
        else:
            right = [column.align == "right" for column in table.columns]
            self._rows([heads], [[""] * len(heads)], widths, right, "dim")
            for cells, row in zip(texts, rows, strict=True):
                if table.columns[0].span and _columns(cells[0]) > widths[0]:
                    for part in self._fold(cells[0], width):
                        self._line((" " * INDENT + part, _style(row[0])))
                    cells[0] = ""
                self._rows([cells], [[_style(cell) for cell in row]], widths, right)
        return self._foot(table, len(rows))

    def _texts(self, table: Table, rows: Sequence[Sequence[Cell]]) -> list[list[str]]:
        return [
            [
                self._said(self._cell(cell, unit=not column.unit))
                for column, cell in zip(table.columns, row, strict=True)
            ]
            for row in rows
        ]

    def _cell(self, cell: Cell, *, unit: bool) -> str:
        whole = self.style.everything or self.style.whole_rows
        return cell.short if isinstance(cell, Folded) and not whole else cell_text(cell, unit=unit)

    def _beside(self, table: Table, heads: list[str], width: int) -> Sequence[Sequence[Cell]]:
        """Print a long table as two blocks side by side, twice as many rows as else; return the rows."""
        rows: Sequence[Sequence[Cell]] = table.rows
        shown = None if table.shown is None else max(table.shown, self.style.rows)
        if not self.style.everything and shown is not None and len(rows) > 2 * shown + 1:
            rows = rows[: 2 * shown]
        texts = self._texts(table, rows)
        widths = _natural(heads, texts)
        if 2 * _taken(heads, texts) + BESIDE > width:  # the rows further on are wider
            rows = table.visible(self.style.everything, self.style.rows)
            texts = self._texts(table, rows)
            widths = _natural(heads, texts)
        right = [column.align == "right" for column in table.columns]
        both, sides, none = [*widths, BESIDE - 2 * GAP, *widths], [*right, False, *right], [""] * len(heads)
        self._rows([[*heads, "", *heads]], [[""] * len(both)], both, sides, "dim")
        half = -(-len(rows) // 2)
        looks = [[_style(cell) for cell in row] for row in rows]
        for k in range(half):
            other = (texts[k + half], looks[k + half]) if k + half < len(rows) else (none, none)
            self._rows([[*texts[k], "", *other[0]]], [[*looks[k], "", *other[1]]], both, sides)
        return rows

    def _foot(self, table: Table, count: int) -> None:
        """Print how many rows are left out, and the table's note."""
        if count < len(table.rows):
            self._line((" " * INDENT + self._said(f"… ({len(table.rows) - count} more: {self.style.rest})"), "dim"))
        for line in self._fold(table.note, self.style.width - INDENT) if table.note else []:
            self._line((" " * INDENT + line, "dim"))

    def _rows(
        self, texts: list[list[str]], styles: list[list[str]], widths: list[int], right: list[bool], default: str = ""
    ) -> None:
        for row, looks in zip(texts, styles, strict=True):
            cells = [self._fold(text, width) for text, width in zip(row, widths, strict=True)]
            for depth in range(max(map(len, cells), default=0)):
                parts: list[tuple[str, str]] = [(" " * INDENT, "")]
                for lines, width, flush_right, look in zip(cells, widths, right, looks, strict=True):
                    text = lines[depth] if depth < len(lines) else ""
                    parts.append((_pad(text, width, flush_right), look or default))
                    parts.append((" " * GAP, ""))
                self._line(*parts)

    def _records(self, heads: list[str], texts: list[list[str]], rows: Sequence[Sequence[Cell]]) -> None:
        """Print every row as lines of ``column: value``."""
        for number, (texts_of_row, row) in enumerate(zip(texts, rows, strict=True)):
            if number:
                self.console.print()
            for head, text, cell in zip(heads, texts_of_row, row, strict=True):
                if not text:
                    continue
                mark = Mark(text, cell.tone) if isinstance(cell, Quantity | Mark) else text
                self._hanging(f"{head}: " if head else "", mark, 2 * INDENT)


def fit(heads: list[str], rows: list[list[str]], right: list[bool], width: int) -> list[int] | None:
    """Return the columns' widths, or None where a word would have to break to fit into `width`.

    Columns aligned right hold numbers and are never folded, though their heads are; the others share what is left,
    the narrow ones first.
    """
    columns = list(zip(*rows, strict=True)) if rows else [() for _ in heads]
    natural = _natural(heads, rows)
    if sum(natural) + GAP * (len(natural) - 1) <= width:
        return natural
    least = [
        max([_longest_word(head), *(_columns(c) if flush else _longest_word(c) for c in cells)], default=1)
        for head, cells, flush in zip(heads, columns, right, strict=True)
    ]
    spare = width - GAP * (len(natural) - 1) - sum(least)
    if spare < 0:
        return None
    widths = list(least)
    order = sorted(range(len(natural)), key=lambda k: natural[k] - least[k])
    for place, k in enumerate(order):
        extra = min(natural[k] - least[k], spare // (len(order) - place))
        widths[k] += extra
        spare -= extra
    return widths


def _natural(heads: list[str], rows: list[list[str]]) -> list[int]:
    """Return the widths of columns in which nothing folds."""
    return [max(map(_columns, column)) for column in zip(heads, *rows, strict=True)]


def fit_spanning(heads: list[str], rows: list[list[str]], width: int) -> list[int] | None:
    """Return widths with all columns but the first at their natural width, and the first at what is left.

    Where that is too little, the other heads fold, and then their cells between words. Cells that the first column
    cannot hold do not widen it; None where not even its head fits.
    """
    least = _longest_word(heads[0])
    columns = list(zip(*rows, strict=True))[1:] or [() for _ in heads[1:]]
    # heads fold before cells do; a cell of one word, such as a number, never folds
    for head_width, cell_width in ((_columns, _columns), (_longest_word, _columns), (_longest_word, _longest_word)):
        others = [
            max(head_width(head), *map(cell_width, column), 0) for head, column in zip(heads[1:], columns, strict=True)
        ]
        room = width - sum(others) - GAP * len(others)
        if room >= least:
            break
    else:
        return None
    first = [w for w in map(_columns, (heads[0], *(row[0] for row in rows))) if w <= room]
    return [max([least, *first]), *others]


def _joined_units(text: str) -> str:
    """Return the text with numbers tied to their units, and what is to be pasted whole: no line ends in them."""
    return PASTED.sub(lambda found: found.group().replace(" ", TIE), UNITS.sub(TIE, text.replace("< ", "<" + TIE)))


def _taken(heads: list[str], rows: list[list[str]]) -> int:
    """Return the columns that a table takes in which nothing folds."""
    widths = _natural(heads, rows)
    return sum(widths) + GAP * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(_columns, _joined_units(text).split(" ")), default=1)


def _columns(text: str) -> int:
    """Return the columns that a text takes; only a text beyond ASCII asks rich."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def _pad(text: str, width: int, right: bool = False) -> str:
    space = " " * max(width - _columns(text), 0)
    return space + text if right else text + space


def _style(cell: Cell) -> str:
    return _STYLE[cell.tone] if isinstance(cell, Quantity | Mark) else ""
