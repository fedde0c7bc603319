"""CSV logs: one header row, any common separator, gzip; a fast path for clean files and a tolerant one for the rest."""

from __future__ import annotations

import codecs
import contextlib
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, did_you_mean
from elid_cli.logs.contract import Channel, LogFormat, Pick, RawLog, Stream
from elid_cli.logs.formats.csv_dialect import HEAD, Dialect, first_rows, sniff
from elid_cli.logs.formats.csv_text import parse_blocks, parse_columns, parted
from elid_cli.logs.formats.csv_times import PASSED, is_time_of_day, over_midnight
from elid_cli.logs.formats.long_form import LongLog, recognised
from elid_cli.logs.mapping.language import SIGNALS
from elid_cli.logs.mapping.long_table import LongTable
from elid_cli.logs.source import Source
from elid_cli.memory import column_of
from elid_cli.signals.recording import Recording

LARGEST = 4 << 30
"""Bytes of text after decompression that are still read."""
TIME_NAMES = ("t", "time", "t_s", "time_s", "Time", "timestamp", "stamp", "__time", "Timestamp", "time [s]", "t [s]")
"""Columns that may hold the time, in the order in which they are preferred; ``t`` is canonical."""
PLACES = (".{{joint}}", "_{{joint}}", "_{{i}}", "{{i}}", "({{i}})", "[{{i0}}]")
PATTERNS = tuple(f"{{signal}}{place}" for place in PLACES)
"""Column names tried in turn: canonical, MATLAB's writetable (no dots), numbered, of lists."""
FIELDS = {
    "q": ("/joint_states", "position"),
    "dq": ("/joint_states", "velocity"),
    "tau_link": ("/joint_states", "effort"),
    "theta": ("/motor_states", "position"),
    "dtheta": ("/motor_states", "velocity"),
    "tau": ("/motor_states", "effort"),
}
"""Topic and field of each signal in a log of joint states."""
PLOTJUGGLER = ("{}/{{joint}}/{}", "{}/{}.{{joint}}", "{}/{}/{{joint}}", "{}/{}[{{i0}}]", "{}/{}.{{i0}}", "{}/{}/{{i0}}")
"""How PlotJuggler and others write a field of a topic as columns."""
MOST_COLUMNS = 20_000
TIGHTEST = 50
"""Bytes of text per byte of gzip that are believed of a log …"""
SMALL = 128 << 20
"""… of more than this many bytes."""
SAMPLE = 1 << 20
"""Bytes by which the text is known."""
GZIP = b"\x1f\x8b"
CUT = "the gzip data end early: the log is cut"


class CsvLog:
    """One CSV text; columns are parsed when they are loaded."""

    def __init__(self, source: Source) -> None:
        self._name = source.name
        self._tell = source.tell
        self._source = source
        self._whole = True
        self._data = None if source.data is None and source.head[:2] != GZIP else self._unpacked()
        self._first = -1
        """Byte of the first row where the text can be parsed as it lies in the file, else -1."""
        head = self._data[:SAMPLE] if self._data is not None else source.read(SAMPLE)
        text = _plain(head)
        if text is None:
            self._dialect: Dialect = sniff(self._text, source.name)
        else:
            self._dialect = sniff(text, source.name)
            mark = 3 if head.startswith(codecs.BOM_UTF8) else 0
            self._first = mark + len(text[: self._dialect.first].encode("utf-8"))
        self._head = (self._text if text is None else text)[: self._dialect.first + HEAD]
        self._name_columns()
        if not self._whole:
            self.losses.append(CUT)
        if not self._dialect.named:
            self.notes.append("no header row: columns are named column1, column2, …")

    def _name_columns(self) -> None:
        """Tell channels, units and the column of the time by the names of the columns."""
        names = self._dialect.names
        if len(names) > MOST_COLUMNS:
            raise LogError(f"{self._name}: {len(names)} columns", detail=f"at most {MOST_COLUMNS} are read")
        self.channels: Sequence[Channel] = tuple(Channel(name, kind="column") for name in dict.fromkeys(names) if name)
        self.units = {name: unit for name, unit in zip(names, self._dialect.units, strict=False) if unit}
        self.losses: list[str] = []
        self.notes: list[str] = []
        self.timeless = True  # without a column for it there is none
        self._time = next((name for name in TIME_NAMES if name in names), "")

    def narrowed(self) -> RawLog:
        """Return the log in long form where its rows name their channels, else itself."""
        table = recognised(self._dialect, first_rows(self._head, self._dialect), self._time)
        return self if table is None else self.in_long_form(table)

    def in_long_form(self, table: LongTable) -> RawLog:
        """Return the log with one channel per name; LogError where a column is not there."""
        return LongLog(self._text, self._dialect, table, self._time, self._name, self.canonical, self.in_long_form)

    @property
    def canonical(self) -> Sequence[Mapping[str, Any]]:
        """Canonical column names, then the spellings of programs that cannot write them."""
        time = {"t": {"from": self._time}} if self._time else {}
        patterns = [{s: {"from": p.format(signal=s)} for s in SIGNALS} for p in PATTERNS]
        return [time | patterns[0], *patterns[1:], *_topics()]

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        """Parse the picked columns and their times; the columns of one signal lie side by side in one array."""
        groups: dict[str, dict[str, int]] = {}
        for pick in picks:
            places = groups.setdefault(f"of {pick.signal}", {})
            places.setdefault(pick.source, len(places))
            if pick.time:
                groups.setdefault(f"time {pick.time}", {pick.time: 0})
        for name in dict.fromkeys(name for places in groups.values() for name in places):
            if self._dialect.names.count(name) > 1:
                raise LogError(
                    f"{self._name}: column {name!r} appears {self._dialect.names.count(name)} times",
                    hint="rename or remove the copies, so that it is clear which is meant",
                )
            if name not in self._dialect.names:
                raise LogError(f"{self._name}: no column {name!r}", hint=did_you_mean(name, self._dialect.names))
        parsed, said = self._parsed([list(places) for places in groups.values()])
        self.losses.extend(text for text in said if text not in self.losses)
        tables = dict(zip(groups, parsed, strict=True))
        times = {
            name: self._clock(name, column_of(tables[f"time {name}"], 0)) for name in {p.time for p in picks if p.time}
        }
        return [
            Stream(tables[own][:, groups[own][pick.source], None], {"t": times[pick.time]} if pick.time else {})
            for pick in picks
            for own in (f"of {pick.signal}",)
        ]

    def _clock(self, name: str, stamps: Array) -> Array:
        """Return the stamps of a column; times of day go on over midnight, which is noted."""
        rows = first_rows(self._head, self._dialect)
        if not rows or not is_time_of_day(rows[0][self._dialect.names.index(name)]):
            return stamps
        stamps, passed = over_midnight(stamps)
        if passed and PASSED.format(name) not in self.notes:
            self.notes.append(PASSED.format(name))
        return stamps

    def _parsed(self, wanted: Sequence[Sequence[str]]) -> tuple[list[Array], list[str]]:
        """Return a table per group of wanted columns and what had to be said.

        Texts in UTF-8 are read block by block, others whole.
        """
        if self._first >= 0:
            data = self._data
            with self._source.stream() if data is None else BytesIO(data) as stream:
                stream.seek(self._first)
                size = (self._source.size if data is None else len(data)) - self._first
                with contextlib.suppress(ValueError):
                    return parse_blocks(stream, size, self._dialect, wanted, self._tell)
        text = self._text
        columns = [name for group in wanted for name in group]
        fresh = sniff(text, self._name)  # of the text as it was decoded: its rows may begin elsewhere
        dialect = replace(self._dialect, first=fresh.first, first_line=fresh.first_line)
        table, said = parse_columns(text, dialect, columns, self._name)
        return parted(table, wanted), said

    @property
    def _text(self) -> str:
        """The whole text."""
        return decode(self._unpacked() if self._data is None else self._data, self._name)

    def _unpacked(self) -> bytes:
        data, self._whole = unpack(self._source.read(), self._name)
        return data


