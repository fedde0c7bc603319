"""Take a good log and break it in the ways that field logs are broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elid_cli.signals.recording import Recording
from tests.logs.made_logs import JOINTS, SIGNALS


@dataclass(frozen=True)
class Table:
    """A CSV log in memory."""

    names: tuple[str, ...]
    rows: np.ndarray

    def column(self, name: str) -> int:
        """Return the index of a column."""
        return self.names.index(name)

    def with_column(self, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Table:
        """Return the table with one column changed."""
        rows = self.rows.copy()
        rows[:, self.column(name)] = change(rows[:, self.column(name)])
        return replace(self, rows=rows)

    def with_time(self, change: Callable[[np.ndarray], np.ndarray]) -> Table:
        """Return the table with other stamps."""
        return self.with_column("t", change)

    def take(self, index: np.ndarray) -> Table:
        """Return chosen rows."""
        return replace(self, rows=self.rows[index])

    def without(self, *names: str) -> Table:
        """Return the table without some columns."""
        keep = [k for k, name in enumerate(self.names) if name not in names]
        return Table(tuple(self.names[k] for k in keep), self.rows[:, keep])

    def renamed(self, **names: str) -> Table:
        """Return the table with other column names (dots written as two underscores)."""
        mapping = {old.replace("__", "."): new for old, new in names.items()}
        return replace(self, names=tuple(mapping.get(name, name) for name in self.names))

    def text(self, separator: str = ",", decimal: str = ".", end: str = "\n") -> str:
        """Return the CSV text."""
        lines = [separator.join(self.names)]
        lines += [
            separator.join("" if x != x else repr(x) for x in row).replace(".", decimal) for row in self.rows.tolist()
        ]
        return end.join(lines) + end

    def save(self, path: Path) -> Path:
        """Write it."""
        path.write_text(self.text())
        return path


def table(base: Recording) -> Table:
    """Return a recording as a table."""
    names = ["t", *(f"{signal}.{joint}" for signal in SIGNALS for joint in JOINTS)]
    return Table(tuple(names), np.hstack([base.t[:, None], *(getattr(base, signal) for signal in SIGNALS)]))


def cut(data: bytes, at: int) -> bytes:
    """Return a file cut at a byte."""
    return data[:at]


def flipped(data: bytes, at: int) -> bytes:
    """Return a file with one byte changed."""
    return data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :]
