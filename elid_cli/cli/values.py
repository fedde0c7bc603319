"""Types of option values: numbers, shares, files, names that the shell completes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import click
from click.shell_completion import CompletionItem


class Number(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.5
    """A finite number, greater than `above` or at least `least`."""

    name = "number"

    def __init__(self, *, above: float | None = None, least: float | None = None) -> None:
        self.above = above
        self.least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the value as a float, or fail with what would be valid."""
        try:
            number = self.parse(str(value))
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not finite", param, ctx)
        if self.above is not None and number <= self.above:
            self.fail(f"{value} is not greater than {self.above:g}", param, ctx)
        if self.least is not None and number < self.least:
            self.fail(f"{value} is less than {self.least:g}", param, ctx)
        return number

    def parse(self, text: str) -> float:
        """Return the number that a text stands for (ValueError where it is none)."""
        return float(text)


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """One number for every joint, or one per joint: ``20`` or ``20,20,30``, none below 0."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | list[float]:
        """Return the number, or the list of them."""
        each = Number(least=0)
        found = [each.convert(part, param, ctx) for part in str(value).split(",")]
        return found[0] if len(found) == 1 else found


class Share(Number):
    """A share, written ``0.05`` or ``5%``."""

    name = "share"

    def parse(self, text: str) -> float:
        """Return the share as a fraction."""
        return float(text[:-1]) / 100 if text.endswith("%") else float(text)


class ShareOfOne(Share):
    """A share that is meant to be at most 1: ``5`` is refused, since whoever writes it means ``5%``."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the share as a fraction; more than 1 only where it is written as a percentage."""
        share = super().convert(value, param, ctx)
        if share > 1 and not str(value).endswith("%"):
            self.fail(f"{value} is {100 * share:g} %; write {value}% or {share / 100:g}", param, ctx)
        return share


class Span(click.ParamType):  # type: ignore[type-arg]
    """A part of a log, s: ``6:6.4``."""

    name = "span"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Return start and stop."""
        if isinstance(value, tuple):
            return value[0], value[1]
        start, colon, stop = str(value).partition(":")
        if not colon:
            self.fail(f"{value!r} is no part of a log: write START:STOP in s, as 6:6.4", param, ctx)
        each = Number(least=0)
        first, last = each.convert(start, param, ctx), each.convert(stop, param, ctx)
        if not first < last:
            self.fail(f"{value} ends before it starts", param, ctx)
        return first, last


class File(click.Path):
    """A path as typed, completed by the shell; what is wrong with it is said by whoever opens it."""

    name = "file"

    def __init__(self) -> None:
        super().__init__(path_type=str)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the path as typed; one that is empty, as an unset variable leaves it, would name the folder."""
        if not str(value).strip():
            self.fail("an empty name is no file", param, ctx)
        return str(value)


def completing(
    names: Callable[[], Iterable[str]], *, files: bool = False
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Return a completion callback for names that are looked up when the shell asks; a fault completes nothing."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        try:
            found = [CompletionItem(name) for name in names() if name.startswith(incomplete)]
        except Exception:  # a completion must never write into the user's prompt
            found = []
        return found or ([CompletionItem(incomplete, type="file")] if files else [])

    return complete


def robots() -> Iterable[str]:
    """Return the names of the robots that ship with elid."""
    from elid_cli.robot.files import shipped_robots

    return shipped_robots()


def effects() -> Iterable[str]:
    """Return the names of the effects that elid knows."""
    from elid_cli.model.effects import effect_classes

    return effect_classes()


class Held(click.ParamType):  # type: ignore[type-arg]
    """A joint and the value it is locked at: ``NAME=VALUE``."""

    name = "held"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, float]:
        """Return the name and the number, which may be an expression such as ``pi/2``."""
        from elid_cli.robot.expressions import evaluate

        joint, sign, text = str(value).rpartition("=")
        try:
            return joint if sign else text, evaluate(text) if sign else 0.0
        except ValueError as fault:
            self.fail(f"{value!r}: {fault}; write NAME=VALUE, in rad or m", param, ctx)


class CarriedType(click.ParamType):  # type: ignore[type-arg]
    """A payload: ``KG@JOINT``, ``KG@JOINT:X,Y,Z``, or ``declared``."""

    name = "payload"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the `Payload` in a tuple, which holds None for the one that the robot's file declares."""
        from elid_cli.estimation.drive_gains.payload import parse_payload

        return value if isinstance(value, tuple) else (parse_payload(str(value)),)
