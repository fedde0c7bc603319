"""Errors that users cause: one message saying where and what, one hint saying how to mend it.

Every error that elid raises on purpose is an `ElidError`; `main` in `elid_cli/cli/__init__.py` is the
only place that turns one into text and an exit code, so the core never prints and never exits.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import islice
from numbers import Real
from typing import ClassVar

EXIT_DONE = 0
EXIT_LIMIT = 1
EXIT_USAGE = 2
EXIT_LOG = 3
EXIT_DATA = 4
EXIT_BUG = 70
EXIT_INTERRUPTED = 130
EXIT_CLOSED_PIPE = 141


LONGEST_WORD = 300
"""Characters of a word that are shown whole."""
_KEPT = "\N{NO-BREAK SPACE}\N{FIGURE SPACE}\N{NARROW NO-BREAK SPACE}"
"""Spaces that are not printable by Python's rule and do nothing to a terminal."""


def visible(text: str, *, lines: bool = False) -> str:
    r"""Return a text as it may be shown to people: the one door between names from files and a terminal or a page.

    Controls, marks that turn the direction of writing and what else is no letter become ``\x1b``; so do line ends,
    unless the text has `lines`. Words of more than `LONGEST_WORD` characters are shown by their ends. Bytes of a file
    name that are no UTF-8 pass as they are, those of terminals' own codes excepted.
    """
    if not text.isascii() or not text.isprintable():
        text = "".join(c if _shown(c) or (lines and c in "\n\t") else _spelt(c) for c in text)
    if len(text) > LONGEST_WORD:
        text = re.sub(rf"\S{{{LONGEST_WORD + 1},}}", _ends, text)
    return text


def _shown(letter: str) -> bool:
    return letter.isprintable() or letter in _KEPT or "\udca0" <= letter <= "\udcff"


def _spelt(letter: str) -> str:
    code = ord(letter)
    if letter in "\n\t\r":
        return {"\n": "\\n", "\t": "\\t", "\r": "\\r"}[letter]
    if 0xDC80 <= code < 0xDCA0:
        code -= 0xDC00
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _ends(word: re.Match[str]) -> str:
    whole = word.group()
    return f"{whole[: LONGEST_WORD - 100]}…({len(whole)} characters)…{whole[-60:]}"


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
    return _closest(name, tuple(islice((text for text in short if len(text) <= LONGEST), COMPARED)))


@lru_cache(maxsize=64)
def _closest(name: str, names: tuple[str, ...]) -> str | None:
    """Return the name closest to `name`; logs of one recorder ask the same again and again."""
    known = {text.lower(): text for text in names}
    found = difflib.get_close_matches(name.lower(), list(known), n=1, cutoff=0.5)
    return known[found[0]] if found else None


def first_of(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first `most` names in one text, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return between.join(names[:most]) + more


def in_words(words: Sequence[str], most: int | None = None) -> str:
    """Return words as a sentence lists them, the first `most` where there are several more: ``a, b and 3 more``."""
    shown = list(words) if most is None or len(words) <= most + 1 else [*words[:most], f"{len(words) - most} more"]
    return "".join(shown) if len(shown) < 2 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return ``did you mean 'x'?``, or the list of valid names where none is near."""
    valid = [str(candidate) for candidate in names]
    near = nearest(name, valid)
    if near is not None:
        return f"did you mean {near!r}?"
    return f"known: {first_of(valid, LISTED)}" if valid else ""


def check_word(where: str, word: object, words: Sequence[str]) -> None:
    """Refuse an argument that is none of the words that there are, None apart where it leaves the choice (UsageError).

    Parameters
    ----------
    where
        Whose argument it is, and its name.
    word
        What was given.
    words
        What may be given.
    """
    if word is not None and word not in words:
        raise UsageError(f"{where}: {word!r} says nothing here", hint=did_you_mean(str(word), words))


def check_number(where: str, value: object) -> None:
    """Refuse an argument that is neither a real number nor None (UsageError)."""
    if value is not None and not isinstance(value, Real):
        raise UsageError(f"{where}: {value!r} is no number", hint="give a number, in SI units")


def check_kind(where: str, value: object, kind: type, hint: str) -> None:
    """Refuse an argument of another type than `kind`; `hint` says what makes one (UsageError)."""
    if not isinstance(value, kind):
        of = f"the text {value!r}" if isinstance(value, str) else f"a value of type {type(value).__name__}"
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise UsageError(f"{where}: {of} in place of {article} {kind.__name__}", hint=hint)
