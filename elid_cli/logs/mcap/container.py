"""The records of an MCAP file, walked from its start: no index, summary or footer is trusted or needed.

Whatever lies about its size is refused before memory is taken for it; what is cut or damaged is skipped and said.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from elid_cli.budget import Budget
from elid_cli.logs.mcap.compression import decompressed

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = 22
"""Bytes of a message record before its data: channel, sequence, log time, publish time."""
LARGEST_RECORD = 2 << 30
PIECE = 1 << 20
"""Bytes read at a time of what is passed over."""
LARGEST_SUMMARY = 256 << 20
GATHERED = 4 << 20
"""Bytes of messages outside chunks that are decoded together."""
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, STATISTICS, DATA_END = 1, 2, 3, 4, 5, 6, 7, 11, 15
READ = (SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX)
"""Records that are looked into; others, attachments among them, are passed over."""


class Readable(Protocol):
    """Bytes that can be read forwards."""

    def read(self, count: int, /) -> bytes:
        """Return up to `count` bytes."""


@dataclass
class Container:
    """What a walk has met: schemas and channels by id, and what was lost."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)
    chunks: int = 0
    file: str = ""
    """The file that is walked, by its whole name."""
    budget: Budget = field(default_factory=lambda: Budget("log", 0))


@dataclass(frozen=True)
class Messages:
    """Messages of one chunk: where their data lie in `data`."""

    data: bytes
    channels: NDArray[np.uint16]
    log_times: NDArray[np.int64]
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    budget: Budget
    """What is left for decoding them."""


def walk(stream: Readable, size: int | None, container: Container) -> Iterator[Messages]:
    """Yield the messages of every whole chunk (and of the file between chunks), in file order.

    Parameters
    ----------
    stream
        The file, at its start; it is only read forwards.
    size
        Its length in bytes where known: longer records are known to be cut without reading them.
    container
        Filled with schemas, channels and losses while walking.
    """
    start = position = len(stream.read(len(MAGIC)))
    gathered = _Gathered(container)
    ended = False
    while True:
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            break
        opcode, length = HEAD.unpack(head)
        start, position = position, position + HEAD.size + length
        if (size is not None and position > size) or length > LARGEST_RECORD or opcode == 0:
            break
        if opcode != MESSAGE_INDEX:
            yield from gathered.chunk()
        if opcode in (DATA_END, FOOTER):
            ended = True
            break
        container.budget.step()
        body = _body(stream, opcode, length)
        if body is None:
            break
        gathered.take(opcode, head, body, start)
        if len(gathered.loose) > GATHERED:
            yield from gathered.rest()
    yield from gathered.chunk()
    yield from gathered.rest()
    if not ended:
        lost = f", {size - start:d} bytes lost" if size is not None and position > start and size > start else ""
        container.losses.append(f"the file ends without its footer (cut while recording or copying{lost})")


class _Gathered:
    """What was read and not yet yielded: a chunk whose indexes may follow, and messages between chunks."""

    def __init__(self, container: Container) -> None:
        self.container = container
        self.loose = bytearray()
        self.pending: tuple[bytes, list[bytes]] | None = None

    def take(self, opcode: int, head: bytes, body: bytes, start: int) -> None:
        """Keep a record that begins at byte `start`."""
        if opcode == CHUNK:
            records = _chunk(body, start, self.container)
            self.pending = (records, []) if records is not None else None
        elif opcode == MESSAGE_INDEX and self.pending is not None:
            self.pending[1].append(body)
        elif opcode == MESSAGE:
            self.loose += head + body
        elif opcode in (SCHEMA, CHANNEL):
            _declare(opcode, body, self.container)

    def chunk(self) -> Iterator[Messages]:
        """Yield the messages of the chunk."""
        pending, self.pending = self.pending, None
        if pending is not None:
            yield from _messages(*pending, self.container)

    def rest(self) -> Iterator[Messages]:
        """Yield the messages between chunks."""
        if self.loose:
            yield from _messages(bytes(self.loose), [], self.container)
            self.loose.clear()


def _body(stream: Readable, opcode: int, length: int) -> bytes | None:
    """Return a record's content, empty where nobody needs it; None where the file ends within it."""
    if opcode not in READ:
        return b"" if _passed(stream, length) else None
    body = stream.read(length)
    return body if len(body) == length else None


def _passed(stream: Readable, length: int) -> bool:
    """Read over a record without holding it; return whether it is whole."""
    while length > 0:
        count = len(stream.read(min(length, PIECE)))
        if not count:
            return False
        length -= count
    return True


def summary(stream: IO[bytes], size: int) -> tuple[Container, dict[int, int]] | None:
    """Return channels and message counts of the summary, or None where the file's end is not sound.

    Only a hint: counts may lie, and channels may be missing.
    """
    tail = HEAD.size + 20 + len(MAGIC)
    if size < len(MAGIC) + tail:
        return None
    stream.seek(size - tail)
    end = stream.read(tail)
    opcode, length = HEAD.unpack_from(end)
    if not end.endswith(MAGIC) or opcode != FOOTER or length != 20:
        return None
    (begin,) = struct.unpack_from("<Q", end, HEAD.size)
    container = Container()
    counts: dict[int, int] = {}
    if not 0 < size - tail - begin <= LARGEST_SUMMARY or begin < len(MAGIC):
        return container, counts
    stream.seek(begin)
    data = stream.read(size - tail - begin)
    position = 0
    while position + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        body = data[position : position + length]
        position += length
        if opcode in (SCHEMA, CHANNEL):
            _declare(opcode, body, container)
        elif opcode == STATISTICS and len(body) >= 46:
            pairs = np.frombuffer(body[46 : len(body) - (len(body) - 46) % 10], np.dtype([("id", "<u2"), ("n", "<u8")]))
            counts = dict(zip(pairs["id"].tolist(), pairs["n"].tolist(), strict=True))
    return container, counts


