"""A table without names, columns of a text or one array: perhaps time, then blocks of one column per joint.

What the blocks are is told by the numbers where velocities are among them: they are the derivatives of the positions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.logs.contract import Channel, Pick, Stream
from elid_cli.robot.robot import Robot

HEADERLESS = re.compile(r"column\d+")
FIRST = "[0]"
"""What follows an array's name where its first column, which may be its time, is a channel of its own."""
BLOCKS = {1: ("q",), 2: ("q", "tau"), 3: ("q", "", "tau"), 4: ("q", "", "", "tau")}
"""Signals by columns per joint: velocities and accelerations are passed over."""
MOVED = {2: ("q", "dq"), 3: ("q", "dq", "tau"), 4: ("q", "dq", "", "tau")}
"""The same where the second block is the derivative of the first."""
WINDOW = 8
"""Samples over which a velocity is summed and compared with what the position moved by."""
DERIVED = 0.9
"""Correlation from which a column is another's derivative."""
ROWS = 20_000
"""Rows that are looked at."""
EVEN = 0.9
"""Share of a time's steps that are within a half of the usual one."""

Load = Callable[[Sequence[Pick]], Sequence[Stream]]


@dataclass(frozen=True)
class NamelessTable:
    """Columns of a text, or one array."""

    columns: tuple[str, ...]
    """Names of a text's columns; of an array only how many there are counts."""
    array: str = ""

    @staticmethod
    def of(channels: Sequence[Channel]) -> NamelessTable | None:
        """Return the table that a log is; None where it has names, or anything beside it but the array's own time."""
        sources = [channel.source for channel in channels]
        if sources and all(map(HEADERLESS.fullmatch, sources)):
            return NamelessTable(tuple(sources))
        wide = [c for c in channels if c.width > 1 and not c.labels and not c.field]
        if len(wide) != 1 or set(sources) - {wide[0].source, wide[0].source + FIRST}:
            return None
        return NamelessTable(tuple(map(str, range(wide[0].width))), wide[0].source)

    def values(self, load: Load) -> Array:
        """Return rows of all columns, (N, columns); none where they cannot be read."""
        columns = range(len(self.columns))
        picks = [Pick(self.array, "", tuple(columns))] if self.array else [Pick(c, "", (0,)) for c in self.columns]
        try:
            return np.hstack([stream.values[:ROWS] for stream in load(picks)])
        except (LogError, ValueError):
            return np.empty((0, len(self.columns)))

    def lines(self, joints: Sequence[str], blocks: Sequence[str], signals: Sequence[str], timed: bool) -> Iterator[str]:
        """Yield lines of a mapping: those of `signals`, and of velocities, that blocks hold for the joints."""
        if timed and "t" in signals:
            yield f't: {{from: "{self.array}{FIRST}"}}' if self.array else f"t: {{from: {self.columns[0]}}}"
        for number, signal in enumerate(blocks):
            if signal not in signals and signal != "dq":
                continue
            first = int(timed) + number * len(joints)
            if self.array:
                pairs = ", ".join(f"{joint}: {first + k}" for k, joint in enumerate(joints))
                yield f"{signal}: {{from: {self.array}, joints: {{{pairs}}}}}"
            else:
                yield f"{signal}: {{from: [{', '.join(self.columns[first : first + len(joints)])}]}}"


def proposed(table: NamelessTable, robot: Robot, signals: Sequence[str], load: Load) -> tuple[str, list[str]]:
    """Return lines that map `signals` to a table's columns, and the link to whose chain these belong; empty: none does.

    The chain is the whole robot's (an empty link) where the columns can be that, else the longest that has as many
    joints: those beside it are then a gripper's.
    """
    values = table.values(load)
    for timed in (True, False) if is_time(values[:, 0]) or not len(values) else (False,):
        body = values[:, int(timed) :]
        chains = _chains(robot)
        for width, blocks in _layouts(body, [len(joints) for _, joints in chains]):
            link, joints = next(((link, joints) for link, joints in chains if len(joints) == width), ("", ()))
            lines = list(table.lines(joints, blocks, signals, timed)) if joints else []
            if set(signals) - {"t"} <= {line.partition(":")[0] for line in lines}:
                return link, lines
    return "", []


def is_time(column: Array) -> bool:
    """Whether numbers advance in nearly even steps."""
    steps = np.diff(column)
    if not (steps.size and np.isfinite(steps).all() and (steps > 0).all()):
        return False
    return bool(np.mean(np.abs(steps / np.median(steps) - 1.0) < 0.5) >= EVEN)


def _chains(robot: Robot) -> list[tuple[str, tuple[str, ...]]]:
    """Return the robot's joints, then those of the chains to its links, the longest first."""
    found = []
    for link, by in robot.links.items():
        if by in robot.joint_names:
            from elid_cli.robot.locking import beside_chain

            beside = set(beside_chain(robot, link))
            found.append((link, tuple(name for name in robot.joint_names if name not in beside)))
    return [("", robot.joint_names), *sorted(found, key=lambda item: -len(item[1]))]


def _layouts(body: Array, widths: Sequence[int]) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield (joints, signals of the blocks) that a table may have; those alone that velocities show, if any do."""
    columns = body.shape[1]
    possible = [width for width in dict.fromkeys(widths) if width and columns % width == 0]
    shown = [w for w in possible if columns // w in MOVED and _derived(body[:, :w], body[:, w : 2 * w])]
    if shown:
        yield from ((width, MOVED[columns // width]) for width in shown)
        return
    yield from ((width, BLOCKS[columns // width]) for width in possible if columns // width in BLOCKS)


def _derived(position: Array, velocity: Array) -> bool:
    """Whether every column is the derivative of another, where that one moves."""
    if len(position) < 8 * WINDOW:
        return False
    way = position[WINDOW:] - position[:-WINDOW]
    total = np.cumsum(velocity, axis=0)
    summed = total[WINDOW:] - total[:-WINDOW]
    alike = []
    for a, b in zip(way.T, summed.T, strict=True):
        known = np.isfinite(a) & np.isfinite(b)
        if known.any() and np.ptp(a[known]) > 0:
            alike.append(np.ptp(b[known]) > 0 and np.corrcoef(a[known], b[known])[0, 1] > DERIVED)
    return bool(alike) and all(alike)
