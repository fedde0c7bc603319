"""Results saved with ``--json``, read back: what no command of elid writes is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from elid_cli.checks import path as file_name
from elid_cli.errors import UsageError
from elid_cli.files import read_text
from elid_cli.robot.robot import Robot
from elid_cli.tables import SCHEMA, Shown

LARGEST = 50_000_000
"""Bytes of the largest result that is read."""

LARGEST_NUMBER = 1e300
"""A larger number in a saved result is broken."""
SHOWN = 24
"""Characters of a value that a message shows."""
AGAIN = "elid identify LOG --robot ROBOT --json > RESULT.json"


def is_result(path: str | Path) -> bool:
    """Return whether a file is a saved result by its name, ``.json``, or whose first key is the schema."""
    if str(path).lower().endswith(".json"):
        return True
    try:
        if not Path(path).is_file():  # a pipe would be waited for
            return False
        with Path(path).open("rb") as stream:
            return re.match(rb'\s*\{\s*"schema"', stream.read(64)) is not None
    except OSError:
        return False  # whoever reads it as a log says what is wrong


def saved_object(path: str | Path, again: str = AGAIN) -> Mapping[str, Any]:
    """Return the JSON object that a command of elid saved; `again` is the command that makes such a one.

    Raises
    ------
    UsageError
        No such file, not JSON, not of elid, or with a number that cannot be used.
    """
    file_name("result", path)
    text = read_text(Path(path), UsageError, suffixes=(".json",), most=LARGEST)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as problem:
        where = f"{path}:{problem.lineno}" if isinstance(problem, json.JSONDecodeError) else str(path)
        raise UsageError(f"{where}: not JSON", hint=again) from None
    # what Python saves of a result's own `to_dict` has no head
    if not isinstance(data, dict) or data.get("schema", SCHEMA if "base_parameters" in data else None) != SCHEMA:
        raise UsageError(f"{path}: not a result of elid", hint=again)
    check_numbers(data, str(path))
    return data


def told_by(result: Shown | str | Path, number: int) -> tuple[Mapping[str, Any], str]:
    """Return a result's JSON object, read where it is a file, and what it is called: by number where no file holds it.

    Raises
    ------
    UsageError
        See `saved_object`; or it is neither.
    """
    if not isinstance(result, Shown | str | Path):
        raise UsageError(
            f"result {number}: a value of type {type(result).__name__} in place of a result",
            hint="give what identify or diagnose returned, or the file that --json saved",
        )
    return (result.to_dict(), f"result {number}") if isinstance(result, Shown) else (saved_object(result), str(result))


def check_joints(saved: Mapping[str, Any], robot: Robot, path: str | Path) -> None:
    """Refuse a saved result of a robot with other joints (UsageError)."""
    joints = [str(joint) for joint in saved.get("joints") or ()]
    if tuple(joints) != robot.joint_names:
        raise UsageError(
            f"{path}: is of a robot with joints {', '.join(joints) or 'that it does not name'}",
            detail=f"{robot.name!r} has {', '.join(robot.joint_names)}",
        )


def number_of(value: Any) -> float | None:
    """Return a number; None for anything else, and for an integer of hundreds of digits."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return float(value) if abs(value) < LARGEST_NUMBER else None


def check_numbers(data: Mapping[str, Any], where: str) -> None:
    """Refuse a saved result, called `where`, with a number that no command of elid writes.

    Raises
    ------
    UsageError
        A number is not finite or larger than `LARGEST_NUMBER`, an estimate is no number, or a standard error is
        negative; its key is named.
    """
    broken = next(chain(_too_large(data), _no_numbers(data.get("base_parameters"))), None)
    if broken is not None:
        key, value = broken
        detail = "expected a finite number" + (", zero or more" if key.endswith("std_error") else "")
        raise UsageError(f"{where}: {key} cannot be used: {_shown(value)}", detail=detail, hint=AGAIN)


def _no_numbers(entries: Any) -> Iterator[tuple[str, Any]]:
    """Yield (key, value) of estimates and standard errors that are neither null nor numbers, or negative errors."""
    for k, entry in enumerate(entries if isinstance(entries, list) else ()):
        for name in ("estimate", "std_error") if isinstance(entry, dict) else ():
            value = entry.get(name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and (not number or (name == "std_error" and value < 0)):
                yield f"base_parameters[{k}].{name}", value


def _shown(value: Any) -> str:
    text = json.dumps(value)
    digits = text.lstrip("-")
    if len(text) > SHOWN and digits.isdigit():
        return f"a whole number of {len(digits)} digits"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def _too_large(data: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield (key, number) of what arithmetic cannot use, at any depth: ``base_parameters[3].estimate``."""
    open_: list[tuple[str, Any]] = [("", data)]
    while open_:
        key, value = open_.pop()
        if isinstance(value, Mapping):
            open_ += [(f"{key}.{name}" if key else str(name), part) for name, part in reversed(list(value.items()))]
        elif isinstance(value, list):
            open_ += [(f"{key}[{k}]", value[k]) for k in reversed(range(len(value)))]
        elif isinstance(value, int | float) and not abs(value) < LARGEST_NUMBER:
            yield key, value
