"""Report to stdout and files; --write-robot."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import click

from elid_cli.cli.color import is_terminal, wants_color
from elid_cli.cli.options import LOCK, TIP, Output
from elid_cli.errors import EXIT_LIMIT, ElidError, visible
from elid_cli.report import formats
from elid_cli.report.tree import Figure, Report, Section, Text

SYMBOLS = "·±²→…σ"
"""Characters that a stream must know to be spared the ASCII spelling."""
SAID = "elid.said"
"""Where a run keeps what `note` has said."""
BESIDES = 4
"""Lines of a terminal that a table's title, head, foot and the prompt take."""


def pictures_wanted(output: Output) -> bool:
    """Return whether anybody will look at the report's figures, which cost time."""
    return output.plot is not None or any(formats.shows_figures(Path(name)) for name in output.report)


def illustrated(report: Report, output: Output, figures: Callable[[Any], Sequence[Figure]]) -> Report:
    """Return the report with `figures`, made by the functions of `report.figures.build`, if anybody looks at them."""
    if not pictures_wanted(output):
        return report
    from elid_cli.report.figures import build

    return build.with_figures(report, figures(build))


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
    if context is None:
        return report
    given, options, held = context.params, _reading_words(context.params), _held_words(context)

    def told(section: Section) -> Section:
        if not isinstance(section, Text) or section.role != "next":
            return section
        words = shlex.split(section.text)
        if not set(given.get("logs") or ()) & set(words):
            return section
        mine = [*options, *(held if given.get("robot") in words else ())]
        pairs = [(name, value) for name, value in zip(mine[::2], mine[1::2], strict=True) if value not in words]
        anew = _mapped(v for name, v in pairwise(words) if name == "--map")
        pairs = [(name, value) for name, value in pairs if name != "--map" or not _mapped([value]) <= anew]
        more = shlex.join([word for pair in pairs for word in pair])
        if not more:
            return section
        before, own, after = section.text.partition(" --map ")  # of two mappings of a signal the later one counts
        return replace(section, text=f"{before} {more}{own}{after}")

    return replace(report, sections=tuple(told(section) for section in report.sections))


def _mapped(places: Iterable[str]) -> set[str]:
    """Return the signals that values of ``--map`` give a place; earlier values of theirs do not count."""
    from elid_cli.logs.mapping.options import read_map_options

    return set(read_map_options(tuple(places)))


def _reading_words(given: Mapping[str, Any]) -> list[str]:
    """Return the options that say how a log is read, each with its value."""
    options = [word for place in given.get("maps") or () for word in ("--map", place)]
    if given.get("time") not in (None, "auto"):
        options += ["--time", given["time"]]
    for name in ("kp", "kd"):
        value = given.get(name)
        if value is not None and "logs" in given:  # of simulate they are the controller's
            numbers = value if isinstance(value, list | tuple) else [value]
            options += [f"--{name}", ",".join(f"{number:.12g}" for number in numbers)]
    options += [w for start, stop in given.get("leave_out") or () for w in ("--leave-out", f"{start:.12g}:{stop:.12g}")]
    if given.get("rate") is not None and "logs" in given:
        options += ["--rate", f"{given['rate']:.12g}"]
    return options


def _held_words(context: click.Context) -> list[str]:
    """Return the options that hold joints, which a robot that was written has held already."""
    tip = ["--tip", context.meta[TIP]] if context.meta.get(TIP) else []
    return [*tip, *(w for name, value in context.meta.get(LOCK) or () for w in ("--lock", f"{name}={value:.12g}"))]


def note(lines: Iterable[str], output: Output, word: str = "note") -> None:
    """Say on stderr what the user should know although all went well: repairs, warnings.

    Someone who looks at the report on the same terminal finds them in it and is not told twice.
    """
    if output.quiet:
        return
    if not (output.json or output.markdown) and is_terminal(sys.stdout) and is_terminal(sys.stderr):
        return
    context = click.get_current_context(silent=True)
    said: set[tuple[str, str]] = set() if context is None else context.meta.setdefault(SAID, set())
    for line in lines:
        if (word, line) not in said:  # the same of many logs, and of the robot that is read with each, is said once
            said.add((word, line))
            sys.stderr.write(f"{word}: {visible(line)}\n")


class LimitError(ElidError):
    """A limit that the user set was broken (exit code 1); raised after the report is out."""

    exit_code = EXIT_LIMIT


def _knows(stream: TextIO, characters: str) -> bool:
    try:
        characters.encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
