"""Where colour may be used: on a terminal that wants it, or where the user insists."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TextIO

CHOICES = ("auto", "always", "never")


def wants_color(stream: TextIO, choice: str = "auto") -> bool:
    """Whether colour and bold may be written to a stream.

    ``--color`` decides; left at ``auto``, only a terminal gets colour, and none with ``NO_COLOR`` (not empty) or
    ``TERM=dumb``. ``FORCE_COLOR`` cannot bring escape codes into a pipe.
    """
    if choice != "auto":
        return choice == "always"
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return is_terminal(stream)


def is_terminal(stream: TextIO) -> bool:
    """Whether a stream is a terminal (False where it is closed)."""
    try:
        return stream.isatty()
    except (AttributeError, ValueError):
        return False


def chosen_color(arguments: Sequence[str]) -> str:
    """Return what ``--color`` says in a command line that could not be parsed."""
    for argument, following in zip(arguments, [*arguments[1:], ""], strict=False):
        value = following if argument == "--color" else argument.removeprefix("--color=")
        if argument.startswith("--color") and value in CHOICES:
            return value
    return "auto"
