"""Report to stdout and files; --write-robot."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import click

from elid_cli.cli.color import is_terminal, wants_color
from elid_cli.cli.options import LOCK, TIP, Output
from elid_cli.errors import ElidError, visible
from elid_cli.report import formats
from elid_cli.report.tree import Report, Section, Text

SYMBOLS = "·±²→…σ"
"""Characters that a stream must know to be spared the ASCII spelling."""
BESIDES = 4
"""Lines of a terminal that a table's title, head, foot and the prompt take."""


def check_output(output: Output) -> None:
    """Refuse, before any work, a report file or a folder of plots that could not be written (UsageError)."""
    for name in output.report:
        formats.check_destination(Path(name))
    if output.plot is not None:
        formats.check_drawing(Path(output.plot), output.plot_format)


def pictures_wanted(output: Output) -> bool:
    """Return whether anybody will look at the report's figures, which cost time."""
    return output.plot is not None or any(formats.shows_figures(Path(name)) for name in output.report)


def emit(report: Report, output: Output) -> None:
    """Write the report to the files asked for, then to stdout."""
    report = _carried(replace(report, invocation=invocation()))
    for name in output.report:
        formats.write_report(report, Path(name))
    if output.plot is not None:
        formats.draw(report, Path(output.plot), output.plot_format)
    kind = "json" if output.json else "markdown" if output.markdown else "terminal"
    sys.stdout.write(formats.render(report, kind, style_of(sys.stdout, output)))
    sys.stdout.flush()


def style_of(stream: TextIO, output: Output) -> formats.Style:
    """Return what a stream can show."""
    return formats.Style(
        width=width_of(stream), color=wants_color(stream, output.color), ascii=not _knows(stream, SYMBOLS),
        everything=output.everything, rows=_rows_of(stream),
        whole_rows=not is_terminal(stream) and _columns_wanted() is None,
    )  # fmt: skip


def width_of(stream: TextIO) -> int:
    """Return the columns of a stream: ``COLUMNS``, else the terminal's, else 80."""
    wanted = _columns_wanted()
    if wanted is None:
        wanted = shutil.get_terminal_size((80, 24)).columns if is_terminal(stream) else 80
    return max(wanted, 20)


def _rows_of(stream: TextIO) -> int:
    """Return the rows of a table that a terminal has room for, beside its head and foot; 0 where none is looked at."""
    return shutil.get_terminal_size((80, 24)).lines - BESIDES if is_terminal(stream) else 0


def _columns_wanted() -> int | None:
    """Return what ``COLUMNS`` asks for; a shell does not pass it on unless it is told to."""
    asked = os.environ.get("COLUMNS", "")
    return int(asked) if asked.isdecimal() else None


def invocation() -> str:
    """Return the command line, ready to paste."""
    context = click.get_current_context(silent=True)
    arguments = context.find_root().obj if context is not None else None
    return shlex.join(["elid", *(arguments or ())])


def _carried(report: Report) -> Report:
    """Return the report with the options without which its next commands could not read the same log."""
    context = click.get_current_context(silent=True)
    given = context.params if context is not None else {}
    options = [word for place in given.get("maps") or () for word in ("--map", place)]
    if given.get("time") not in (None, "auto"):
        options += ["--time", given["time"]]
    if context is not None and context.meta.get(TIP):
        options += ["--tip", context.meta[TIP]]
    for name, value in (context.meta.get(LOCK) or ()) if context is not None else ():
        options += ["--lock", f"{name}={value:.12g}"]
    if not options:
        return report

    def told(section: Section) -> Section:
        if not isinstance(section, Text) or section.role != "next" or "--map" in section.text:
            return section
        same = set(given.get("logs") or ()) & set(shlex.split(section.text))
        return replace(section, text=f"{section.text} {shlex.join(options)}") if same else section

    return replace(report, sections=tuple(told(section) for section in report.sections))


def note(lines: Iterable[str], output: Output, word: str = "note") -> None:
    """Say on stderr what the user should know although all went well: repairs, warnings.

    Someone who looks at the report on the same terminal finds them in it and is not told twice.
    """
    if output.quiet:
        return
    if not (output.json or output.markdown) and is_terminal(sys.stdout) and is_terminal(sys.stderr):
        return
    for line in lines:
        sys.stderr.write(f"{word}: {visible(line)}\n")


class LimitError(ElidError):
    """A limit that the user set was broken (exit code 1); raised after the report is out."""

    exit_code = 1


def _knows(stream: TextIO, characters: str) -> bool:
    try:
        characters.encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
