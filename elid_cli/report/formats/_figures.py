"""Figures as files: one PNG or SVG per figure of a report, named by its key."""

from __future__ import annotations

from pathlib import Path

from elid_cli.files import replacing
from elid_cli.report.figures import kinds, picture
from elid_cli.report.tree import Report, file_name


def draw(report: Report, folder: Path, suffix: str = "png") -> None:
    """Write the report's figures into an existing folder, each whole or not at all."""
    for figure in report.figures:
        if figure.kind in kinds():
            with replacing(folder / f"{file_name(figure.key)}.{suffix}") as beside:
                beside.write_bytes(picture(figure, suffix))
