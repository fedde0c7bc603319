"""HDF5 logs, MATLAB v7.3 files among them: datasets of numbers, whole or one per joint, at the root or per episode.

Only what lies in the file itself is followed: hard links, soft links and object references to arrays in it. Types whose
reading would run code, follow another file or allocate without bound are named and left alone.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from elid_cli._types import Array
from elid_cli.budget import MOST_AT_ONCE
from elid_cli.errors import LogError, first_of
from elid_cli.logs.contract import Channel, LogFormat, Pick, Stream
from elid_cli.logs.formats.hdf5_contents import LARGE, TIGHT, contents
from elid_cli.logs.mapping.language import GAINS, SIGNALS
from elid_cli.logs.mapping.nameless import FIRST, ROWS, is_time
from elid_cli.logs.source import Source
from elid_cli.memory import mapped_dataset
from elid_cli.signals.recording import Recording

MAGIC = b"\x89HDF\r\n\x1a\n"
TIME_NAMES = ("t", "time", "timestamp", "stamp")
EPISODE = re.compile(r"(episode|demo|traj|trajectory|run|trial)[_-]?\d+$", re.IGNORECASE)
MOST_NAMED = 8
"""Names that a sentence lists."""
DENSEST = 1100
"""Bytes in memory per byte in the file; deflate cannot pack numbers tighter."""


class Hdf5Log:
    """The datasets of a file, or of one episode in it."""

    def __init__(
        self,
        name: str,
        stream: IO[bytes] | None,
        datasets: Mapping[str, Any],
        labels: tuple[str, ...],
        path: Path | None = None,
        refused: Mapping[str, str] | None = None,
        tell: Callable[[float], None] | None = None,
        gains: Mapping[str, Array] | None = None,
    ) -> None:
        self.name = name
        self.timeless = True  # without a dataset for it there is none
        self._gains = gains or {}
        self._tell = tell
        self._path = path
        self._stream = stream  # kept open with the file object that h5py reads from
        self._datasets = datasets
        self._time = next((f"/{key}" for key in TIME_NAMES if f"/{key}" in datasets), "")
        self._rows = _length(datasets[self._time]) if self._time else None
        self.losses: list[str] = []
        self.notes: list[str] = []
        unread = [Channel(p, width=0, kind=kind) for p, kind in (refused or {}).items() if p not in self._gains]
        held = [self._channel(path, labels) for path in datasets]
        held += [Channel(f"{c.source}{FIRST}", rows=c.rows, kind="column") for c in self._timed(held)]
        width = max((len(labels), *(c.width for c in held if c.source in ("/q", "/theta", "/q_des"))))
        self._gains = {p: np.broadcast_to(v, width) if v.size == 1 and width else v for p, v in self._gains.items()}
        for place, values in self._gains.items():
            named = labels if len(labels) == values.size else ()
            held.append(Channel(place, width=values.size, labels=named, rows=1, kind="constant"))
        self.channels: Sequence[Channel] = (*held, *unread)
        self._labels = {channel.source: channel.labels for channel in self.channels}

    @property
    def canonical(self) -> Sequence[Mapping[str, Any]]:
        """``/t`` and one dataset per signal, or one per signal and joint."""
        time = {"t": {"from": self._time}} if self._time else {}
        whole = {signal: {"from": f"/{signal}"} for signal in SIGNALS}
        each = {signal: {"from": f"/{signal}/{{joint}}"} for signal in SIGNALS}
        numbered = {signal: {"from": f"/{signal}/{{i}}"} for signal in SIGNALS}
        dotted = {signal: {"from": f"/{signal}.{{joint}}"} for signal in SIGNALS}
        return [time | whole, each, numbered, dotted]

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        """Read every picked dataset once, whole: reading columns of row chunks one by one is far slower."""
        times: dict[str, Array] = {}
        whole: dict[str, Array] = {}
        streams = []
        last = {pick.source: k for k, pick in enumerate(picks)}
        for k, pick in enumerate(picks):
            if self._tell is not None:
                self._tell(k / len(picks))
            time = pick.time
            if time and time not in times:
                times[time] = self._read(time).reshape(-1)
            gain = self._gains.get(pick.source)
            if gain is not None:
                whole[pick.source] = np.tile(gain, (self._samples(), 1))
            held = self._datasets.get(pick.source.removesuffix(FIRST))
            samples = len(whole[pick.source]) if gain is not None else self._shape(held)[0]
            if time and times[time].size != samples:  # before memory is taken for them
                raise LogError(
                    f"{self.name}: {pick.source} has {samples} samples, {time} has {times[time].size}",
                    hint=f"name its time stamps in a mapping: {{from: {pick.source}, time: /path/to/stamps}}",
                )
            if pick.source not in whole:
                whole[pick.source] = self._read(pick.source)
            values = whole[pick.source]
            if last[pick.source] == k:
                del whole[pick.source]
            labels = self._labels[pick.source]
            columns = [labels.index(column) if isinstance(column, str) else column for column in pick.columns]
            if columns != list(range(values.shape[1])):
                values = values[:, columns]
            streams.append(Stream(values, {"t": times[time]} if time else {}))
        return streams

    def _samples(self) -> int:
        """Return how many samples a constant stands for: one for each of the log's."""
        return self._rows or max((self._shape(dataset)[0] for dataset in self._datasets.values()), default=0)

    def _channel(self, path: str, labels: tuple[str, ...]) -> Channel:
        dataset = self._datasets[path]
        rows, width = self._shape(dataset)
        own = _names(dataset.attrs.get("joint_names"))
        chosen = next((names for names in (own, labels) if len(names) == width and width > 1), ())
        unfit = own or labels
        if unfit and not chosen and width > 1 and path.rpartition("/")[2] in SIGNALS:
            names, values = (f"{n} {word}{'s' * (n > 1)}" for n, word in ((len(unfit), "name"), (width, "column")))
            said = f"joint_names holds {names} ({first_of(unfit, MOST_NAMED)}) and {path} {values}: not used"
            self.losses.append(said)
        if len(own) == 1 and width == 1:
            chosen = own
        return Channel(path, width=width, labels=chosen, rows=rows, kind=f"{dataset.dtype} dataset")

    def _timed(self, channels: Sequence[Channel]) -> Iterator[Channel]:
        """Yield the array without names, if it is the only one, whose first column is a time: nothing else is one."""
        wide = [c for c in channels if c.width > 1]
        if self._time or len(wide) != 1 or wide[0].labels or wide[0].source[1:] in SIGNALS:
            return
        dataset = self._datasets[wide[0].source]
        try:
            refuse_bomb(dataset, wide[0].source)
            first = dataset[0, :ROWS] if self._transposed(dataset) else dataset[:ROWS, 0]
        except (LogError, OSError, RuntimeError, ValueError):
            return  # its reader says what is wrong
        if is_time(np.asarray(first, dtype=float).reshape(-1)):
            yield wide[0]

    def _shape(self, dataset: Any) -> tuple[int, int]:
        """Return (samples, values per sample); MATLAB writes arrays transposed."""
        shape = dataset.shape
        if len(shape) <= 1 or 1 in shape:
            return math.prod(shape), 1
        return (shape[1], shape[0]) if self._transposed(dataset) else (shape[0], math.prod(shape[1:]))

    def _transposed(self, dataset: Any) -> bool:
        shape = dataset.shape
        if len(shape) != 2:
            return False
        if self._rows in shape:
            return bool(shape[0] != self._rows)
        return bool("MATLAB_class" in dataset.attrs and shape[0] < shape[1])

    def _read(self, path: str) -> Array:
        if path not in self._datasets and path.endswith(FIRST):
            return self._read(path.removesuffix(FIRST))[:, :1]
        dataset = self._datasets[path]
        refuse_bomb(dataset, f"{self.name}: {path}")
        rows, width = self._shape(dataset)
        mapped = None if self._transposed(dataset) else mapped_dataset(dataset, self._path)
        if mapped is not None:
            return mapped.reshape(rows, width)
        try:
            raw = dataset[()]
        except (OSError, RuntimeError, ValueError) as error:
            raise LogError(f"{self.name}: {path} is damaged", detail=_reason(error)) from error
        values = np.ascontiguousarray(raw.T if self._transposed(dataset) else raw, dtype=np.float64)
        return values.reshape(rows, width)


