"""Stamps of messages that are decoded one by one, under the names that their makers give seconds and nanoseconds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs.mcap.flat_decode import Flat, flat_json, misstamped, stamp_of
from tests.logs.made_logs import JOINTS, read, recording, same
from tests.logs.mcap_made import Bag, joint_state

NAMES = [("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos")]


def flat(message: object) -> Flat:
    values = flat_json(json.dumps(message).encode())
    assert values is not None
    return values


@pytest.mark.parametrize("where", ["header.stamp", "stamp", "header.timestamp", "timestamp"])
@pytest.mark.parametrize(("whole", "part"), NAMES)
def test_seconds_and_nanoseconds_make_a_stamp(where: str, whole: str, part: str) -> None:
    message: object = {whole: 1_700_000_123, part: 456_789_012}
    for name in reversed(where.split(".")):
        message = {name: message}
    assert stamp_of(flat(message)) == 1_700_000_123_456_789_012


@pytest.mark.parametrize("whole", ["sec", "secs", "seconds"])
def test_seconds_alone_are_a_stamp(whole: str) -> None:
    """Protobuf leaves nanoseconds out where they are 0."""
    assert stamp_of(flat({"stamp": {whole: 17}})) == 17_000_000_000


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"sec": 17, "nanosec": 5},
        {"header": {"seq": 3}, "q": [0.1, 0.2]},
        {"stamp": {"nanosec": 5}},
        {"stamp": {"nanos": 5, "secs_": 17}},
        {"stamp": 17.5},
        {"stamp": {"sec": "17", "nanosec": 5}},
        {"stamp": {"sec": 1e11, "nanosec": 5}},
        {"stamp": {"sec": 9_300_000_000, "nanosec": 5}},
        {"stamp": {"sec": None, "nanosec": 5}},
    ],
)
def test_what_is_no_stamp_is_none(message: object) -> None:
    assert stamp_of(flat(message)) == 0


def test_a_pair_goes_before_seconds_alone() -> None:
    assert stamp_of(flat({"stamp": {"sec": 17, "seconds": 4, "nanos": 5}})) == 4_000_000_005


def test_the_header_goes_before_a_field_of_the_message() -> None:
    header = {"stamp": {"secs": 2, "nsecs": 7}}
    assert stamp_of(flat({"header": header, "timestamp": {"sec": 9, "nanosec": 1}})) == 2_000_000_007


@pytest.mark.parametrize("nanoseconds", [-1, -500_000_000, 1_000_000_000, 4_294_967_295, 1e300, None])
def test_impossible_nanoseconds_are_no_stamp(nanoseconds: float | None) -> None:
    message = flat({"header": {"stamp": {"sec": 17, "nanosec": nanoseconds}}})
    assert stamp_of(message) == 0
    assert misstamped(message)
    assert not misstamped(flat({"header": {"stamp": {"sec": 17, "nanosec": 999_999_999}}}))
    assert not misstamped(flat({}))


def test_a_fraction_of_a_second_is_not_cut_off() -> None:
    assert stamp_of(flat({"stamp": {"secs": 17.25}})) == 17_250_000_000


@pytest.mark.parametrize("encoding", ["json", "cdr"])
@pytest.mark.parametrize("every", [1, 50])
def test_messages_with_impossible_nanoseconds_are_told_and_take_their_log_time(
    tmp_path: Path, encoding: str, every: int
) -> None:
    """Nanoseconds of a second and more, of all messages or of some: seconds that they add would be wrong times."""
    base, bag = recording(300), Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, encoding=encoding)
    for row, t in enumerate(np.rint(base.t * 1e9).astype(int).tolist()):
        now = 1_700_000_000 * 10**9 + t
        for topic, position, effort in (("/joint_states", base.q, ()), ("/motor_states", base.theta, base.tau[row])):
            message = joint_state(now, list(JOINTS), position[row], effort=effort)
            if row % every == every - 1:
                message["header"]["stamp"]["nanosec"] = 3_000_000_000 + 7 * row
            bag.add(topic, now, message)
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path)
    same(got, base)
    count = 300 // every
    told = [line for line in got.repairs if "impossible nanoseconds" in line]
    assert [line.split()[0] for line in told] == [str(count)] * 2
    with pytest.raises(LogError, match="impossible nanoseconds"):
        read(path, strict=True)


@pytest.mark.parametrize(("whole", "part"), NAMES)
def test_a_log_is_sampled_at_its_stamps(tmp_path: Path, whole: str, part: str) -> None:
    """Messages that were written at another pace than they were stamped at."""
    base, bag = recording(300), Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, encoding="json")
    for row, t in enumerate(np.rint(base.t * 1e9).astype(int).tolist()):
        stamp = {whole: 1_700_000_000 + t // 10**9, part: t % 10**9}
        for topic, position, effort in (("/joint_states", base.q, ()), ("/motor_states", base.theta, base.tau[row])):
            message = joint_state(0, list(JOINTS), position[row], effort=effort)
            bag.add(topic, 3_000_000 * row, {**message, "header": {"stamp": stamp, "frame_id": ""}})
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path)
    assert got.dt == pytest.approx(0.001)
    same(got, base)
