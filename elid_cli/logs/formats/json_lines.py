"""JSON lines: one object per row, as scripts dump samples and messages.

Objects are flattened to the columns of a table: ``{"t": 0, "q": [1, 2]}`` has ``t``, ``q[0]`` and ``q[1]``; nested keys
are joined by dots. A message beside its topic (``{"topic": …, "msg": {…}}``) has columns as PlotJuggler writes them,
``/joint_states/position.joint1``, by the names that it gives; joint states without a topic are called so. Rows of
several topics leave each other's columns empty.
"""

from __future__ import annotations

import csv
import io
import json
import math
import zlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.budget import Budget
from elid_cli.errors import LogError, first_of
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.formats.csv import CUT, GZIP, MOST_COLUMNS, TIME_NAMES, CsvLog, unpack
from elid_cli.logs.formats.csv_dialect import LONGEST_LINE, Dialect, without_units
from elid_cli.logs.formats.csv_text import REPORTED, parted
from elid_cli.logs.source import Source

WIDEST = 1000
"""Values of a list that become columns; what is longer is an image."""
DEEPEST = 8
"""Objects within objects that are looked into."""
HEAD = 1000
"""Rows by which a table in long form is known."""
GLANCE = 1 << 20
"""Bytes in which the second line is looked for."""
TOPICS, MESSAGES = ("topic", "channel", "topic_name"), ("msg", "message", "data", "payload", "value")
"""Keys of a topic and of the message beside it."""
NAMES = ("name", "names", "joint_names")
"""Keys of a message's list of names."""
SECONDS, NANOSECONDS = ("sec", "secs"), ("nanosec", "nsec", "nsecs")
STAMP = "header.stamp"
"""Column of the stamps of messages' headers, s since the first."""
CLOCKS = (*TIME_NAMES, "log_time", "publish_time", "receive_time", "ts", "stamp_ns", "timestamp_ns")
STATES = "/joint_states"


class _Table:
    """Columns that grow row by row; what a row lacks is NaN, or an empty text."""

    def __init__(self, name: str, size: int) -> None:
        self._name, self._budget = name, Budget(name, size)
        self._spelt: dict[str, str] = {}
        self._first: int | None = None
        self.rows = 0
        self.numbers: dict[str, array[float]] = {}
        self.texts: dict[str, list[str]] = {}

    def add(self, row: Mapping[str, Any]) -> None:
        """Add one object as a row."""
        topic, message = _message(row)
        if message is not row:
            self._put_all(((k, v) for k, v in row.items() if v is not message and k not in TOPICS), "", (), 0)
        names: Sequence[str] = next((message[key] for key in NAMES if _is_names(message.get(key))), ())
        stamp = _stamp(message)
        if stamp:
            self._first = stamp if self._first is None else self._first
            self._put(STAMP, (stamp - self._first) * 1e-9)
        place = f"{topic}/" if topic else f"{STATES}/" if names and "position" in message else ""
        if not topic:  # the row's own clock, not a field of joint states
            self._put_all(((k, v) for k, v in message.items() if k in CLOCKS), "", (), 0)
        told = {
            "header",
            *(CLOCKS if not topic else ()),
            *(key for key in NAMES if names and message.get(key) is names),
        }
        self._put_all((item for item in message.items() if item[0] not in told), place, names, 0)
        self.rows += 1

    def _put_all(self, items: Iterator[tuple[str, Any]], place: str, names: Sequence[str], depth: int) -> None:
        for key, value in items:
            if not isinstance(value, list | dict):
                self._put(f"{place}{key}", value)
            elif depth < DEEPEST:
                inner = value.items() if isinstance(value, dict) else _numbered(value, names)
                dot = "." if isinstance(value, dict) or len(value) == len(names) else ""
                self._put_all(iter(inner), f"{place}{key}{dot}", names, depth + 1)

    def _put(self, name: str, value: object) -> None:
        known: Any = self.texts if isinstance(value, str) else self.numbers
        if name not in known:
            if len(known) >= MOST_COLUMNS:
                raise LogError(f"{self._name}: more than {MOST_COLUMNS} columns", detail="as many are read at most")
            known[name] = [] if isinstance(value, str) else array("d")
        column = known[name]
        missing = self.rows - len(column)
        if missing < 0:
            return  # named twice: {"a.b": 1, "a": {"b": 2}}
        self._budget.take(8 * (missing + 1))
        if isinstance(value, str):
            if value not in self._spelt:
                self._budget.take(len(value))
            column.extend([""] * missing)
            column.append(self._spelt.setdefault(value, value))
        else:
            if missing:
                column.extend(array("d", [math.nan]) * missing)
            column.append(_number(value))

    def column(self, name: str, rows: int | None = None) -> Array:
        """Return a column of numbers, of the first rows or all."""
        count = self.rows if rows is None else min(rows, self.rows)
        found = np.full(count, np.nan)
        values = self.numbers[name][:count]
        found[: len(values)] = values
        return found


