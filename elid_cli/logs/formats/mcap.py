"""MCAP logs: topics of CDR, JSON or protobuf messages, chunk by chunk; damaged files give what is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import Channel, LogFormat, Pick, Stream
from elid_cli.logs.mapping.language import COMMANDS
from elid_cli.logs.mcap.bulk_decode import CdrDecoder, MessageTable
from elid_cli.logs.mcap.container import MAGIC, Container, Messages, Readable, summary, walk
from elid_cli.logs.mcap.fields import NameTable, covariances, values_topic, without_unmeasured
from elid_cli.logs.mcap.flat_decode import FlatDecoder, flat_json
from elid_cli.logs.mcap.protobuf import flattener
from elid_cli.logs.mcap.ros_schema import definitions_of, short_name
from elid_cli.logs.mcap.same_time import Parts
from elid_cli.logs.mcap.write import write_mcap
from elid_cli.logs.source import Source
from elid_cli.signals.recording import INERTIAL

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
CANONICAL = {
    "q": {"from": "/joint_states", "field": "position"},
    "dq": {"from": "/joint_states", "field": "velocity"},
    "tau_link": {"from": "/joint_states", "field": "effort"},
    "theta": {"from": "/motor_states", "field": "position"},
    "dtheta": {"from": "/motor_states", "field": "velocity"},
    "tau": {"from": "/motor_states", "field": "effort"},
    **{signal: {"from": "/imu/{joint}"} for signal in INERTIAL},
}
BARE = {signal: spec | {"from": spec["from"].lstrip("/")} for signal, spec in CANONICAL.items()}
NAMED = ("sensor_msgs/JointState", "control_msgs/DynamicJointState", "std_msgs/Float64MultiArray")
"""The types that are read without their schema, as errors list them."""
MOST_FIELDS = 20_000
"""Fields of all topics that are listed."""
EMPTY_CHUNKS = 4
"""Chunks without a channel not seen before, after which discovery stops where a summary says what to expect."""


class McapLog:
    """One MCAP file, or several that continue each other (the splits of a rosbag2 folder)."""

    def __init__(
        self, name: str, sources: Sequence[Source], missing: Sequence[str] = (), listed: Sequence[str] = ()
    ) -> None:
        self._name = name
        self._sources = sources
        self._missing, self._listed = list(missing), listed
        self.losses: list[str] = list(missing)
        self.notes: list[str] = []
        self._decoders: dict[tuple[str, str, str, bytes], CdrDecoder | FlatDecoder | None] = {}
        self._names: dict[str, NameTable] = {}
        self.undecoded: dict[str, str] = {}
        """Topics that cannot be decoded -> why."""
        self.channels: Sequence[Channel] = self._discover()

    @property
    def canonical(self) -> Sequence[Mapping[str, Any]]:
        """Link side on /joint_states, motor side on /motor_states, inertial sensors on /imu and the joint's name."""
        return [CANONICAL, BARE]

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        """Decode the wanted topics in one pass (two where names and values are topics of their own)."""
        told = covariances(picks, self.channels)
        streams = self._loaded_by_name([*picks, *told.values()])
        return without_unmeasured(picks, streams, told, self.notes)

    def _loaded_by_name(self, picks: Sequence[Pick]) -> list[Stream]:
        paired = {pick.source for pick in picks} & set(self._names)
        if not paired:
            return self._loaded(picks)
        for _ in self._walk_names():  # names that change later on
            pass
        fields = {topic: [c.field for c in self.channels if c.source == topic] for topic in paired}
        asked = [
            self._names[pick.source].asked(pick, fields[pick.source]) if pick.source in paired else [pick]
            for pick in picks
        ]
        loaded = iter(self._loaded([one for several in asked for one in several]))
        streams = []
        for pick, several in zip(picks, asked, strict=True):
            parts = [next(loaded) for _ in several]
            table = self._names.get(pick.source)
            streams.append(parts[0] if table is None else table.chosen(pick, parts, self._name))
        return streams

    def _walk_names(self) -> Iterator[None]:
        self.losses[:] = self._missing
        for container, messages in self._walk():
            self._take_names(container, messages)
            yield

    def _take_names(self, container: Container, messages: Messages) -> None:
        """Take up the messages of names whose values are another topic."""
        topics = {identifier: channel.topic for identifier, channel in container.channels.items()}
        for identifier, topic in topics.items():
            sibling = values_topic(topic, topics.values())
            if not sibling:
                continue
            table = self._names.setdefault(sibling, NameTable(sibling))
            decoder = self._decoder(container.channels[identifier], container)
            if decoder is None:
                continue
            for index in np.flatnonzero(messages.channels == identifier).tolist():
                logged = int(messages.log_times[index])
                texts, scalars = decoder.texts(messages, index)
                table.take_up(texts, scalars, logged)

    def _loaded(self, picks: Sequence[Pick]) -> list[Stream]:
        wanted: dict[str, list[tuple[str, tuple[int | str, ...]]]] = {}
        for pick in picks:
            wanted.setdefault(pick.source, []).append((pick.field, pick.columns))
            if pick.time:
                wanted[pick.source].append((pick.time, (0,)))
        known = {channel.source: channel.rows or 0 for channel in self.channels}
        most = sum(source.size for source in self._sources)  # a summary may lie; a message takes more than a byte
        tables = {topic: MessageTable(fields, min(known.get(topic, 0), most)) for topic, fields in wanted.items()}
        self.losses[:] = self._missing
        parts = Parts(self._listed)
        for container, messages in self._walk(told=True):
            for identifier in np.unique(messages.channels):
                channel = container.channels.get(int(identifier))
                table = tables.get(channel.topic) if channel is not None else None
                decoder = self._decoder(channel, container) if table is not None else None
                if channel is not None and table is not None and decoder is not None:
                    chosen = np.flatnonzero(messages.channels == identifier)
                    decoder.decode(messages, chosen, table)
                    parts.take(channel.topic, container.file, chosen.size)
        for topic, table in tables.items():
            if table.misstamped:
                self.losses.append(
                    f"{table.misstamped} messages of {topic} have stamps with impossible nanoseconds: not used as times"
                )
            if table.undecodable:
                self.losses.append(f"{table.undecodable} messages of {topic} cannot be decoded ({table.problem})")
        return self._streams(picks, tables, parts)

    def _streams(self, picks: Sequence[Pick], tables: Mapping[str, MessageTable], parts: Parts) -> list[Stream]:
        clocks: dict[str, dict[str, Any]] = {}
        values: dict[tuple[str, str, tuple[int | str, ...]], Any] = {}
        for topic, table in tables.items():
            clocks[topic] = {"header stamp": table.header.finish(), "log time": table.logged.finish()}
            parts.check(self._name, topic, clocks[topic])
            for (field, columns), grown in zip(table.wanted, table.values, strict=True):
                values[topic, field, columns] = grown.finish()
        streams = []
        for pick in picks:
            stamps = clocks[pick.source]
            if pick.time:
                stamps = {"t": values[pick.source, pick.time, (0,)][:, 0], **stamps}
            streams.append(Stream(values[pick.source, pick.field, pick.columns], stamps))
        return streams

    def _discover(self) -> tuple[Channel, ...]:
        """Find topics, fields and joint names from the first chunks (all of them where there is no summary)."""
        expected, counts = self._summary()
        found: dict[tuple[str, str], Channel] = {}
        seen: set[str] = set()
        barren = 0
        for container, messages in self._walk():
            before = len(seen)
            self._take_names(container, messages)
            for identifier in np.unique(messages.channels):
                channel = container.channels.get(int(identifier))
                if channel is None:
                    continue
                seen.add(channel.topic)
                decoder = self._decoder(channel, container)
                if decoder is not None:
                    chosen = np.flatnonzero(messages.channels == identifier)[:200]
                    kind, rows = _type_of(channel, container), counts.get(channel.topic)
                    _add_fields(found, channel.topic, decoder.shapes(messages, chosen), kind, rows)
            if len(found) > MOST_FIELDS:
                raise LogError(
                    f"{self._name}: its messages have more than {MOST_FIELDS} fields",
                    detail=f"the last of them {channel.topic if channel is not None else ''}",
                    hint="record the topics that hold the robot's joints alone",
                )
            barren = 0 if len(seen) > before else barren + 1
            nameless = expected is not None and any(values_topic(topic, expected) for topic in expected - seen)
            if expected is not None and (expected <= seen or (barren >= EMPTY_CHUNKS and not nameless)):
                break
        for topic, reason in self.undecoded.items():
            found.setdefault((topic, ""), Channel(topic, "", 0, (), counts.get(topic), reason))
        channels = list(found.values())
        self._names = {topic: table for topic, table in self._names.items() if table.orders}
        for table in self._names.values():
            channels = table.named(channels)
        return tuple(channels)

    def _summary(self) -> tuple[set[str] | None, dict[str, int]]:
        """Return the topics and message counts of the summary where the file has a sound one, else None."""
        if len(self._sources) != 1 or self._sources[0].head.startswith(ZSTD_MAGIC):
            return None, {}
        with self._sources[0].stream() as stream:
            found = summary(stream, self._sources[0].size)
        if found is None:
            self.notes.append("the end of the file is cut, its summary is not used")
            return None, {}
        container, by_channel = found
        if not container.channels or not by_channel:
            return None, {}
        counts: dict[str, int] = {}
        for identifier, channel in container.channels.items():
            counts[channel.topic] = counts.get(channel.topic, 0) + by_channel.get(identifier, 0)
        return {topic for topic, count in counts.items() if count}, counts

    def _walk(self, *, told: bool = False) -> Iterator[tuple[Container, Messages]]:
        sizes = [source.size for source in self._sources]
        for number, source in enumerate(self._sources):
            before = sum(sizes[:number])
            container = Container(budget=Budget(source.name, source.size), file=source.name)
            if not source.head.startswith((MAGIC, ZSTD_MAGIC)):
                self.losses.append(f"{source.name} is {'no MCAP file' if source.head else 'empty'}, left out")
                continue
            with _bytes(source) as (stream, size, place):
                for messages in walk(stream, size, container):
                    yield container, messages
                    if told:
                        self._sources[0].tell((before + place()) / max(sum(sizes), 1))
            prefix = f"{source.name}: " if len(self._sources) > 1 else ""
            self.losses.extend(prefix + loss for loss in container.losses)

    def _decoder(self, channel: Any, container: Container) -> CdrDecoder | FlatDecoder | None:
        schema = container.schemas.get(channel.schema_id)
        name, language, data = (schema.name, schema.encoding, schema.data) if schema is not None else ("", "", b"")
        key = (channel.topic, channel.message_encoding, name, data)
        if key not in self._decoders:
            decoder, reason = make_decoder(channel.message_encoding, name, language, data)
            self._decoders[key] = decoder
            if decoder is None:
                self.undecoded[channel.topic] = reason
        return self._decoders[key]