def refuse_bomb(dataset: Any, where: str) -> None:
    """Raise LogError where a dataset would take far more memory than the file has bytes for it, or lies outside."""
    size = dataset.size * dataset.dtype.itemsize
    stored = dataset.id.get_storage_size()
    if dataset.external or dataset.is_virtual:
        raise LogError(f"{where}: its data are in another file", hint="copy them into one file (h5repack)")
    dense = size > LARGE and size > TIGHT * stored
    if size > MOST_AT_ONCE or dense or size > DENSEST * stored + (1 << 20):
        raise LogError(
            f"{where}: declares {size:.3g} bytes of data but the file holds {stored}",
            detail="refused before reading it",
            hint="record or export the log again",
        )


def _open(source: Source) -> Sequence[Hdf5Log]:
    import h5py

    stream = source.stream() if source.data is not None else None
    try:
        file = h5py.File(stream if stream is not None else str(source.path), "r")
        datasets, refused = contents(file)
        labels = _names(file.attrs.get("joint_names"))
        gains = _gains(file, datasets, refused)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise LogError(
            f"{source.name}: HDF5 file is cut or damaged",
            detail=_reason(error),
            hint="close the recorder before copying the file; h5clear -s mends files that were not closed",
        ) from error
    if not any(f"/{name}" in datasets for name in TIME_NAMES):
        for path in (f"/{name}" for name in TIME_NAMES if f"/{name}" in refused):
            hint = f"store {path} as an array of numbers, in s"
            raise LogError(f"{source.name}: {path} is {refused[path]}", hint=hint)
    episodes: dict[str, dict[str, Any]] = {}
    for path, dataset in datasets.items():
        prefix, name = path.rsplit("/", 1)
        if name in TIME_NAMES + SIGNALS and EPISODE.search(prefix):
            episodes.setdefault(prefix, {})[f"/{name}"] = dataset
    if episodes and not any(f"/{name}" in datasets for name in SIGNALS):
        ordered = sorted(episodes, key=lambda text: [int(x) if x.isdigit() else x for x in re.split(r"(\d+)", text)])
        return [
            Hdf5Log(
                f"{source.name}{prefix}",
                stream,
                episodes[prefix],
                _names(file[prefix].attrs.get("joint_names")) or labels,
                source.path,
                tell=_share_of(source, number, len(ordered)),
                gains=_gains(file[prefix], episodes[prefix], refused) or gains,
            )
            for number, prefix in enumerate(ordered)
        ]
    return [Hdf5Log(source.name, stream, datasets, labels, source.path, refused, source.tell, gains)]


