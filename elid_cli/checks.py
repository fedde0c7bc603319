"""What arguments of the Python API must be: rules for the fields of options, and doors for objects and their options.

A rule takes where a value stands and the value, and raises a `UsageError` that says both, why, and what to give. A
class of options names one for every field (`check_fields`), so that none of them is checked by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TypeVar

from elid_cli.errors import UsageError, check_kind, check_word

Rule = Callable[[str, object], None]
Given = TypeVar("Given")


def check_fields(options: object, rules: Mapping[str, Rule]) -> None:
    """Refuse options of which a field breaks its rule (UsageError)."""
    for name, rule in rules.items():
        rule(f"{type(options).__name__}: {name}", getattr(options, name))


def options_given(where: str, given: Given | None, kind: type[Given]) -> Given:
    """Return the options that a function was given, the usual ones where there are none (UsageError: no such options).

    `where` is the function's name.
    """
    if given is None:
        return kind()
    check_kind(f"{where}: options", given, kind, f"{kind.__name__}(...), or leave them out")
    return given


def is_number(value: object) -> bool:
    """Whether a value is a real number; a truth value is none."""
    return isinstance(value, Real) and not (isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"))


def number(
    *, above: float | None = None, least: float | None = None, most: float | None = None, endless: bool = False
) -> Rule:
    """Return the rule of a real number: larger than `above`, from `least` to `most`, infinite only where `endless`."""

    def rule(where: str, value: object) -> None:
        if not is_number(value):
            raise UsageError(f"{where}: {value!r} is no number", hint="give a number, in SI units")
        assert isinstance(value, Real)
        fault = _out_of_range(float(value), above, least, most, endless)
        if fault:
            raise UsageError(f"{where} {float(value):g} {fault}", hint=_range(above, least, most))

    return rule


def _out_of_range(value: float, above: float | None, least: float | None, most: float | None, endless: bool) -> str:
    """Return how a number is out of its range; nothing where it is not. NaN is in none."""
    if above is not None and not value > above:
        return f"is not above {above:g}"
    if least is not None and not value >= least:
        return "is negative" if least == 0 and value < 0 else f"is not {least:g} or more"
    if most is not None and value > most:
        return f"is more than {most:g}"
    return "" if math.isfinite(value) or (endless and value > 0) else "is not finite"


def _range(above: float | None, least: float | None, most: float | None) -> str:
    """Return in words what may be given."""
    low = f" above {above:g}" if above is not None else f" of {least:g} or more" if least is not None else ""
    return f"give a finite number{low}" + (f", at most {most:g}" if most is not None else "")


def whole(least: int, most: int | None = None) -> Rule:
    """Return the rule of a whole number from `least` to `most`."""
    limits = f"{least} or more" if most is None else f"{least} to {most}"

    def rule(where: str, value: object) -> None:
        if not is_number(value):
            raise UsageError(f"{where}: {value!r} is no number", hint=f"give a whole number, {limits}")
        if not isinstance(value, Integral):
            raise UsageError(f"{where}: {value} is no whole number", hint=f"give {limits}")
        if int(value) < least or (most is not None and int(value) > most):
            raise UsageError(f"{where}: {value} is not {limits}", hint=f"give a whole number, {limits}")

    return rule


def real(where: str, value: object) -> None:
    """Refuse what is no real number, NaN and infinite ones apart (UsageError)."""
    if not is_number(value):
        raise UsageError(f"{where}: {value!r} is no number", hint="give a number, in SI units")


def flag(where: str, value: object) -> None:
    """Refuse what is neither True nor False (UsageError): any other value would count as one of them."""
    if not isinstance(value, bool) and type(value).__name__ not in ("bool", "bool_"):
        raise UsageError(f"{where}: {value!r} is neither True nor False", hint="give True or False")


def word(*words: str) -> Rule:
    """Return the rule of one of some words."""

    def rule(where: str, value: object) -> None:
        check_word(where, "None" if value is None else value, words)

    return rule


def text(where: str, value: object) -> None:
    """Refuse what is no text (UsageError)."""
    if not isinstance(value, str):
        raise UsageError(f"{where}: a value of type {type(value).__name__} in place of a text", hint="give a text")


def path(where: str, value: object) -> None:
    """Refuse what names no file (UsageError)."""
    if not isinstance(value, str | Path):
        what = f"a value of type {type(value).__name__} in place of a file's name"
        raise UsageError(f"{where}: {what}", hint="give its path as a text, or a pathlib.Path")


def of_kind(kind: type, hint: str) -> Rule:
    """Return the rule of a value of some type; `hint` says what makes one."""
    return lambda where, value: check_kind(where, value, kind, hint)


def optional(rule: Rule) -> Rule:
    """Return a rule beside which None may stand: chosen by elid."""

    def either(where: str, value: object) -> None:
        if value is not None:
            rule(where, value)

    return either


def several(rule: Rule, what: str = "values") -> Rule:
    """Return the rule of a list or a tuple of values that obey a rule each; `what` they are, in a word."""

    def each(where: str, value: object) -> None:
        check_list(where, value, what)
        assert isinstance(value, Sequence)
        for item in value:
            rule(where, item)

    return each


def check_list(where: str, value: object, what: str = "values") -> None:
    """Refuse what is no list or tuple (UsageError), a text first of all: its letters would be taken one by one."""
    if isinstance(value, str | bytes | Path):
        raise UsageError(f"{where}: the text {str(value)!r} in place of several {what}", hint=f"[{str(value)!r}]")
    if not isinstance(value, Sequence):
        given = f"a value of type {type(value).__name__}"
        raise UsageError(f"{where}: {given} in place of several {what}", hint=f"give a list or a tuple of {what}")


names = several(text, "names")
"""The rule of names: a list or a tuple of texts."""
