"""Types of option values: finite numbers within bounds, shares, names that complete."""

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


class File(click.Path):
    """A path as typed, completed by the shell; what is wrong with it is said by whoever opens it."""

    name = "file"

    def __init__(self) -> None:
        super().__init__(path_type=str)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the path as typed."""
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
