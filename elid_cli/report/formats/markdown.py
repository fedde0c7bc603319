"""Markdown, for a comment on a pull request: what the terminal shows, as headings, lists and pipe tables."""

from __future__ import annotations

import re
from collections.abc import Iterable

from elid_cli.report.formats import Style
from elid_cli.report.tree import Cell, Column, Figure, KeyValues, Report, Section, Table, Text, cell_text

SUFFIXES = (".md", ".markdown")
_SPECIAL = re.compile(r"([\\`*_\[\]<>|#~&$])")


def render(report: Report, style: Style) -> str:
    """Return the report as GitHub-flavoured Markdown."""
    blocks = [block for section in report.sections if (block := _section(section, style))]
    return "\n\n".join(blocks) + "\n"


def _section(section: Section, style: Style) -> str:
    if isinstance(section, Text):
        return _text(section)
    if isinstance(section, KeyValues):
        return _key_values(section)
    if isinstance(section, Table):
        return _table(section, style)
    assert isinstance(section, Figure)  # a figure needs a file of its own; HTML carries it
    return ""


def _text(section: Text) -> str:
    if section.role == "heading":
        return f"## {_escape(section.text)}"
    if section.role == "warning":
        return f"> **warning** {_escape(section.text)}"
    if section.role == "next":
        return f"Next:\n\n{_fenced(section.text, 'sh')}"
    if section.role == "code":
        return _fenced(section.text, "yaml")
    return _escape(section.text)


def _fenced(text: str, language: str) -> str:
    """Return a block of code whose fence is longer than any that a name in it may bring."""
    fence = "`" * max([3, *(len(run) + 1 for run in re.findall("`+", text))])
    return f"{fence}{language}\n{text}\n{fence}"


def _key_values(section: KeyValues) -> str:
    lines = [f"- **{_escape(label)}** {_cell(value)}".rstrip() for label, value in section.items]
    return "\n".join([*_title(section.title), *lines])


def _table(section: Table, style: Style) -> str:
    rows = section.visible(style.everything)
    lines = [
        *_title(section.title),
        _row(_escape(column.head) for column in section.columns),
        _row("---:" if column.align == "right" else "---" for column in section.columns),
        *(_row(_of_column(c, cell) for c, cell in zip(section.columns, row, strict=True)) for row in rows),
    ]
    hidden = len(section.rows) - len(rows)
    if hidden:
        lines += ["", f"{hidden} more: `--all`"]
    if section.note:
        lines += ["", _escape(section.note)]
    return "\n".join(lines)


def _title(title: str) -> list[str]:
    return [f"### {_escape(title)}", ""] if title else []


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _of_column(column: Column, cell: Cell) -> str:
    return _escape(cell_text(cell, unit=not column.unit))


def _cell(cell: Cell) -> str:
    return _escape(cell_text(cell))


def _escape(text: str) -> str:
    return _SPECIAL.sub(r"\\\1", text).replace("\n", "<br>")