UNDEFINED = "the bag does not hold its definition"
"""What is said of messages that cannot be decoded without it."""


def make_decoder(encoding: str, name: str, language: str, schema: bytes) -> tuple[CdrDecoder | FlatDecoder | None, str]:
    """Return the decoder of a channel, or None and the reason."""
    known = name or "no type"
    if encoding == "json":
        return FlatDecoder(flat_json), ""
    if encoding in ("cdr", "ros1"):
        text = schema.decode("utf-8", "replace") if language in ("ros2msg", "ros1msg", "") else ""
        definitions = definitions_of(name, text)
        if definitions is not None:
            return CdrDecoder(short_name(name), definitions, packed=encoding == "ros1"), ""
        if not schema:  # bags before ROS 2 Iron
            return (
                None,
                f"{known}: {UNDEFINED}; expected ros2msg text or one of the types known by name, {', '.join(NAMED)}",
            )
        return None, (
            f"{known}: its schema is {language or 'empty'}, expected ros2msg text or one of the types known by name, "
            f"{', '.join(NAMED)}"
        )
    if encoding == "protobuf":
        flatten = flattener(name, schema)
        if flatten is not None:
            return FlatDecoder(flatten), ""
        return None, f"{known}: its protobuf descriptor is missing or damaged"
    return None, f"{known}: encoding {encoding!r}, expected cdr, ros1, json or protobuf"


