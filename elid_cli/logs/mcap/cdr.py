"""Learn where every number of a CDR or ROS 1 message lies, from one message and its definition.

A *layout* is the offsets of the numbers and the bytes that fix them (the lengths, and the names of the joints).
Messages that agree in those bytes have the same layout, so that thousands are checked and decoded at once.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.budget import Budget
from elid_cli.logs.mcap.ros_schema import PRIMITIVES, Definitions

NAME_FIELDS = ("name", "names", "joint_names", "interface_names", "joint_name", "labels")
"""String fields whose content is part of the layout; the content of others (frame_id) may vary."""


class CdrError(ValueError):
    """A message that does not follow its definition."""


@dataclass
class CdrBlock:
    """A run of numbers of one type at one offset."""

    offset: int
    dtype: str
    count: int
    first: int
    """Index of its first number among those of the same path."""


@dataclass
class MessageLayout:
    """Offsets of all numbers and strings of one message shape."""

    length: int
    numbers: dict[str, list[CdrBlock]] = field(default_factory=dict)
    strings: dict[str, list[str]] = field(default_factory=dict)
    starts: dict[str, list[int]] = field(default_factory=dict)
    """Where each sequence of strings of the same path begins in `strings` (one per element of an outer sequence)."""
    fixed: list[tuple[int, int]] = field(default_factory=list)
    """Byte ranges that must equal the template's."""
    template: bytes = b""
    _fixed_words: list[tuple[int, str, Any]] | None = None

    def width(self, path: str) -> int:
        """Return how many numbers a path holds in one message."""
        return sum(block.count for block in self.numbers.get(path, ()))

    def matches(self, messages: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which messages, shape (M, length), have this layout, shape (M,)."""
        same = np.ones(messages.shape[0], dtype=bool)
        for start, dtype, word in self._words():
            same &= messages[:, start : start + int(dtype[2])].view(dtype)[:, 0] == word
        return same

    def _words(self) -> list[tuple[int, str, Any]]:
        """Return the fixed bytes as (offset, type, value) of whole words: comparing bytes is ten times slower."""
        if self._fixed_words is None:
            self._fixed_words = []
            for start, stop in self.fixed:
                size = next(size for size in (8, 4, 2, 1) if size <= stop - start)
                places = [*range(start, stop - size + 1, size)]
                if (stop - start) % size:
                    places.append(stop - size)  # overlaps the one before
                for place in places:
                    word = np.frombuffer(self.template, f"<u{size}", 1, place)[0]
                    self._fixed_words.append((place, f"<u{size}", word))
        return self._fixed_words


def learn(
    message: bytes, type_name: str, definitions: Definitions, budget: Budget, *, packed: bool = False
) -> MessageLayout:
    """Return the layout of a CDR message; every field and element is a step of the budget.

    `packed`: it is one of ROS 1, which are little-endian, without encapsulation and without gaps between numbers.

    Raises
    ------
    CdrError
        If the message is shorter or longer than its definition says, or its encapsulation is unknown.
    """
    return _Learner(message, definitions, budget, packed=packed).run(type_name)


class _Learner:
    """One walk through one message."""

    def __init__(self, message: bytes, definitions: Definitions, budget: Budget, *, packed: bool) -> None:
        self.message = message
        self.budget = budget
        self.definitions = definitions
        self.layout = MessageLayout(len(message), template=message)
        self.packed = packed
        self.order, self.widest, self.position = "<", 1, 0
        if not packed:
            self._encapsulation()

    def _encapsulation(self) -> None:
        message = self.message
        if len(message) < 4 or message[0] != 0 or message[1] > 11:
            raise CdrError("no CDR encapsulation")
        if message[1] in (2, 3, 8, 9, 10, 11):
            raise CdrError("parameter-list or delimited CDR is not supported")
        self.order = "<" if message[1] & 1 else ">"
        self.widest = 4 if message[1] >= 6 else 8
        self.position = 4
        self.layout.fixed.append((0, 2))

    def run(self, type_name: str) -> MessageLayout:
        self._message(type_name, "")
        if len(self.message) - self.position > (0 if self.packed else 7):  # writers of CDR may pad the end
            raise CdrError(f"{len(self.message) - self.position} bytes too many")
        self.layout.fixed = _joined(self.layout.fixed)
        return self.layout

    def _message(self, type_name: str, prefix: str) -> None:
        fields = self.definitions[type_name]
        if not fields and not self.packed:
            self._advance(1)  # an empty message is one byte
        for entry in fields:
            self.budget.step()
            path = f"{prefix}{entry.name}"
            if entry.count is None:
                self._values(entry.type, path, 1)
            else:
                count = entry.count or self._length()
                self._values(entry.type, path, count)

    def _values(self, type_name: str, path: str, count: int) -> None:
        if type_name in PRIMITIVES:
            self._numbers(PRIMITIVES[type_name], path, count)
            return
        if count > len(self.message):
            raise CdrError(f"{path}: {count} elements in {len(self.message)} bytes")
        if type_name == "string":
            known = self.layout.strings.setdefault(path, [])
            self.layout.starts.setdefault(path, []).append(len(known))
        self.budget.step(count)
        for _ in range(count):
            if type_name in ("string", "wstring"):
                self._string(path, wide=type_name == "wstring")
            else:
                self._message(type_name, f"{path}.")

    def _numbers(self, kind: str, path: str, count: int) -> None:
        blocks = self.layout.numbers.setdefault(path, [])
        if count == 0:
            return
        size = int(kind[1])
        self._align(size)
        offset = self.position
        self._advance(size * count)
        first = blocks[-1].first + blocks[-1].count if blocks else 0
        if blocks and blocks[-1].offset + size * blocks[-1].count == offset:
            blocks[-1].count += count
        else:
            blocks.append(CdrBlock(offset, f"{self.order}{kind}", count, first))

    def _string(self, path: str, *, wide: bool) -> None:
        length = self._length() * (4 if wide else 1)
        start = self.position
        self._advance(length)
        text = self.message[start : self.position].rstrip(b"\x00").decode("utf-8", "replace")
        self.layout.strings.setdefault(path, []).append(text)
        if path.rsplit(".", 1)[-1] in NAME_FIELDS:
            self.layout.fixed.append((start, self.position))

    def _length(self) -> int:
        self._align(4)
        start = self.position
        self._advance(4)
        self.layout.fixed.append((start, self.position))
        return int(struct.unpack_from(f"{self.order}I", self.message, start)[0])

    def _align(self, size: int) -> None:
        size = min(size, self.widest)
        self._advance(-(self.position - 4) % size)

    def _advance(self, count: int) -> None:
        self.position += count
        if self.position > len(self.message):
            raise CdrError("message ends before its definition does")


def _joined(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return neighbouring ranges as one; alignment bytes between two ranges may hold anything."""
    joined: list[tuple[int, int]] = []
    for start, stop in sorted(ranges):
        if start == stop:
            continue
        if joined and joined[-1][1] == start:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    return joined
