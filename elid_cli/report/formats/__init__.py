"""Output formats. One file per format: a module with ``render(report, style) -> str``, found by itself.

A module may name the file suffixes that it answers to in ``SUFFIXES``; modules whose name begins with an
underscore help the others. Listing the formats imports none of them.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

from elid_cli.errors import UsageError, did_you_mean
from elid_cli.files import check_writable, filling, replacing, write_text
from elid_cli.report.tree import Report, file_name, shown


@dataclass(frozen=True)
class Style:
    """What the place where a report goes can show."""

    width: int = 80
    """Columns of a line."""
    color: bool = False
    """Whether colour and bold may be used."""
    ascii: bool = False
    """Whether only ASCII can be shown."""
    everything: bool = False
    """Whether long tables are shown whole."""
    whole_rows: bool = False
    """Whether a row of a table is one line, however long."""
    rows: int = 0
    """Rows of a long table that there is room for, where that is known; a table may show more."""
    rest: str = "--all"
    """What shows the rows that a long table leaves out."""


class Format(Protocol):
    """What a module in this folder offers; one that shows figures says ``FIGURES = True``."""

    SUFFIXES: tuple[str, ...]

    def render(self, report: Report, style: Style) -> str:
        """Return the report as text, ending in a newline."""


def format_names() -> tuple[str, ...]:
    """Return the names of all formats, without importing them."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def find_format(name: str) -> Format:
    """Return a format by its name.

    Raises
    ------
    UsageError
        There is none of that name.
    """
    if name not in format_names():
        raise UsageError(f"no output format {name!r}", hint=did_you_mean(name, format_names()))
    return cast(Format, importlib.import_module(f"{__name__}.{name}"))


def format_of(path: Path) -> Format:
    """Return the format that a file's suffix asks for.

    Raises
    ------
    UsageError
        No format has that suffix.
    """
    suffixes = {suffix: name for name in format_names() for suffix in find_format(name).SUFFIXES}
    if path.suffix.lower() not in suffixes:
        raise UsageError(
            f"{path}: no report format for {path.suffix or 'a name without suffix'}",
            hint=f"known: {', '.join(sorted(suffixes))}",
        )
    return find_format(suffixes[path.suffix.lower()])


def shows_figures(path: Path) -> bool:
    """Return whether the format of a file's suffix shows figures."""
    return getattr(format_of(path), "FIGURES", False)


def check_destination(path: Path) -> None:
    """Refuse early a report file of unknown suffix or in a folder that cannot be written (UsageError)."""
    format_of(path)
    check_writable(path)


def render(report: Report, name: str, style: Style) -> str:
    """Return a report as text in the format of that name."""
    return find_format(name).render(shown(report), style)


def write_report(report: Report, path: Path) -> None:
    """Write a report to a file, whole or not at all, with all its rows, in the format of the file's suffix."""
    write_text(path, format_of(path).render(shown(report), Style(width=120, everything=True)))


def check_drawing(folder: Path, suffix: str = "png") -> None:
    """Refuse early a folder of figures that cannot be made, or PNG without its plotting library (UsageError)."""
    if suffix == "png":
        try:
            importlib.import_module("matplotlib")
        except ModuleNotFoundError as missing:
            hint = "--plot-format svg, or pip install 'elid[plots]'"
            raise UsageError(f"--plot: {missing.name} is not installed", hint=hint) from None
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is not a folder", hint="--plot takes a folder for the figures")
    check_writable((folder if folder.is_dir() else folder.parent) / "figure")


def draw(report: Report, folder: Path, suffix: str = "png") -> None:
    """Write the report's figures into a folder, made if it is missing: one file each, whole or not at all."""
    from elid_cli.report.figures import kinds, picture

    with filling(folder) as within:
        for figure in shown(report).figures:
            if figure.kind in kinds():
                with replacing(within(f"{file_name(figure.key)}.{suffix}")) as beside:
                    beside.write_bytes(picture(figure, suffix))
