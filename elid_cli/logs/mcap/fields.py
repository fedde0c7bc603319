"""Decoded fields as a mapping asks for them; quantities that are not measured; topics of names and values.

`pal_statistics` and ros2_control's introspection write them: a message of names with a version, then messages of
values that carry the version of their names. Columns are taken by name, message by message.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import LogError
from elid_cli.logs.contract import Channel, Pick, Stream
from elid_cli.logs.mcap.cdr import NAME_FIELDS

VERSIONS = ("keys_version", "names_version", "version")
MOST_NAMES = 20_000
Texts = Mapping[str, Sequence[str]]
Scalars = Mapping[str, float]


def values_topic(topic: str, topics: Iterable[str]) -> str:
    """Return the topic whose values a topic names, or an empty text."""
    head, names, tail = topic.rpartition("names")
    sibling = f"{head}values{tail}"
    return sibling if names and sibling in set(topics) else ""


@dataclass
class NameTable:
    """The names of one values topic, by version and by the time from which they hold."""

    topic: str
    versions: dict[float, tuple[str, ...]] = field(default_factory=dict)
    since: list[tuple[int, tuple[str, ...]]] = field(default_factory=list)

    def take_up(self, texts: Texts, scalars: Scalars, logged: int) -> None:
        """Take up one message of names."""
        names = next((tuple(texts[key]) for key in NAME_FIELDS if texts.get(key)), ())
        if not names or len(names) > MOST_NAMES:
            return
        version = next((scalars[key] for key in VERSIONS if key in scalars), None)
        if version is not None:
            self.versions.setdefault(version, names)
        if (logged, names) not in self.since[-1:]:
            insort(self.since, (logged, names))

    @property
    def orders(self) -> tuple[tuple[str, ...], ...]:
        """Every different list of names."""
        return tuple(dict.fromkeys([*self.versions.values(), *(names for _, names in self.since)]))

    @property
    def names(self) -> tuple[str, ...]:
        """Every name, in the order in which they were met."""
        return tuple(dict.fromkeys(name for order in self.orders for name in order))

    def named(self, channels: Sequence[Channel]) -> list[Channel]:
        """Return the channels of the values topic with their names, and one channel per name."""
        found: list[Channel] = []
        widths = {len(order) for order in self.orders}
        for channel in channels:
            if channel.source != self.topic or channel.width not in widths or channel.labels or channel.width == 1:
                found.append(channel)
                continue
            found.append(Channel(channel.source, channel.field, channel.width, self.names, channel.rows, channel.kind))
            found += [Channel(channel.source, name, 1, (), channel.rows, channel.kind) for name in self.names]
        return found

    def asked(self, pick: Pick, fields: Sequence[str]) -> list[Pick]:
        """Return the picks to load for one of this topic: all values, and their version where there is one."""
        own = [name for name in fields if name not in VERSIONS and name not in self.names]
        array = pick.field if pick.field in own else next((f for f in ("values", "value", "data") if f in own), own[0])
        width = max(len(order) for order in self.orders)
        picks = [Pick(pick.source, array, tuple(range(width)), pick.time)]
        version = next((name for name in VERSIONS if name in fields), "")
        return [*picks, Pick(pick.source, version, (0,), pick.time)] if version and self.versions else picks

    def chosen(self, pick: Pick, loaded: Sequence[Stream], name: str) -> Stream:
        """Return the columns of a pick by name from the streams of `asked`."""
        values = loaded[0].values
        labels: list[int | str] = [pick.field] if pick.field in self.names else list(pick.columns)
        result = np.full((values.shape[0], len(labels)), np.nan)
        for rows, names in self._stretches(loaded):
            for k, label in enumerate(labels):
                column = self._column(label, names, name)
                if column is not None and column < values.shape[1]:
                    result[rows, k] = values[rows, column]
        return Stream(result, loaded[0].clocks)

    def _column(self, label: int | str, names: Sequence[str], log: str) -> int | None:
        if isinstance(label, str):
            return names.index(label) if label in names else None
        others = {order[label] for order in self.orders if label < len(order)}
        if len(others) > 1:
            raise LogError(
                f"{log}: column {label} of {self.topic} is not always the same: {', '.join(sorted(others)[:4])}",
                hint=f"map it by name: joints: {{joint1: {names[label] if label < len(names) else '…'}, …}}",
            )
        return label

    def _stretches(self, loaded: Sequence[Stream]) -> list[tuple[NDArray[np.bool_], tuple[str, ...]]]:
        """Return which rows have which names."""
        count = loaded[0].values.shape[0]
        if len(loaded) > 1 and len(set(self.versions.values())) == len(self.orders):
            version = loaded[1].values[:, 0]
            return [(version == key, names) for key, names in self.versions.items()]
        if len(self.orders) == 1:
            return [(np.ones(count, dtype=bool), self.orders[0])]
        logged = loaded[0].clocks["log time"]
        moments = np.array([moment for moment, _ in self.since])
        which = np.maximum(np.searchsorted(moments, logged, side="right") - 1, 0)
        return [(which == k, names) for k, (_, names) in enumerate(self.since)]


def covariances(picks: Sequence[Pick], channels: Sequence[Channel]) -> dict[int, Pick]:
    """Return picks of the first number of covariances, by the number of the pick whose quantity they are of.

    An Imu has room for quantities that its sensor does not measure: their covariance begins with -1.
    """
    held = {(channel.source, channel.field) for channel in channels}
    found = {}
    for number, pick in enumerate(picks):
        quantity = pick.field.rpartition(".")[0]
        if quantity and (pick.source, f"{quantity}_covariance") in held:
            found[number] = Pick(pick.source, f"{quantity}_covariance", (0,))
    return found


def without_unmeasured(
    picks: Sequence[Pick], streams: Sequence[Stream], told: Mapping[int, Pick], notes: list[str]
) -> list[Stream]:
    """Return the streams of picks, with NaN where a quantity is not measured; numbers that this leaves out are noted.

    `streams` are those of the picks, then those of their `covariances`, which are `told` by the picks' numbers.
    """
    kept = list(streams[: len(picks)])
    for number, variance in zip(told, streams[len(picks) :], strict=True):
        absent = variance.values == -1.0  # (N, 1)
        if not absent.any():
            continue
        values = kept[number].values
        kept[number] = Stream(np.where(absent, np.nan, values), kept[number].clocks)
        what = f"{picks[number].field.rpartition('.')[0]} of {picks[number].source}"
        said = f"{what} is left out where its covariance says that it is not measured (-1)"
        if said not in notes and np.any(absent & np.isfinite(values) & (values != 0)):
            notes.append(said)
    return kept


INTERFACES = "interface_names"


@dataclass(frozen=True)
class FieldColumns:
    """The numbers of one field: `indices` among those of `path`, and their labels where the message names them."""

    path: str
    indices: tuple[int, ...]
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class MessageShape:
    """Counts of numbers by path, and strings by path with the starts of their sequences."""

    widths: Mapping[str, int]
    strings: Mapping[str, Sequence[str]]
    starts: Mapping[str, Sequence[int]]

    def fields(self) -> Iterator[tuple[str, FieldColumns]]:
        """Yield every field that a mapping may name."""
        for path, width in self.widths.items():
            if width:
                yield path, FieldColumns(path, tuple(range(width)), self._labels(path, width))
        for interface in dict.fromkeys(self._interfaces()):
            found = self._interface(interface)
            if found is not None:
                yield interface, found

    def columns(self, field: str) -> FieldColumns | None:
        """Return the numbers of one field, or None where this message has none."""
        width = self.widths.get(field, 0)
        if width:
            return FieldColumns(field, tuple(range(width)), self._labels(field, width))
        return self._interface(field.removeprefix("interface_values."))

    def _labels(self, path: str, width: int) -> tuple[str, ...]:
        """Return the names beside a sequence of numbers, where there are as many."""
        prefix = path.rpartition(".")[0]
        while True:
            for name in NAME_FIELDS:
                names = self.strings.get(f"{prefix}.{name}" if prefix else name, ())
                if len(names) == width:
                    return tuple(names)
            if not prefix:
                return ()
            prefix = prefix.rpartition(".")[0]

    def _interfaces(self) -> Sequence[str]:
        path = next((path for path in self.strings if path.rpartition(".")[2] == INTERFACES), "")
        return self.strings.get(path, ())

    def _interface(self, interface: str) -> FieldColumns | None:
        """Return one interface of every joint of a DynamicJointState, whose values are named joint by joint."""
        path = next((path for path in self.strings if path.rpartition(".")[2] == INTERFACES), None)
        joints = self.strings.get("joint_names", ())
        if path is None or len(self.starts.get(path, ())) != len(joints):
            return None
        values = f"{path.rpartition('.')[0]}.values"
        names = self.strings[path]
        if self.widths.get(values, 0) != len(names):
            return None
        bounds = [*self.starts[path], len(names)]
        found = [
            (index, joint)
            for joint, start, stop in zip(joints, bounds, bounds[1:], strict=False)
            for index in range(start, stop)
            if names[index] == interface
        ]
        if not found:
            return None
        return FieldColumns(values, tuple(index for index, _ in found), tuple(joint for _, joint in found))
