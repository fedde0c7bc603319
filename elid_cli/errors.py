"""Errors that users cause: one message saying where and what, one hint saying how to mend it.

Every error that elid raises on purpose is an `ElidError`; `commands.main` is the only place that turns
one into text and an exit code, so the core never prints and never exits.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice
from typing import ClassVar

EXIT_DONE = 0
EXIT_LIMIT = 1
EXIT_USAGE = 2
EXIT_LOG = 3
EXIT_DATA = 4
EXIT_BUG = 70
EXIT_INTERRUPTED = 130
EXIT_CLOSED_PIPE = 141


class ElidError(Exception):
    """A fault with a place, an explanation and a mend.

    Parameters
    ----------
    message
        ``where: what``, lower case, values with units.
    detail
        Why elid thinks so (second line), or empty.
    hint
        Something to paste or to do (third line), or empty.

    """

    exit_code: ClassVar[int] = EXIT_USAGE

    def __init__(self, message: str, *, detail: str = "", hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.detail = detail
        self.hint = hint

    def __str__(self) -> str:
        lines = [self.message]
        if self.detail:
            lines.append(f"  {self.detail}")
        if self.hint:
            lines.append(f"  hint: {self.hint}")
        return "\n".join(lines)


class UsageError(ElidError):
    """Wrong command line, robot file or mapping (exit code 2)."""

    exit_code = EXIT_USAGE


class RobotError(UsageError):
    """A robot description that cannot be used (exit code 2)."""


class LogError(ElidError):
    """A log that cannot be used (exit code 3)."""

    exit_code = EXIT_LOG


class DataError(ElidError):
    """Data that cannot support the answer: rank 0, no excitation (exit code 4)."""

    exit_code = EXIT_DATA


COMPARED = 2000
"""Names among which the nearest is looked for; a file may bring millions of them."""
LONGEST = 200
"""Characters of a name that may still be a misspelling."""
LISTED = 40
"""Names that a hint lists."""


def nearest(name: str, names: Iterable[str]) -> str | None:
    """Return the name closest to `name`, ignoring case, or None where nothing is near."""
    if len(name) > LONGEST:
        return None
    short = (str(candidate) for candidate in names)
    known = {text.lower(): text for text in islice((text for text in short if len(text) <= LONGEST), COMPARED)}
    found = difflib.get_close_matches(name.lower(), list(known), n=1, cutoff=0.5)
    return known[found[0]] if found else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return ``did you mean 'x'?``, or the list of valid names where none is near."""
    valid = [str(candidate) for candidate in names]
    near = nearest(name, valid)
    if near is not None:
        return f"did you mean {near!r}?"
    more = f" and {len(valid) - LISTED} more" if len(valid) > LISTED else ""
    return f"known: {', '.join(valid[:LISTED])}{more}" if valid else ""
