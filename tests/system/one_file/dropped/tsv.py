"""The tables of a report, tabs between cells. An output format dropped by a test."""

from __future__ import annotations

from elid_cli.report.formats import Style
from elid_cli.report.tree import Report, Table, cell_text

SUFFIXES = (".tsv",)


def render(report: Report, style: Style) -> str:
    """Return one line per row of every table."""
    rows = [row for section in report.sections if isinstance(section, Table) for row in section.rows]
    return "".join("\t".join(cell_text(cell) for cell in row) + "\n" for row in rows)
