"""What is said of a search while it runs: what it does, and how far the whole is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from elid_cli._types import Progress

ROUNDS = 3
"""Effects that one joint may lack."""
SHARES = (0.15, 0.25)
"""Parts of the whole work that the first fit and each round take, about; the rest is the report's."""
SCREENED = 0.6
"""Part of a round after which its effects are chosen, about; the rest fits the motion again."""


@dataclass(frozen=True)
class Told:
    """What is said of the search while it runs: what it does, and how far the whole is."""

    progress: Progress | None

    def within(self, what: str, first: float, width: float) -> Callable[[float], None] | None:
        """Return what is called with the finished part of a step that takes `width` of the whole."""
        progress = self.progress
        if progress is None:
            return None
        return lambda part: progress(f"searching, {what}", first + width * part)

    def first(self) -> Callable[[float], None] | None:
        """Return what is called with the finished part of the first fit."""
        return self.within("fitting the motion", 0, SHARES[0])

    def screening(self, number: int) -> Callable[[str, float], None] | None:
        """Return what is called with what is tried and the finished part of a round's screening."""
        progress, first = self.progress, SHARES[0] + SHARES[1] * number
        if progress is None:
            return None
        head = f"searching, round {number + 1} of {ROUNDS} at most"
        return lambda what, part: progress(f"{head}: {what}", first + SCREENED * SHARES[1] * part)

    def fitting(self, number: int, effects: int) -> Callable[[float], None] | None:
        """Return what is called with the finished part of the fits that end a round."""
        what = f"round {number + 1} of {ROUNDS} at most: fitting again with {effects} effect{'s' * (effects > 1)}"
        return self.within(what, SHARES[0] + SHARES[1] * (number + SCREENED), SHARES[1] * (1 - SCREENED))
