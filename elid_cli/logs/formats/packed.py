"""A log packed by itself: a zip archive of one log, or gzip of one that is no text."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence

from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats.csv import unpack
from elid_cli.logs.formats.npz import ZIP, is_npz
from elid_cli.logs.source import Source

GZIP = b"\x1f\x8b"
ENCRYPTED = 1
"""Bit of a member's flags in a zip archive."""
FAULTS = (zipfile.BadZipFile, ValueError, zlib.error, RuntimeError, NotImplementedError, EOFError)
"""What unpacking a damaged archive raises."""


def _open(source: Source) -> Sequence[RawLog]:
    from elid_cli.logs.writing import recognise

    data = _unzipped(source) if source.head.startswith(ZIP) else unpack(source.read(), source.name)[0]
    inner = Source(source.name, data=data, listener=source.listener)
    if inner.head.startswith((ZIP, GZIP)) and not is_npz(inner.head):
        raise LogError(f"{source.name}: packed twice", hint="unpack it first")
    return recognise(inner).open(inner)


def _unzipped(source: Source) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(source.read())) as archive:
            held = [m for m in archive.infolist() if not m.is_dir() and "__MACOSX" not in m.filename]
            if len(held) != 1:
                names = ", ".join(member.filename for member in held[:6])
                raise LogError(
                    f"{source.name}: a zip archive of {len(held)} files, not of one log", detail=names,
                    hint="unpack it, and name the log",
                )  # fmt: skip
            if held[0].flag_bits & ENCRYPTED:
                raise LogError(
                    f"{source.name}: the zip archive is encrypted", detail=held[0].filename, hint="unpack it first"
                )
            Budget(source.name, source.size).take(held[0].file_size)
            return archive.read(held[0])
    except FAULTS as error:
        raise LogError(f"{source.name}: damaged zip archive", detail=str(error).lower()[:120]) from error


def _recognise(source: Source) -> bool:
    head = source.head
    if head.startswith(GZIP):
        try:
            return b"\x00" in zlib.decompressobj(wbits=31).decompress(head, 512)
        except zlib.error:
            return False
    return head.startswith(ZIP) and not is_npz(head) and b"elid.npy" not in head[:80]


FORMAT = LogFormat(name="packed", suffixes=(), recognise=_recognise, open=_open, priority=30)