def _chunk(body: bytes, start: int, container: Container) -> bytes | None:
    """Return the records of a chunk, or None (and a loss) where it is damaged."""
    container.chunks += 1
    try:
        return decompressed(body, container.budget)
    except (ValueError, struct.error, IndexError, UnicodeDecodeError) as error:
        when = ""
        if len(body) >= 16:
            first, last = struct.unpack_from("<QQ", body)
            if first <= last < first + 86_400 * 10**9:
                when = f", {(last - first) / 1e9:.3g} s of the log"
        container.losses.append(f"chunk {container.chunks} at byte {start} is damaged and left out ({error}{when})")
        return None


def _declare(opcode: int, body: bytes | memoryview, container: Container) -> None:
    """Take up a schema or a channel through the `mcap` package's own parsing."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile
    from mcap.records import Channel, Schema

    try:
        stream = ReadDataStream(BytesIO(body))
        if opcode == SCHEMA:
            schema = Schema.read(stream)
            container.schemas.setdefault(schema.id, schema)
        else:
            channel = Channel.read(stream)
            container.channels.setdefault(channel.id, channel)
    except (EndOfFile, struct.error, UnicodeDecodeError, ValueError, MemoryError):
        container.losses.append(f"a damaged {'schema' if opcode == SCHEMA else 'channel'} record is left out")


def _messages(data: bytes, indexes: list[bytes], container: Container) -> Iterator[Messages]:
    starts = _indexed(data, indexes, container) if indexes else None
    if starts is None:
        starts = _walked(data, container)
    if not starts.size:
        return
    lengths = _gather(data, "<u8", 1)[starts].astype(np.int64) - MESSAGE_HEAD
    yield Messages(
        data,
        _gather(data, "<u2", 9)[starts],
        _gather(data, "<u8", 15)[starts].astype(np.int64),
        starts + HEAD.size + MESSAGE_HEAD,
        lengths,
        container.budget,
    )


def _gather(data: bytes, dtype: str, shift: int) -> NDArray[Any]:
    """Return a view whose item k is the number at byte k + shift."""
    size = np.dtype(dtype).itemsize
    return np.ndarray((len(data) - size - shift + 1,), dtype, data, shift, (1,))


def _indexed(data: bytes, indexes: list[bytes], container: Container) -> NDArray[np.int64] | None:
    """Return the message records that the index names, once the lengths prove that they are all there are."""
    entries = [np.frombuffer(body, "<u8", offset=6) for body in indexes if len(body) >= 6 and (len(body) - 6) % 16 == 0]
    if len(entries) != len(indexes) or not any(entry.size for entry in entries):
        return None
    starts = np.sort(np.concatenate([entry[1::2] for entry in entries]).astype(np.int64))
    if starts[0] < 0 or starts[-1] > len(data) - HEAD.size - MESSAGE_HEAD:
        return None
    if not (np.frombuffer(data, np.uint8)[starts] == MESSAGE).all():
        return None
    lengths = _gather(data, "<u8", 1)[starts].astype(np.int64)
    if (lengths < MESSAGE_HEAD).any() or (lengths > len(data)).any():
        return None
    ends = starts + HEAD.size + lengths
    begins = np.append(starts, len(data))
    ends = np.insert(ends, 0, 0)
    holes = np.flatnonzero(begins != ends)
    if holes.size > 100:
        return None
    for hole in holes:  # schemas and channels between the messages; anything else is for the full walk
        if not _bridge(data, int(ends[hole]), int(begins[hole]), container):
            return None
    return starts


def _bridge(data: bytes, position: int, stop: int, container: Container) -> bool:
    while position < stop:
        if position + HEAD.size > stop:
            return False
        opcode, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        if position + length > stop or opcode == MESSAGE:
            return False
        if opcode in (SCHEMA, CHANNEL):
            _declare(opcode, data[position : position + length], container)
        position += length
    return position == stop


def _walked(data: bytes, container: Container) -> NDArray[np.int64]:
    """Return the starts of the message records by walking from record to record."""
    starts: list[int] = []
    position, end = 0, len(data)
    unpack = HEAD.unpack_from
    seen = 0
    while position + HEAD.size <= end:
        seen += 1
        if not seen & 0xFFFF:
            container.budget.step(0x10000)
        opcode, length = unpack(data, position)
        after = position + HEAD.size + length
        if after > end:
            break
        if opcode == MESSAGE and length >= MESSAGE_HEAD:
            starts.append(position)
        elif opcode in (SCHEMA, CHANNEL):
            _declare(opcode, data[position + HEAD.size : after], container)
        elif opcode == MESSAGE:
            container.losses.append("a message record is too short and left out")
        position = after
    if position != end:
        container.losses.append(f"{end - position} bytes at the end of a chunk are not whole records")
    return np.array(starts, dtype=np.int64)
