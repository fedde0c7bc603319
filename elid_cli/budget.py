"""What a reader may take of memory and time: so much as the file is large, and an absolute limit.

A few bytes can ask for gigabytes (compressed zeros, sizes that lie) or for hours (types nested in types). Readers ask
the file's budget before they take either; past it the file is refused in one error that names it. The limits are far
above what recorders write.
"""

from __future__ import annotations

from dataclasses import dataclass

from elid_cli.errors import LogError

FREE_BYTES, BYTES_PER_BYTE, MOST_BYTES = 256 << 20, 100, 1 << 40
"""Bytes unpacked from a file of any size, per byte of it, and at most."""
FREE_STEPS, STEPS_PER_BYTE, MOST_STEPS = 1_000_000, 5, 10**11
"""Records, names and fields looked at one by one, of a file of any size, per byte of it, and at most."""
MOST_AT_ONCE = 16 << 30
"""Bytes of one array."""


@dataclass
class Budget:
    """What is left for one file; `size` is its length in bytes."""

    name: str
    size: int
    taken: int = 0
    """Bytes that were unpacked."""
    steps: int = 0

    @property
    def most(self) -> int:
        """Bytes that the file may unpack to."""
        return min(MOST_BYTES, max(FREE_BYTES, BYTES_PER_BYTE * self.size))

    def take(self, count: int) -> None:
        """Ask for memory before it is taken (LogError)."""
        self.taken += count
        if self.taken > self.most or count > MOST_AT_ONCE:
            raise LogError(
                f"{self.name}: more than {min(self.most, MOST_AT_ONCE) >> 20} MiB in a file of {self.size} bytes",
                detail="refused before taking more memory; what recorders write is not packed so tightly",
                hint="if it is a log, unpack it, or record or export it again",
            )

    def step(self, count: int = 1) -> None:
        """Ask for time before it is spent (LogError)."""
        self.steps += count
        if self.steps > min(MOST_STEPS, FREE_STEPS + STEPS_PER_BYTE * self.size):
            raise LogError(
                f"{self.name}: more than {self.steps} records or fields in a file of {self.size} bytes",
                detail="refused before spending more time on it",
                hint="if it is a log, record or export it again",
            )
