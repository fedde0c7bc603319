"""Items 1, 2 and 12: MCAP files that are cut, corrupt, split, compressed as a whole, or lie about their sizes."""

from __future__ import annotations

import itertools
import os
import struct
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType

from elid_cli.signals.recording import Recording
from tests import peaks
from tests.logs.mcap_made import PLAIN
from tests.system.hostile.bags import changed, chunks, good, joint_states
from tests.system.hostile.hostile import ROBOT, SIGNALS, agrees, base, elid, one_message, refused, used

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "planar2.mcap"


def saved(folder: Path, data: bytes, name: str = "log.mcap") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.97])
def test_a_cut_file_is_used_and_the_loss_said(tmp_path: Path, share: float) -> None:
    log = saved(tmp_path, good()[: int(share * len(good()))])
    done = used(log, "without its footer", tolerance=0.02)
    assert "without its footer" in done.err
    assert done.json["log"]["samples"] > (share - 0.05) * base().samples
    refused(log, "without its footer", "--strict", more=("--strict",))


@pytest.mark.parametrize("size", [8, 9, 100, 2000])
def test_a_file_without_one_whole_chunk_is_refused(tmp_path: Path, size: int) -> None:
    refused(saved(tmp_path, good()[:size]), "no position", "without its footer")


def test_the_sample_cut_at_200_bytes_gives_every_whole_message() -> None:
    """Counts of every channel against the official reader, which walks the records."""
    from elid_cli.logs.mcap.container import Container, walk

    data = SAMPLE.read_bytes()
    ends, totals = _reference(data)
    rng = np.random.default_rng(7)
    for at in rng.integers(8, len(data), 200).tolist():
        wanted = totals[int(np.searchsorted(ends, at, side="right"))]
        found: dict[int, int] = {}
        for messages in walk(BytesIO(data[:at]), at, Container()):
            for channel, count in zip(*np.unique(messages.channels, return_counts=True), strict=True):
                found[int(channel)] = found.get(int(channel), 0) + int(count)
        assert found == wanted, at


def _reference(data: bytes) -> tuple[list[int], list[dict[int, int]]]:
    """Return where every record of the whole file ends, and the messages per channel up to there."""
    ends: list[int] = []
    totals: list[dict[int, int]] = [{}]
    stream = BytesIO(data)
    for record in StreamReader(stream, emit_chunks=True).records:
        now = dict(totals[-1])
        for message in breakup_chunk(record) if isinstance(record, Chunk) else [record]:
            if isinstance(message, Message):
                now[message.channel_id] = now.get(message.channel_id, 0) + 1
        ends.append(stream.tell())
        totals.append(now)
    return ends, totals


def test_the_sample_cut_anywhere_is_read_to_its_last_whole_sample(tmp_path: Path) -> None:
    from elid_cli.errors import LogError
    from elid_cli.logs import read_recording
    from elid_cli.robot.files import read_robot

    robot, data = read_robot(ROBOT), SAMPLE.read_bytes()
    whole = read_recording([SAMPLE], robot)
    ends, totals = _reference(data)
    for at in np.random.default_rng(8).integers(8, len(data), 12).tolist():
        rows = min(totals[int(np.searchsorted(ends, at, side="right"))].values(), default=0)
        log = saved(tmp_path, data[:at])
        try:
            got = read_recording([log], robot)
        except LogError:
            assert rows < 20
            continue
        assert rows - 1 <= got.samples <= rows + 1
        for signal in SIGNALS:
            assert np.array_equal(getattr(got, signal)[:rows], getattr(whole, signal)[: got.samples][:rows])


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_corrupt_chunk_is_a_gap(tmp_path: Path, compression: str) -> None:
    options = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
    data = joint_states(options={"compression": options[compression]})
    log = saved(tmp_path, changed(data, chunks(data)[5] + 500))
    done = used(log, "chunk 6", "damaged and left out", "1 gap", tolerance=0.01)
    assert done.json["log"]["segments"] == 2
    refused(log, "damaged", "--strict", more=("--strict",))


def test_nothing_but_corrupt_chunks_is_refused(tmp_path: Path) -> None:
    data = changed(good(), *(start + 300 for start in chunks(good())))
    refused(saved(tmp_path, data), "no position", "chunk 1", "damaged")


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4}, {"compression": CompressionType.NONE},
        {"use_chunking": False, **PLAIN}, PLAIN, {"use_chunking": False}, {"enable_crcs": False},
    ],
    ids=["lz4", "none", "no chunks or index", "no index or summary", "no chunks", "no checksums"],
)  # fmt: skip
def test_every_container_gives_the_same_numbers(tmp_path: Path, options: dict[str, Any]) -> None:
    done = used(saved(tmp_path, joint_states(options=options)), tolerance=1e-9)
    assert done.err == ""


