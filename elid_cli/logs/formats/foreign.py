"""Logs of other recorders, told by content: one line that names the converter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.source import Source

KINDS: tuple[tuple[bytes, str, str], ...] = (
    (b"#ROSBAG V", "a ROS 1 bag", "mcap convert {name} out.mcap"),
    (b"ULog\x01\x12\x35", "a PX4 ULog", "ulog2csv {name}"),
    (b"BZh", "bzip2 data", "bunzip2 {name}"),
    (b"\xfd7zXZ\x00", "xz data", "unxz {name}"),
    (b"\x28\xb5\x2f\xfd", "zstd data that hold neither an MCAP file nor an SQLite bag", "unzstd {name}"),
)


def kind_of(head: bytes) -> tuple[str, str] | None:
    """Return (what it is, converter) for a known foreign head, else None."""
    if head.startswith(b"PK\x03\x04") and b"elid.npy" in head[:80]:
        return "a reduced log of elid reduce, which holds no samples", "elid identify and elid classify take it"
    return next(((what, how) for magic, what, how in KINDS if head.startswith(magic)), None)


def refuse(source: Source) -> NoReturn:
    """Raise the LogError that names the converter."""
    known = kind_of(source.head)
    assert known is not None
    what, how = known
    which = "" if "which" in what else ", which elid does not read"
    raise LogError(f"{source.name}: {what}{which}", hint=how.format(name=source.name))


def _open(source: Source) -> Sequence[RawLog]:
    refuse(source)


FORMAT = LogFormat(
    name="foreign",
    suffixes=(),
    recognise=lambda source: kind_of(source.head) is not None,
    open=_open,
    priority=50,
)
