"""rosbag2 in SQLite (`.db3`): the same messages as in MCAP, in rows of a table; whole files or messages may be zstd."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from types import SimpleNamespace

import numpy as np

from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.formats.mcap import ZSTD_MAGIC, McapLog
from elid_cli.logs.mcap.container import Container, Messages
from elid_cli.logs.source import Source

SQLITE = b"SQLite format 3\x00"
STEP = 1 << 24
"""Bytes that are decompressed at a time where their number is not known."""
LONGEST = 256 << 20
"""Bytes of one message."""
INSTRUCTIONS = 10_000
"""SQLite's instructions between two looks at whether to go on."""
FREE_STEPS, STEPS_PER_BYTE = 20_000_000, 50
"""Such instructions of a file of any size, and per byte of it."""
AT_ONCE, TOGETHER = 5000, 32 << 20
"""Messages, and bytes of them, from which on they are decoded together: a bag may hold images."""
IN_ORDER = """SELECT topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END
FROM (SELECT rowid AS row FROM messages ORDER BY timestamp, id LIMIT -1) CROSS JOIN messages ON messages.rowid = row"""
"""Messages in order of time: row numbers are sorted, and not the messages, of which each would be held three times. The
limit keeps the order of the inner query; a message that is too long is none."""
MOST_TOPICS = 1 << 16
"""Numbers that topics may have."""
LATEST = 1 << 63
"""ns since 1970 that a time may be."""


class Db3Log(McapLog):
    """One database, or several that continue each other."""

    def _summary(self) -> tuple[set[str] | None, dict[str, int]]:
        return None, {}

    def _walk(self, *, told: bool = False) -> Iterator[tuple[Container, Messages]]:
        for number, source in enumerate(self._sources):
            container = Container(budget=Budget(source.name, source.size), file=source.name)
            try:
                with closing(_opened(source, container.budget)) as base:
                    _restrict(base, source, container.budget)
                    yield from ((container, messages) for messages in _messages(base, container))
            except sqlite3.Error as error:
                self.losses.append(f"{source.name}: the database is damaged ({str(error).lower()[:80]})")
            if told:
                self._sources[0].tell((number + 1) / len(self._sources))


def _restrict(base: sqlite3.Connection, source: Source, budget: Budget) -> None:
    """Keep reading within the file's budget, and refuse what is not a plain table."""
    base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(budget.most, LONGEST))
    base.set_progress_handler(_Patience(source.size), INSTRUCTIONS)
    kinds = {name: kind for name, kind in base.execute("SELECT name, type FROM sqlite_master")}
    for table in ("topics", "messages"):
        # a view, or a column that is computed, can hold rows and bytes without end
        if kinds.get(table) != "table":
            raise sqlite3.DatabaseError(f"no table {table}")
        if any(column[6] for column in base.execute(f"PRAGMA table_xinfo({table})")):
            raise sqlite3.DatabaseError(f"columns of {table} are computed")


class _Patience:
    """Ends a query that takes more steps than rows of a file of this size can need."""

    def __init__(self, size: int) -> None:
        self._left = (FREE_STEPS + STEPS_PER_BYTE * size) // INSTRUCTIONS

    def __call__(self) -> bool:
        """Return whether to end it."""
        self._left -= 1
        return self._left < 0


def _opened(source: Source, budget: Budget) -> sqlite3.Connection:
    if source.path is not None and source.head.startswith(SQLITE):
        return sqlite3.connect(f"{source.path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    data = source.read()
    if data.startswith(ZSTD_MAGIC):
        data = _unzstd(data, budget)
    base = sqlite3.connect(":memory:")
    try:
        base.deserialize(data)
    except sqlite3.Error:
        base.close()
        raise
    return base


def _unzstd(data: bytes, budget: Budget) -> bytes:
    import zstandard

    try:
        size = zstandard.frame_content_size(data)
        budget.take(max(size, 0))
        if size >= 0:
            return zstandard.ZstdDecompressor().decompressobj().decompress(data)
        parts = []
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:  # its size is not told: bit by bit
            while part := reader.read(STEP):
                budget.take(len(part))
                parts.append(part)
        return b"".join(parts)
    except zstandard.ZstdError as error:
        raise LogError("rosbag2: damaged zstd data", detail=str(error).lower()) from error


def _messages(base: sqlite3.Connection, container: Container) -> Iterator[Messages]:
    """Yield the messages in order of time; schemas and channels go to `container`."""
    tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    texts: dict[str, bytes] = {}
    if "message_definitions" in tables:  # since ROS 2 Iron
        for kind, text in base.execute("SELECT topic_type, encoded_message_definition FROM message_definitions"):
            texts[str(kind)] = str(text).encode()
    lost = 0
    for row in base.execute("SELECT id, name, type, serialization_format FROM topics"):
        key, topic, kind, encoding = row
        if not (_whole(key, MOST_TOPICS) and all(isinstance(text, str) for text in row[1:])):
            lost += 1  # a column of SQLite holds whatever it is given
            continue
        container.schemas[key] = SimpleNamespace(name=kind, encoding="ros2msg", data=texts.get(kind, b""))
        container.channels[key] = SimpleNamespace(topic=topic, message_encoding=encoding, schema_id=key)
    waiting: list[tuple[int, int, bytes]] = []
    size = 0
    for key, stamp, data in base.execute(IN_ORDER, (LONGEST,)):
        if not (key in container.channels and _whole(stamp, LATEST) and isinstance(data, bytes)):
            lost += 1
            continue
        part = _unzstd(data, container.budget) if data.startswith(ZSTD_MAGIC) else data
        if waiting and (len(waiting) >= AT_ONCE or size + len(part) > TOGETHER):
            yield _together(waiting, container)
            waiting, size = [], 0
        waiting.append((key, stamp, part))
        size += len(part)
    if waiting:
        yield _together(waiting, container)
    if lost:
        raise sqlite3.DatabaseError(f"{lost} rows are neither messages nor topics")


def _whole(value: object, end: int) -> bool:
    return isinstance(value, int) and 0 <= value < end


def _together(rows: Sequence[tuple[int, int, bytes]], container: Container) -> Messages:
    """Return rows (topic, time in ns, message) as messages."""
    keys, stamps, parts = zip(*rows, strict=True)
    lengths = np.array([len(part) for part in parts], dtype=np.int64)
    return Messages(
        b"".join(parts),
        np.array(keys, dtype=np.uint16),
        np.array(stamps, dtype=np.int64),
        np.cumsum(lengths) - lengths,
        lengths,
        container.budget,
    )


def open_bags(
    name: str, files: Sequence[Source], missing: Sequence[str] = (), listed: Sequence[str] = ()
) -> list[Db3Log]:
    """Return the log of databases that continue each other; `listed`: those that are known to."""
    return [Db3Log(name, files, missing, listed)]


def _recognise(source: Source) -> bool:
    if not source.head.startswith(ZSTD_MAGIC):
        return source.head.startswith(SQLITE)
    import zstandard

    with source.stream() as stream, zstandard.ZstdDecompressor().stream_reader(stream, closefd=False) as reader:
        try:
            return bool(reader.read(len(SQLITE)) == SQLITE)
        except zstandard.ZstdError:
            return False


FORMAT = LogFormat(
    name="rosbag2 SQLite",
    suffixes=(".db3",),
    recognise=_recognise,
    open=lambda source: open_bags(source.name, [source]),
    priority=10,
)
