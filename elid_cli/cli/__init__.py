"""The command line: `main`, the only place that knows exit codes and turns an error into text.

Importing this package costs next to nothing: click, NumPy and the verbs are imported when they are needed.
"""

from __future__ import annotations

import codecs
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import TextIO

from elid_cli import __version__
from elid_cli.errors import (
    EXIT_BUG,
    EXIT_CLOSED_PIPE,
    EXIT_DONE,
    EXIT_INTERRUPTED,
    EXIT_LOG,
    EXIT_USAGE,
    ElidError,
    visible,
)

COMPLETE = "_ELID_COMPLETE"
"""Environment variable through which a shell asks for completions."""

LONGEST_LINE = 4000
"""Characters of a line of an error."""

LEAST_ROOM = 320 << 20
"""Bytes of address space with which NumPy and SciPy can be loaded and have their buffers."""

_interrupted = False


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code (docs/reference/exit-codes.md)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    # Small dense algebra is faster on one BLAS thread; it must be said before NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _prepare_signals()
    _prepare_streams()
    if not sys.warnoptions and "--debug" not in arguments:
        warnings.simplefilter("ignore")  # a library's warning is no message of elid's
    try:
        code = _run(arguments)
        sys.stdout.flush()
    except BaseException as problem:
        code = _answer(problem, arguments)
    _seal(sys.stdout)
    _seal(sys.stderr)
    return code


def _run(arguments: list[str]) -> int:
    import click

    from elid_cli.cli.group import elid
    from elid_cli.cli.usage import usage_error

    if COMPLETE in os.environ:
        from click.shell_completion import shell_complete

        return shell_complete(elid, {}, "elid", COMPLETE, os.environ[COMPLETE])
    try:
        with elid.make_context("elid", arguments, obj=tuple(arguments)) as context:
            _check_room()
            elid.invoke(context)
    except click.exceptions.Exit as end:
        return int(end.exit_code)
    except click.Abort:  # at a question
        raise KeyboardInterrupt from None
    except click.ClickException as problem:
        raise usage_error(problem) from None
    return EXIT_DONE


def _check_room() -> None:
    """Refuse an address space in which numerical libraries end the process, or wait for memory for ever."""
    if sys.platform == "win32":
        return
    import resource

    room, _ = resource.getrlimit(resource.RLIMIT_AS)
    if room != resource.RLIM_INFINITY and room < LEAST_ROOM:
        raise MemoryError(f"{room >> 20} MiB of address space (ulimit -v); elid needs {LEAST_ROOM >> 20} MiB or more")


def _answer(problem: BaseException, arguments: list[str]) -> int:
    """Say what went wrong on stderr, in one form, and return the exit code."""
    if isinstance(problem, KeyboardInterrupt) or _interrupted:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        return EXIT_INTERRUPTED
    if isinstance(problem, BrokenPipeError):
        return EXIT_CLOSED_PIPE
    if isinstance(problem, SystemExit):
        return problem.code if isinstance(problem.code, int) else EXIT_BUG
    if "--debug" in arguments:
        _print(visible("".join(traceback.format_exception(problem)), lines=True))
    if isinstance(problem, ElidError):
        return _report(problem.message, problem.detail, problem.hint, problem.exit_code, arguments)
    if isinstance(problem, MemoryError):
        hint = "fewer logs at once, or a lower --rate"
        return _report("not enough memory", str(problem), hint, EXIT_LOG, arguments)
    if isinstance(problem, OSError) and problem.strerror:
        where = problem.filename if isinstance(problem.filename, str) else "standard output"
        return _report(f"{where}: {problem.strerror.lower()}", "", "", EXIT_USAGE, arguments)
    return _bug(problem, arguments)


def _report(message: str, detail: str, hint: str, code: int, arguments: list[str]) -> int:
    word = "error:"
    if _colored_errors(arguments):
        word = f"\x1b[1;31m{word}\x1b[0m"
    lines = [f"{word} {_one_line(message)}"]
    lines += [f"  {_one_line(detail)}"] if detail else []
    lines += [f"  hint: {_one_line(hint)}"] if hint else []
    _print("\n".join(lines) + "\n")
    return code


def _bug(problem: BaseException, arguments: list[str]) -> int:
    frames = traceback.extract_tb(problem.__traceback__)
    where = f" at {os.path.basename(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""  # noqa: PTH119
    what = _one_line(f"{type(problem).__name__}: {problem}")
    advice = "" if "--debug" in arguments else " (--debug shows where it happened)"
    line = f"a bug in elid {__version__}{where}, {what}; please report it to its developers with this line{advice}"
    return _report(line, "", "", EXIT_BUG, arguments)


def _one_line(text: str) -> str:
    """Return the text on one line of a bearable length."""
    shown = visible(text.strip().replace("\n", " "))
    return shown if len(shown) <= LONGEST_LINE else f"{shown[: LONGEST_LINE - 200]} … {shown[-150:]}"


def _colored_errors(arguments: list[str]) -> bool:
    from elid_cli.cli.color import chosen_color, wants_color

    return wants_color(sys.stderr, chosen_color(arguments))


def _print(text: str) -> None:
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except (OSError, ValueError):
        pass  # nobody listens; the exit code still tells


def _prepare_signals() -> None:
    """Remember Ctrl-C, since an interrupted import of a C extension can surface as any other exception."""

    def interrupt(number: int, frame: object) -> None:
        global _interrupted
        _interrupted = True
        raise KeyboardInterrupt

    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, interrupt)
    except ValueError:
        pass  # not the main thread: whoever called owns the signals


def _prepare_streams() -> None:
    """Let no character, and no closed descriptor, stop a message."""
    codecs.register_error("elid", _encodable)
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="elid")


def _encodable(problem: UnicodeError) -> tuple[str | bytes, int]:
    """Encode what a stream cannot: bytes of a file name as they were, known symbols in ASCII, others escaped."""
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    from elid_cli.report.formats._ascii import to_ascii

    text = problem.object[problem.start : problem.end]
    if problem.encoding == "utf-8" and all("\udc80" <= c <= "\udcff" for c in text):
        return text.encode("utf-8", "surrogateescape"), problem.end
    return to_ascii(text), problem.end


def _seal(stream: TextIO) -> None:
    """Flush a stream; where its pipe is closed or its disk full, let the interpreter's last flush go nowhere."""
    try:
        stream.flush()
    except (OSError, ValueError):
        try:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
        except (OSError, ValueError):
            pass