def in_memory(source: Source, arrays: Iterable[tuple[str, Any]]) -> Sequence[Hdf5Log]:
    """Return the arrays of numbers among those of another format, by path, as an HDF5 log in memory.

    Names of joints are an array of their own, ``joint_names``.
    """
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for path, array in arrays:
            if path == "joint_names":
                file.attrs[path] = [str(joint) for joint in array.ravel()]
            elif array.dtype.kind in "fiub":
                file[path] = array
    return _open(Source(source.name, data=buffer.getvalue(), listener=source.listener))


def _gains(group: Any, datasets: dict[str, Any], refused: dict[str, str]) -> dict[str, Array]:
    """Return gains that hold for a whole log, by path: attributes, or arrays of one value or one per joint.

    Why one is not read goes into `refused`.
    """
    found = {f"/{gain}": group.attrs[gain] for gain in GAINS if gain in group.attrs}
    longest = max((max(d.shape, default=0) for d in datasets.values()), default=0)
    for path in (f"/{gain}" for gain in GAINS):
        held = datasets.get(path)
        held = group.get(path[1:]) if held is None else held
        if path not in found and held is not None and getattr(held, "size", longest) < longest:
            found[path] = held[()]
            datasets.pop(path, None)
    gains = {}
    for path, value in found.items():
        try:
            gains[path] = np.atleast_1d(np.asarray(value, dtype=float)).ravel()
        except (TypeError, ValueError):
            refused[path] = f"{value!r}, which is no number"
    return gains


def _share_of(source: Source, number: int, count: int) -> Callable[[float], None]:
    return lambda share: source.tell((number + share) / count)


def _names(value: Any) -> tuple[str, ...]:
    if value is None:
        return ()
    items = np.atleast_1d(value).ravel().tolist()
    names = [item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item) for item in items]
    if len(names) == 1 and re.search(r"[,; ]", names[0]):
        names = [part for part in re.split(r"[,; ]+", names[0]) if part]
    return tuple(names)


def _length(dataset: Any) -> int:
    return math.prod(dataset.shape)


def _reason(error: Exception) -> str:
    return str(error).split("\n")[0][:120].lower()


def _recognise(source: Source) -> bool:
    return source.head.startswith(MAGIC) or source.head[512:520] == MAGIC


def _write(recording: Recording, name: str) -> bytes:
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("earliest", "v110"), track_order=False) as file:
        file.attrs["joint_names"] = np.array([joint.encode() for joint in recording.joints])
        file.create_dataset("t", data=recording.t, track_times=False)
        for signal in SIGNALS:
            values = recording.signal(signal)
            if values is not None and not np.isnan(values).all():
                file.create_dataset(signal, data=values, track_times=False)
    return buffer.getvalue()


FORMAT = LogFormat(
    name="HDF5",
    suffixes=(".h5", ".hdf5"),
    recognise=_recognise,
    open=_open,
    write=_write,
    priority=10,
)
