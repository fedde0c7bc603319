"""Files of a folder that are no parts of one recording: they hold messages of the same time, some of them twice."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import LogError, in_words

ENDS = (0.05, 0.95)
"""Shares of a file's messages between which its time lies: parts of a recording may overlap a little at their ends."""
NAMED = 5
"""Files that an error names."""


@dataclass
class Parts:
    """How many messages of every topic each file has brought, in the order in which they were read."""

    listed: Collection[str] = ()
    """Files that metadata.yaml says are parts of one recording, by their whole names."""
    counts: dict[str, dict[str, int]] = field(default_factory=dict)

    def take(self, topic: str, file: str, count: int) -> None:
        """Count messages of a topic that a file has brought."""
        files = self.counts.setdefault(topic, {})
        files[file] = files.get(file, 0) + count

    def check(self, name: str, topic: str, clocks: Mapping[str, NDArray[Any]]) -> None:
        """Refuse a log, called `name`, of files that are of the same time by the clocks of a topic's messages.

        Raises
        ------
        LogError
            Naming the files, and how to name logs one by one.
        """
        counts = self.counts.get(topic, {})
        if len(counts) < 2:
            return
        stamps = np.where(clocks["header stamp"] > 0, clocks["header stamp"], clocks["log time"])
        ends = np.cumsum(list(counts.values()))[:-1]
        spans = [_span(part) for part in np.split(stamps, ends)]
        alike = list(dict.fromkeys(file for pair in self._alike(list(counts), spans) for file in pair))
        if alike:
            names = in_words([PurePath(file).name for file in alike], NAMED)
            raise LogError(
                f"{name}: {names} have messages of the same time: they are not the parts of one recording",
                detail=f"{topic} would count several times; files that metadata.yaml lists are read as one",
                hint=f"name the logs that you mean one by one, such as {alike[0]}",
            )

    def _alike(self, files: Sequence[str], spans: Sequence[tuple[float, float] | None]) -> Iterator[tuple[str, str]]:
        """Yield pairs of files whose times overlap, of which metadata.yaml does not list both."""
        for k, (one, mine) in enumerate(zip(files, spans, strict=True)):
            for other, its in zip(files[:k], spans[:k], strict=True):
                if mine is None or its is None or (one in self.listed and other in self.listed):
                    continue
                if max(mine[0], its[0]) < min(mine[1], its[1]):
                    yield other, one


def _span(stamps: NDArray[Any]) -> tuple[float, float] | None:
    """Return the time of most of a file's messages, ns; None where it has none, or no time that advances."""
    if stamps.size < 2:
        return None
    begin, end = np.quantile(stamps, ENDS, method="nearest").tolist()
    return (begin, end) if end > begin else None
