"""MCAP files of the good log, in every container, encoding and message type, to be broken by the tests."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from elid_cli.signals.recording import Recording
from tests.logs.mcap_made import HEADER, STAMP, Bag, joint_state
from tests.system.hostile.hostile import JOINTS, base

EPOCH = 1_700_000_000 * 10**9
ARRAYS = f"{HEADER}float64[] position\nfloat64[] velocity\nfloat64[] effort\nfloat64[] link\n{STAMP}"
NAMES = f"{HEADER}string[] names\nuint32 keys_version\n{STAMP}"
VALUES = f"{HEADER}float64[] values\nuint32 keys_version\n{STAMP}"
Row = Callable[[int, int], dict[str, Any]]


def stamps(log: Recording | None = None) -> Iterator[tuple[int, int]]:
    """Yield (row, ns since 1970)."""
    yield from enumerate((np.rint((log or base()).t * 1e9).astype(int) + EPOCH).tolist())


def header(stamp: int) -> dict[str, Any]:
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}


def joint_states(log: Recording | None = None, options: dict[str, Any] | None = None, **topic: Any) -> bytes:
    """Return the good log on /joint_states and /motor_states."""
    log = log or base()
    bag = Bag(**({"chunk_size": 30_000} | (options or {})))
    for name in ("/joint_states", "/motor_states"):
        bag.topic(name, **topic)
    for row, stamp in stamps(log):
        bag.add("/joint_states", stamp, joint_state(stamp, list(JOINTS), log.q[row]))
        bag.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), log.theta[row], effort=log.tau[row]))
    return bag.bytes()


@cache
def good() -> bytes:
    """Return the good log with zstd chunks of half a second."""
    return joint_states()


def one_topic(topic: str, schema: str, text: str, row: Row, **options: Any) -> bytes:
    """Return the good log as messages of one type."""
    bag = Bag()
    bag.topic(topic, schema, text, **options)
    for k, stamp in stamps():
        bag.add(topic, stamp, row(k, stamp))
    return bag.bytes()


def arrays(k: int, stamp: int) -> dict[str, Any]:
    """Return one row as a message of `ARRAYS`."""
    log = base()
    return {
        "header": header(stamp), "position": log.theta[k].tolist(), "velocity": [], "effort": log.tau[k].tolist(),
        "link": log.q[k].tolist(),
    }  # fmt: skip


def names_and_values(*, late: bool = False, change: int = 0, version: bool = True) -> bytes:
    """Return the good log as a pair of topics; with `change`, other names in another order from that row on."""
    log = base()
    bag = Bag()
    bag.topic("/arm/names", "pal_statistics_msgs/msg/StatisticsNames", NAMES)
    bag.topic("/arm/values", "pal_statistics_msgs/msg/StatisticsValues", VALUES)
    names = [f"{signal}.{joint}" for joint in JOINTS for signal in ("q", "theta", "tau")]
    order, count = list(range(6)), 1

    def announce(stamp: int) -> None:
        shown = ["load", *(names[k] for k in order)]
        bag.add("/arm/names", stamp, {"header": header(stamp), "names": shown, "keys_version": count * version})

    if not late:
        announce(EPOCH - 10)
    for row, stamp in stamps():
        if change and row == change:
            order, count = [3, 4, 5, 1, 0, 2], 2
            announce(stamp - 5)
        numbers = [log.q[row, 0], log.theta[row, 0], log.tau[row, 0], log.q[row, 1], log.theta[row, 1], log.tau[row, 1]]
        values = [0.5, *(float(numbers[k]) for k in order)]
        message = {"header": header(stamp), "values": values, "keys_version": count * version}
        bag.add("/arm/values", stamp, message)
    if late:
        announce(stamp + 10)
    return bag.bytes()


def chunks(data: bytes) -> list[int]:
    """Return the offsets of the chunk records."""
    starts, position = [], 8
    while position + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == 6:
            starts.append(position)
        position += 9 + length
    return starts


def changed(data: bytes, *places: int) -> bytes:
    """Return a file with some bytes changed."""
    out = bytearray(data)
    for place in places:
        out[place] ^= 0x55
    return bytes(out)