def test_a_file_that_is_zstd_as_a_whole(tmp_path: Path) -> None:
    packed = zstandard.ZstdCompressor().compress(good())
    used(saved(tmp_path, packed, "log.mcap.zstd"), tolerance=1e-9)
    used(saved(tmp_path, packed[: len(packed) // 2], "log.mcap.zstd"), "without its footer", tolerance=0.02)
    bomb = zstandard.ZstdCompressor().compress(good()[:8] + bytes(300_000_000))
    assert len(bomb) < 100_000
    refused(saved(tmp_path, bomb, "log.mcap.zstd"), "no position")


def split(folder: Path, count: int = 11) -> Path:
    """Return a rosbag2 folder of the good log."""
    folder.mkdir()
    log = base()
    bounds = np.linspace(0, log.samples, count + 1).astype(int)
    for k, (start, stop) in enumerate(itertools.pairwise(bounds)):
        saved(folder, joint_states(part(log, slice(start, stop))), f"run_{k}.mcap")
    return folder


def part(log: Recording, rows: slice) -> Recording:
    return replace(log, t=log.t[rows], segments=(), **{signal: getattr(log, signal)[rows] for signal in SIGNALS})


def metadata(folder: Path, *names: str) -> None:
    listed = "".join(f"    - {name}\n" for name in names)
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:\n{listed}")


def test_rosbag2_folders_are_read_in_time_order(tmp_path: Path) -> None:
    bag = split(tmp_path / "bag")
    names = [f"run_{k}.mcap" for k in range(11)]
    assert used(bag, tolerance=1e-9).err == ""
    metadata(bag, *names)
    assert used(bag, tolerance=1e-9).err == ""
    metadata(bag, *names[3:], *names[:3])
    used(bag, tolerance=1e-9)
    metadata(bag, *names, *names)
    assert used(bag, tolerance=1e-9).json["log"]["samples"] == base().samples


LIST = "rosbag2_bagfile_information:\n  relative_file_paths:"
LAUGHS = "a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
METADATA = {
    "tag": "!!python/object/apply:os.system ['touch pwned']", "cycle": "a: &a [*a]", "open": "[", "binary": "\x00",
    "list": "- 1", "bomb": f"{LAUGHS}{LIST} [*a11, *a11]\n", "date": f"{LIST} []\nat: 2020-99-99\n",
    "number": f"{LIST} []\nat: 0x_\n", "text": f"{LIST} run\n", "deep": "[" * 5000,
}  # fmt: skip


@pytest.mark.parametrize("fault", METADATA)
def test_metadata_that_is_damaged_or_hostile_is_no_matter(tmp_path: Path, fault: str) -> None:
    bag = split(tmp_path / "bag", 2)
    (bag / "metadata.yaml").write_text(METADATA[fault])
    assert used(bag, tolerance=1e-9).err == ""
    assert not Path("pwned").exists()


def test_metadata_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    bag = split(tmp_path / "bag", 2)
    os.mkfifo(bag / "metadata.yaml")
    used(bag, tolerance=1e-9)


@pytest.mark.parametrize("fault", ["gone", "gone and listed", "empty", "garbage", "fifo", "loop", "dangling"])
def test_a_split_that_is_missing_or_broken_is_said(tmp_path: Path, fault: str) -> None:
    bag = split(tmp_path / "bag")
    if fault.endswith("listed"):
        metadata(bag, *(f"run_{k}.mcap" for k in range(11)))
    broken = bag / "run_5.mcap"
    broken.unlink()
    {
        "empty": lambda: broken.write_bytes(b""),
        "garbage": lambda: broken.write_bytes(b"garbage" * 100),
        "fifo": lambda: os.mkfifo(broken),
        "loop": lambda: broken.symlink_to(bag),
        "dangling": lambda: broken.symlink_to(tmp_path / "nowhere"),
    }.get(fault, lambda: None)()
    done = used(bag, "run_5.mcap", "1 gap", tolerance=0.01)
    assert done.json["log"]["segments"] == 2
    refused(bag, "run_5.mcap", "--strict", more=("--strict",))


@pytest.mark.parametrize(
    ("name", "head", "word"),
    [("run.bag", b"#ROSBAG V2.0\n", "mcap convert")],
)
def test_other_recorders_files_name_the_converter(tmp_path: Path, name: str, head: bytes, word: str) -> None:
    done = refused(saved(tmp_path, head + bytes(200), name), word, name)
    assert len(done.err.splitlines()) == 2


@pytest.mark.parametrize("size", [1 << 40, 1 << 60, (1 << 64) - 1])
@pytest.mark.parametrize("lie", ["uncompressed size", "records length", "record length", "message length"])
def test_sizes_that_lie_take_no_memory(tmp_path: Path, lie: str, size: int) -> None:
    plain = lie == "message length"
    options = {"compression": CompressionType.NONE if plain else CompressionType.ZSTD, "enable_crcs": False}
    data = bytearray(joint_states(options=options))
    start = chunks(bytes(data))[10]
    name = struct.unpack_from("<I", data, start + 9 + 28)[0]
    place = {
        "uncompressed size": start + 9 + 16,
        "records length": start + 9 + 32 + name,
        "record length": start + 1,
        "message length": start + 9 + 40 + name + 1,
    }[lie]
    data[place : place + 8] = struct.pack("<Q", size)
    before = peaks.begin()
    done = used(saved(tmp_path, bytes(data)), tolerance=0.02)
    assert done.json["log"]["repairs"]
    assert peaks.since() - before < 300


def test_message_counts_of_the_summary_that_lie_take_no_memory(tmp_path: Path) -> None:
    data = bytearray(good())
    position = 8
    while position + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == 11:  # statistics: message counts by channel at its end
            for place in range(position + 9 + 46, position + 9 + length, 10):
                data[place + 2 : place + 10] = struct.pack("<Q", 1 << 60)
        position += 9 + length
    agrees(used(saved(tmp_path, bytes(data)), tolerance=1e-9))
    one_message(elid("validate", saved(tmp_path, bytes(data[:5000])), "--robot", ROBOT), "no position")