def _add_fields(
    found: dict[tuple[str, str], Channel], topic: str, shapes: Iterable[Any], kind: str, rows: int | None
) -> None:
    """Add the fields of a topic's messages to those that were found, or the names that they bring."""
    for shape in shapes:
        for path, columns in shape.fields():
            key = (topic, path)
            labels = tuple(dict.fromkeys([*(found[key].labels if key in found else ()), *columns.labels]))
            width = max(len(columns.indices), len(labels))
            found[key] = Channel(topic, path, width, labels, rows, kind, open_ended=True)


def _type_of(channel: Any, container: Container) -> str:
    schema = container.schemas.get(channel.schema_id)
    return str(schema.name if schema is not None else channel.message_encoding)


@contextmanager
def _bytes(source: Source) -> Iterator[tuple[Readable, int | None, Callable[[], int]]]:
    """Open the file; one that is compressed as a whole (`.mcap.zstd`) is decompressed while it is read.

    With it come its length where known, and what tells how many bytes of the file have been read.
    """
    with source.stream() as stream:
        if not source.head.startswith(ZSTD_MAGIC):
            yield stream, source.size, stream.tell
            return
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(stream, closefd=False) as reader:
            yield _Patient(reader, Budget(source.name, source.size)), None, stream.tell


class _Patient:
    """A decompressor whose reads return what was asked for, and nothing where the data are cut or damaged."""

    def __init__(self, reader: Any, budget: Budget) -> None:
        self._reader = reader
        self._budget = budget

    def read(self, count: int) -> bytes:
        import zstandard

        parts: list[bytes] = []
        while count > 0:
            try:
                part = self._reader.read(min(count, 1 << 24))
            except zstandard.ZstdError:
                break
            if not part:
                break
            self._budget.take(len(part))
            parts.append(part)
            count -= len(part)
        return b"".join(parts)


def _recognise(source: Source) -> bool:
    if source.head.startswith(MAGIC):
        return True
    if not source.head.startswith(ZSTD_MAGIC):
        return False
    with _bytes(source) as (stream, _, _):
        return bytes(stream.read(len(MAGIC))) == MAGIC


FORMAT = LogFormat(
    name="MCAP",
    suffixes=(".mcap",),
    recognise=_recognise,
    open=lambda source: [McapLog(source.name, [source])],
    write=write_mcap,
    lacks=("temperature", *COMMANDS),
    priority=10,
)
