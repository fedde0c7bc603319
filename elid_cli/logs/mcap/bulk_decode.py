"""Messages of a channel decoded in bulk, one NumPy view per layout.

Messages are grouped by length; the first of a group teaches a layout (`cdr`), which is then checked on all
others at once. What differs teaches the next layout, so that joint orders and frames may change at any message.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.logs.mcap.cdr import CdrError, MessageLayout, learn
from elid_cli.logs.mcap.container import Messages
from elid_cli.logs.mcap.fields import MessageShape
from elid_cli.logs.mcap.ros_schema import Definitions


class GrowingArray:
    """Rows appended to one array; growing re-uses the memory (realloc), so that nothing is ever held twice.

    With a sound `hint` of the final number of rows nothing is moved at all; memory is taken when it is written to.
    """

    def __init__(self, width: int | None, dtype: Any = np.float64, hint: int = 0) -> None:
        self._shape: tuple[int, ...] = () if width is None else (width,)
        self._array: NDArray[Any] = np.empty((hint, *self._shape), dtype)
        self.rows = 0

    def extend(self, count: int) -> NDArray[Any]:
        """Return a view of `count` new rows to be filled."""
        needed = self.rows + count
        if needed > self._array.shape[0]:
            rows = max(needed, 4096, int(self._array.shape[0] * 1.5))
            self._array.resize((rows, *self._shape), refcheck=False)
        start, self.rows = self.rows, needed
        return self._array[start:needed]

    def finish(self) -> NDArray[Any]:
        """Return all rows."""
        if self.rows < self._array.shape[0]:
            self._array.resize((self.rows, *self._shape), refcheck=False)
        return self._array


STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("stamp.sec", "stamp.nanosec"),
    ("time_stamp_sec", "time_stamp_nano_sec"),
)
REMEMBERED = 64
"""Layouts of one channel that are tried before a new one is learnt."""


SECOND = 1_000_000_000
"""Nanoseconds; those of a stamp are fewer."""


class MessageTable:
    """Everything wanted from one topic: growing columns for each (field, columns) and its clocks."""

    def __init__(self, wanted: Sequence[tuple[str, tuple[int | str, ...]]], hint: int = 0) -> None:
        self.wanted = tuple(dict.fromkeys(wanted))
        self.values = [GrowingArray(len(columns), hint=hint) for _, columns in self.wanted]
        self.header = GrowingArray(None, np.int64, hint)
        self.logged = GrowingArray(None, np.int64, hint)
        self.undecodable = 0
        self.problem = ""
        self.misstamped = 0
        """Messages whose stamp has less than none or a second and more of nanoseconds: it is no time, and 0 is kept."""

    def extend(self, log_times: NDArray[np.int64]) -> tuple[list[NDArray[Any]], NDArray[Any]]:
        """Add one row per message; return the new rows of every wanted column set and of the header stamps.

        The rows of the column sets have to be written whole, NaN where a message has nothing.
        """
        count = log_times.size
        self.logged.extend(count)[:] = log_times
        stamps = self.header.extend(count)
        stamps[:] = 0
        return [values.extend(count) for values in self.values], stamps


class CdrDecoder:
    """Bulk decoder of one channel's CDR messages, or those of ROS 1 (`packed`), into a table."""

    def __init__(self, type_name: str, definitions: Definitions, *, packed: bool = False) -> None:
        self._type = type_name
        self._packed = packed
        self._definitions = definitions
        self._layouts: list[_Plan] = []

    def shapes(self, messages: Messages, chosen: NDArray[np.intp]) -> list[MessageShape]:
        """Return the distinct shapes of some messages (for discovery)."""
        table = MessageTable(())
        self.decode(messages, chosen, table)
        return [plan.shape for plan in self._layouts]

    def texts(self, messages: Messages, index: int) -> tuple[dict[str, list[str]], dict[str, float]]:
        """Return the strings and the single numbers of one message, by path."""
        start = int(messages.offsets[index])
        data = messages.data[start : start + int(messages.lengths[index])]
        try:
            layout = self._learn(data, messages)
        except CdrError:
            return {}, {}
        single = {path: blocks[0] for path, blocks in layout.numbers.items() if layout.width(path) == 1}
        return layout.strings, {
            path: float(np.frombuffer(data, block.dtype, 1, block.offset)[0]) for path, block in single.items()
        }

    def _learn(self, message: bytes, messages: Messages) -> MessageLayout:
        return learn(message, self._type, self._definitions, messages.budget, packed=self._packed)

    def decode(self, messages: Messages, chosen: NDArray[np.intp], table: MessageTable) -> None:
        """Append the messages `chosen` (indices) to a table."""
        rows, stamps = table.extend(messages.log_times[chosen])
        offsets, lengths = messages.offsets[chosen], messages.lengths[chosen]
        if (lengths == lengths[0]).all():
            self._same_length(messages, offsets, int(lengths[0]), None, rows, stamps, table)
            return
        for length in np.unique(lengths):
            where = np.flatnonzero(lengths == length)
            self._same_length(messages, offsets[where], int(length), where, rows, stamps, table)

    def _same_length(
        self,
        messages: Messages,
        offsets: NDArray[np.int64],
        length: int,
        where: NDArray[np.intp] | None,
        rows: list[NDArray[Any]],
        stamps: NDArray[Any],
        table: MessageTable,
    ) -> None:
        matrix = _matrix(messages.data, offsets, length)
        for plan in [plan for plan in self._layouts if plan.layout.length == length]:
            where, matrix = self._take(plan, matrix, where, rows, stamps, table)
            if not matrix.shape[0]:
                return
        while matrix.shape[0]:
            try:
                layout = self._learn(matrix[0].tobytes(), messages)
            except CdrError as error:
                table.undecodable += 1
                table.problem = table.problem or str(error)
                for row in rows:
                    row[0 if where is None else where[0]] = np.nan
                where = np.arange(matrix.shape[0])[1:] if where is None else where[1:]
                matrix = matrix[1:]
                continue
            plan = _Plan(layout)
            self._layouts.insert(0, plan)
            del self._layouts[REMEMBERED:]
            where, matrix = self._take(plan, matrix, where, rows, stamps, table)

    def _take(
        self,
        plan: _Plan,
        matrix: NDArray[np.uint8],
        where: NDArray[np.intp] | None,
        rows: list[NDArray[Any]],
        stamps: NDArray[Any],
        table: MessageTable,
    ) -> tuple[NDArray[np.intp] | None, NDArray[np.uint8]]:
        """Store the messages that have a plan's layout; return those that have not."""
        same = plan.layout.matches(matrix)
        if same.all():
            plan.store(matrix, slice(None) if where is None else where, rows, stamps, table)
            return where, matrix[:0]
        if where is None:
            where = np.arange(matrix.shape[0])
        if same.any():
            plan.store(matrix[same], where[same], rows, stamps, table)
        return where[~same], matrix[~same]