def _message(row: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """Return the topic of a row and its message, which is the row itself where it names no topic."""
    topic = next((row[key] for key in TOPICS if isinstance(row.get(key), str)), "")
    message = next((row[key] for key in MESSAGES if isinstance(row.get(key), dict)), None)
    return (topic, message) if topic and message is not None else ("", row)


def _is_names(value: object) -> bool:
    return isinstance(value, list) and 0 < len(value) <= WIDEST and all(isinstance(name, str) for name in value)


def _numbered(values: list[Any], names: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield the values of a list by name where there are as many, else ``[0]``, ``[1]``…; none of an image's."""
    if len(values) == len(names):
        yield from zip(names, values, strict=True)
    elif len(values) <= WIDEST:
        yield from ((f"[{k}]", value) for k, value in enumerate(values))


def _stamp(message: Mapping[str, Any]) -> int:
    """Return the stamp of a message's header, ns; 0 where there is none."""
    header = message.get("header", message)
    stamp = header.get("stamp") if isinstance(header, dict) else None
    if not isinstance(stamp, dict):
        return 0
    whole, part = (next((stamp[k] for k in keys if k in stamp), 0) for keys in (SECONDS, NANOSECONDS))
    fits = isinstance(whole, int) and isinstance(part, int) and 0 <= whole < 1 << 40 and 0 <= part < 10**9
    return whole * 10**9 + part if fits else 0


def _number(value: object) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.nan


class JsonLinesLog(CsvLog):
    """A table of all lines; those that hold no object are left out and said."""

    def __init__(self, source: Source) -> None:
        self._name, self._tell = source.name, source.tell
        data, whole = unpack(source.read(), source.name)
        self._table, faulty = _Table(source.name, len(data)), []
        for number, line in enumerate(io.BytesIO(data), start=1):
            row = _object(line)
            if row is not None:
                self._table.add(row)
            elif line.strip():
                faulty.append(f"line {number}")
            if number % HEAD == 0:
                self._tell(number * len(line) / len(data))
        if not self._table.rows or not self._table.numbers:
            raise LogError(f"{source.name}: no line of numbers", hint="one JSON object per line, each of them a sample")
        names, units = without_units(tuple(self._table.numbers))
        self._titles = dict(zip(names, self._table.numbers, strict=True))
        self._dialect = Dialect(",", False, (*names, *self._table.texts), True, 0, 2, units)
        self._head = self._as_text(HEAD)
        self._dialect = Dialect(",", False, self._dialect.names, True, self._head.find("\n") + 1, 2, units)
        self._name_columns()
        stamped = STAMP in names and np.isfinite(self._table.column(STAMP)).all()
        self._time = STAMP if stamped else next((name for name in (*CLOCKS, STAMP) if name in names), "")
        if faulty:
            listed = first_of(faulty, REPORTED)
            self.losses.append(f"{len(faulty)} lines without a JSON object left out: {listed}")
        if not whole:
            self.losses.append(CUT)

    @property
    def _text(self) -> str:
        """The whole table as CSV, for one in long form."""
        return self._as_text(self._table.rows)

    def _as_text(self, rows: int) -> str:
        text, table = io.StringIO(), self._table
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self._dialect.names)
        numbers = [table.column(name, rows).tolist() for name in table.numbers]
        texts = [column[:rows] + [""] * (min(rows, table.rows) - len(column)) for column in table.texts.values()]
        writer.writerows(zip(*numbers, *texts, strict=True))
        return text.getvalue()

    def _parsed(self, wanted: Sequence[Sequence[str]]) -> tuple[list[Array], list[str]]:
        """Return a table per group of wanted columns; of texts NaN."""
        empty, titles = np.full(self._table.rows, np.nan), self._titles
        columns = [self._table.column(titles[n]) if n in titles else empty for group in wanted for n in group]
        return parted(np.stack(columns, axis=1), wanted), []


def _object(line: bytes) -> Mapping[str, Any] | None:
    """Return what a line holds; None where it is no object, cut, or nested too deeply to be a message."""
    if len(line) > LONGEST_LINE:
        return None
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _recognise(source: Source) -> bool:
    if source.is_folder:
        return False
    head = source.head
    if head.startswith(GZIP):
        try:
            head = zlib.decompressobj(wbits=31).decompress(source.read(GLANCE), GLANCE)
        except zlib.error:
            return False
    if not head.lstrip().startswith(b"{"):
        return False
    if b"\n" not in head.strip():
        head = source.read(GLANCE)
    first, _, rest = head.lstrip().partition(b"\n")
    return _object(first) is not None and rest.lstrip().startswith(b"{")


FORMAT = LogFormat(
    name="JSON lines",
    suffixes=(".jsonl", ".ndjson"),
    recognise=_recognise,
    open=lambda source: [JsonLinesLog(source).narrowed()],
    priority=30,
)