def _plain(head: bytes) -> str | None:
    """Return the first lines of a text in UTF-8 with ordinary line ends; None where it is another text."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\r" in head.replace(b"\r\n", b"\n"):
        return None
    try:
        return (head[: head.rfind(b"\n") + 1] if len(head) == SAMPLE else head).decode("utf-8-sig")
    except UnicodeDecodeError:
        return None


def _topics() -> list[dict[str, dict[str, str]]]:
    return [{s: {"from": p.format(*where)} for s, where in FIELDS.items()} for p in PLOTJUGGLER]


def unpack(data: bytes, name: str) -> tuple[bytes, bool]:
    """Return the bytes, decompressed where they are gzip, and whether they are whole: a cut file gives what is left."""
    if not data.startswith(b"\x1f\x8b"):
        return data, True
    most = min(LARGEST, max(SMALL, TIGHTEST * len(data)))
    whole = True
    out = bytearray()
    rest = data
    while rest.startswith(b"\x1f\x8b"):
        inflate = zlib.decompressobj(wbits=31)
        try:
            out += inflate.decompress(rest, most - len(out))
        except zlib.error as error:
            hint = "copy or record it again; gzip -t tells whether a copy is whole"
            raise LogError(f"{name}: damaged gzip data", detail=str(error).lower(), hint=hint) from error
        if inflate.unconsumed_tail or len(out) >= most:
            raise LogError(
                f"{name}: more than {most >> 20} MiB of text in {len(data)} bytes of gzip",
                detail="refused before taking more memory",
                hint="if it is a log, unpack it first: gunzip",
            )
        whole = inflate.eof
        rest = inflate.unused_data
    return bytes(out), whole


def decode(data: bytes, name: str) -> str:
    """Return the text of a CSV file: UTF-8 (with or without BOM), UTF-16 with BOM, else Latin-1."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return _one_line_end(data.decode("utf-16", errors="replace"))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return _one_line_end(text)


def _one_line_end(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _recognise(source: Source) -> bool:
    if source.is_folder:
        return False
    head = source.head
    if head.startswith(b"\x1f\x8b"):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, 4096)
        except zlib.error:
            return False
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    if b"\x00" in head:
        return False
    return re.search(rb"[0-9]", head) is not None and not head.lstrip().startswith((b"%YAML", b"{", b"<"))


def _write(recording: Recording, name: str) -> bytes:
    import gzip

    columns: list[Array] = [recording.t[:, None]]
    names = ["t"]
    for signal in SIGNALS:
        values = recording.signal(signal)
        if values is None:
            continue
        for j, joint in enumerate(recording.joints):
            if not np.isnan(values[:, j]).all():
                names.append(f"{signal}.{joint}")
                columns.append(values[:, j : j + 1])
    table = np.hstack(columns)
    lines = [",".join(_quoted(column) for column in names)]
    lines.extend(",".join("" if x != x else repr(x) for x in row) for row in table.tolist())
    text = ("\n".join(lines) + "\n").encode()
    return gzip.compress(text, mtime=0) if name.lower().endswith(".gz") else text


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if re.search(r'[",;\s]', name) else name


FORMAT = LogFormat(
    name="CSV",
    suffixes=(".csv", ".csv.gz"),
    recognise=_recognise,
    open=lambda source: [CsvLog(source).narrowed()],
    write=_write,
    priority=90,
)