class _Plan:
    """A layout with the column of every wanted value worked out once."""

    def __init__(self, layout: MessageLayout) -> None:
        self.layout = layout
        self.shape = MessageShape({p: layout.width(p) for p in layout.numbers}, layout.strings, layout.starts)
        self._columns: dict[tuple[str, tuple[int | str, ...]], list[tuple[int, str, list[int], list[int]]]] = {}

    def store(
        self,
        matrix: NDArray[np.uint8],
        where: Any,
        rows: list[NDArray[Any]],
        stamps: NDArray[Any],
        table: MessageTable,
    ) -> None:
        """Write the wanted numbers of messages, shape (M, length), to the table's rows `where`."""
        for wanted, target in zip(table.wanted, rows, strict=True):
            places = self._places(wanted)
            if sum(len(put) for *_, put in places) < target.shape[1]:
                target[where] = np.nan
            for offset, dtype, take, put in places:
                size = int(dtype[2])
                block = matrix[:, offset : offset + size * (max(take) + 1)].view(dtype)
                straight = take == list(range(len(take)))
                values = block if straight else block[:, take]
                if put == list(range(target.shape[1])):
                    target[where] = values
                elif isinstance(where, slice):
                    target[:, put] = values
                else:
                    target[np.ix_(where, put)] = values
        found = self._stamp(matrix)
        if found is not None:
            stamps[where], broken = found
            table.misstamped += broken

    def _stamp(self, matrix: NDArray[np.uint8]) -> tuple[NDArray[Any], int] | None:
        """Return the stamps of messages in ns, 0 where their nanoseconds are impossible, and how many those are."""
        for paths in STAMPS:
            if all(self.layout.width(path) == 1 for path in paths):
                whole, parts = (self.layout.numbers[path][0] for path in paths)
                seconds = _numbers(matrix, whole.offset, whole.dtype).astype(np.int64)
                seconds *= SECOND
                nanoseconds = _numbers(matrix, parts.offset, parts.dtype).astype(np.int64)
                seconds += nanoseconds
                broken = (nanoseconds < 0) | (nanoseconds >= SECOND)
                seconds[broken] = 0
                return seconds, int(np.count_nonzero(broken))
        return None

    def _places(self, wanted: tuple[str, tuple[int | str, ...]]) -> list[tuple[int, str, list[int], list[int]]]:
        """Return (offset, type, indices in the block, target columns) of every block that holds wanted values."""
        if wanted not in self._columns:
            field, columns = wanted
            found = self.shape.columns(field)
            places = []
            if found is not None:
                pairs = match_columns(columns, found.labels, len(found.indices))
                for block in self.layout.numbers[found.path]:
                    inside = [
                        (found.indices[source] - block.first, target)
                        for target, source in pairs
                        if 0 <= found.indices[source] - block.first < block.count
                    ]
                    if inside:
                        places.append((block.offset, block.dtype, [k for k, _ in inside], [j for _, j in inside]))
            self._columns[wanted] = places
        return self._columns[wanted]


def match_columns(columns: Sequence[int | str], labels: Sequence[str], width: int) -> list[tuple[int, int]]:
    """Return (target column, source index) of every wanted column that a message has."""
    pairs = []
    for target, column in enumerate(columns):
        if isinstance(column, str):
            if column in labels:
                pairs.append((target, labels.index(column)))
        elif column < width:
            pairs.append((target, column))
    return pairs


def _matrix(data: bytes, offsets: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """Return messages of one length as rows: a view where they lie evenly, a copy where not."""
    if offsets.size > 1:
        step = int(offsets[1] - offsets[0])
        if (np.diff(offsets) == step).all():
            return np.ndarray((offsets.size, length), np.uint8, data, int(offsets[0]), (step, 1))
    windows: NDArray[np.uint8] = np.ndarray((len(data) - length + 1, length), np.uint8, data, 0, (1, 1))
    return windows[offsets]


def _numbers(matrix: NDArray[np.uint8], offset: int, dtype: str) -> NDArray[Any]:
    column: NDArray[Any] = matrix[:, offset : offset + int(dtype[2])].view(dtype)[:, 0]
    return column
