"""Cut, corrupt and hostile files: what is whole is used and what was lost is said, or one clear error."""

from __future__ import annotations

import os
import struct
import tracemalloc
from io import BytesIO
from pathlib import Path

import h5py
import numpy as np
import pytest
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType

from elid_cli.errors import LogError
from elid_cli.logs.mcap.container import MAGIC, Container, walk
from tests.logs.faults import cut, flipped
from tests.logs.made_logs import JOINTS, SIGNALS, read, recording, same, written
from tests.logs.mcap_made import PLAIN, canonical

BASE = recording(600)


def save(folder: Path, data: bytes, name: str = "broken.mcap") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def refused(path: Path, *words: str, **options: object) -> LogError:
    with pytest.raises(LogError) as caught:
        read(path, **options)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.exit_code == 3
    return caught.value


def reference_counts(data: bytes) -> dict[int, int]:
    """Messages per channel in the whole records before a cut, by the official stream reader."""
    from mcap.records import Chunk, Message
    from mcap.stream_reader import breakup_chunk

    counts: dict[int, int] = {}
    try:
        for record in StreamReader(BytesIO(data), skip_magic=False, emit_chunks=True, validate_crcs=False).records:
            messages = breakup_chunk(record) if isinstance(record, Chunk) else [record]
            for message in messages:
                if isinstance(message, Message):
                    counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
    except Exception:
        pass
    return counts


def counts_of(data: bytes) -> dict[int, int]:
    counts: dict[int, int] = {}
    for messages in walk(BytesIO(data), len(data), Container()):
        for channel, count in zip(*np.unique(messages.channels, return_counts=True), strict=True):
            counts[int(channel)] = counts.get(int(channel), 0) + int(count)
    return counts


@pytest.mark.parametrize("options", [{"chunk_size": 4000}, {"use_chunking": False}], ids=["chunks", "no chunks"])
def test_a_file_cut_anywhere_gives_every_whole_record(tmp_path: Path, options: dict) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, **options).read_bytes()
    rng = np.random.default_rng(2)
    for at in rng.integers(len(MAGIC), len(data), 200):
        part = cut(data, int(at))
        assert counts_of(part) == reference_counts(part)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8])
def test_a_cut_file_is_used_and_the_loss_said(tmp_path: Path, share: float) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, chunk_size=4000).read_bytes()
    path = save(tmp_path, cut(data, int(share * len(data))))
    got = read(path)
    same(got, BASE)
    assert got.samples > (share - 0.15) * 600 * 0.5
    assert any("without its footer" in text for text in got.repairs)
    refused(path, "strict", strict=True)


def test_a_cut_summary_loses_nothing(tmp_path: Path) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, chunk_size=4000).read_bytes()
    got = read(save(tmp_path, data[:-20]), strict=True)
    same(got, BASE)
    assert got.samples == 600
    assert any("end of the file is cut" in text for text in got.notes)


def test_nothing_whole_is_refused(tmp_path: Path) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, chunk_size=1 << 22).read_bytes()
    refused(save(tmp_path, cut(data, 2000)))
    refused(save(tmp_path, MAGIC))


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_corrupt_chunk_is_a_gap(tmp_path: Path, compression: CompressionType) -> None:
    if compression is CompressionType.NONE:
        pytest.skip("covered by the others; the checksum tells")
    path = canonical(tmp_path / "log.mcap", BASE, chunk_size=8000, compression=compression)
    data = path.read_bytes()
    starts = chunk_starts(data)
    middle = starts[len(starts) // 2]
    got = read(save(tmp_path, flipped(data, middle + 400)))
    same(got, BASE)
    assert len(got.segments) == 2
    said = " | ".join(got.repairs)
    assert "is damaged and left out" in said
    assert "1 gap" in said
    refused(tmp_path / "broken.mcap", "damaged", strict=True)


def test_a_changed_number_is_found_by_the_checksum(tmp_path: Path) -> None:
    path = canonical(tmp_path / "log.mcap", BASE, chunk_size=8000, compression=CompressionType.NONE)
    data = path.read_bytes()
    starts = chunk_starts(data)
    got = read(save(tmp_path, flipped(data, starts[3] + 1000)))
    same(got, BASE)
    assert any("checksum" in text for text in got.repairs)


def chunk_starts(data: bytes) -> list[int]:
    """Offsets of the chunk records."""
    starts, position = [], len(MAGIC)
    while position + 9 <= len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == 6:
            starts.append(position)
        position += 9 + length
    return starts


@pytest.mark.parametrize("lie", ["uncompressed size", "records length", "record length", "message length"])
def test_sizes_that_lie_are_refused_before_memory_is_taken(tmp_path: Path, lie: str) -> None:
    compression = CompressionType.NONE if lie == "message length" else CompressionType.ZSTD
    path = canonical(tmp_path / "log.mcap", BASE, chunk_size=8000, compression=compression, enable_crcs=False)
    data = bytearray(path.read_bytes())
    start = chunk_starts(bytes(data))[2]
    name = struct.unpack_from("<I", data, start + 9 + 28)[0]
    place = {
        "uncompressed size": start + 9 + 16,
        "records length": start + 9 + 32 + name,
        "record length": start + 1,
        "message length": start + 9 + 40 + name + 1,
    }[lie]
    data[place : place + 8] = struct.pack("<Q", 1 << 60)
    tracemalloc.start()
    got = read(save(tmp_path, bytes(data)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    same(got, BASE)
    assert got.repairs
    assert peak < 100e6


def test_an_index_that_lies_is_not_trusted(tmp_path: Path) -> None:
    path = canonical(tmp_path / "log.mcap", BASE, chunk_size=8000)
    data = bytearray(path.read_bytes())
    position = len(MAGIC)
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == 7 and length > 6:
            data[position + 9 + 6 + 8 : position + 9 + 6 + 16] = struct.pack("<Q", 3)
        if opcode == 15:
            break
        position += 9 + length
    same(read(save(tmp_path, bytes(data))), BASE)
    assert read(tmp_path / "broken.mcap").samples == 600


def test_an_index_without_a_channel_loses_nothing(tmp_path: Path) -> None:
    path = canonical(tmp_path / "log.mcap", BASE, chunk_size=8000)
    data = path.read_bytes()
    kept, position, dropped = bytearray(data[: len(MAGIC)]), len(MAGIC), 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        record = data[position : position + 9 + length]
        position += 9 + length
        if opcode == 7 and struct.unpack_from("<H", record, 9)[0] == 2:
            dropped += 1
            continue
        kept += record
        if opcode == 15:
            break
    assert dropped
    got = read(save(tmp_path, bytes(kept)))
    same(got, BASE)
    assert got.samples == 600


def test_messages_that_do_not_follow_their_definition_are_counted(tmp_path: Path) -> None:
    from tests.logs.made_logs import JOINTS
    from tests.logs.mcap_made import Bag, joint_state

    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 10**18 + t
        if row == 200:
            channel, _ = bag.channels["/joint_states"]
            for bad in (b"", b"\x00\x01", b"\x00\x01\x00\x00" + b"\xff" * 40, b"\x07" * 100):
                bag.writer.add_message(channel, stamp, bad, stamp)
            continue
        bag.add("/joint_states", stamp, joint_state(stamp, list(JOINTS), BASE.q[row]))
        bag.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row]))
    got = read(save(tmp_path, bag.bytes()))
    same(got, BASE, 1e-6)
    assert any("4 messages of /joint_states cannot be decoded" in text for text in got.repairs)


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (b"SQLite format 3\x00" + bytes(100), "the database is damaged"),
        (b"#ROSBAG V2.0\n" + bytes(100), "mcap convert"),
        (b"PAR1" + bytes(100), "Parquet"),
        (b"\x28\xb5\x2f\xfd" + bytes(100), "zstd"),
        (bytes(range(256)), "not a log"),
        (bytes(5000), "zero bytes"),
    ],
)
def test_foreign_files_name_the_converter(tmp_path: Path, data: bytes, word: str) -> None:
    refused(save(tmp_path, data), word)


def test_folders_and_pipes(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "folder without MCAP")
    (tmp_path / "bag").mkdir()
    save(tmp_path / "bag", b"SQLite format 3\x00" + bytes(100), "bag_0.db3")
    refused(tmp_path / "bag", "the database is damaged")
    os.mkfifo(tmp_path / "pipe")
    refused(tmp_path / "pipe", "not a regular file")
    refused(tmp_path / "log.mcpa", "no such file")
    canonical(tmp_path / "log.mcap", BASE)
    assert "did you mean" in refused(tmp_path / "log.mcpa").hint


def test_a_file_without_chunks_or_index_that_is_cut(tmp_path: Path) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, use_chunking=False, **PLAIN).read_bytes()
    got = read(save(tmp_path, data[: len(data) // 2]))
    same(got, BASE)
    assert 280 <= got.samples <= 305


# HDF5


def hdf5(path: Path, **arrays: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return path


def test_a_truncated_hdf5_is_refused(tmp_path: Path) -> None:
    data = written(tmp_path, "log.h5").read_bytes()
    for share in (0.05, 0.3, 0.9):
        error = refused(save(tmp_path, data[: int(share * len(data))], "broken.h5"), "HDF5")
        assert error.hint


def test_matlab_files_are_transposed(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = BASE.t[None, :]
        for signal in SIGNALS:
            file[signal] = getattr(BASE, signal).T
            file[signal].attrs["MATLAB_class"] = np.bytes_(b"double")
        group = file.create_group("#refs#")
        group["a"] = np.zeros(3)
        file["cell"] = np.array([file["q"].ref, file["t"].ref], dtype=h5py.ref_dtype)
    head = bytearray(path.read_bytes())
    head[:19] = b"MATLAB 7.3 MAT-file"
    path.write_bytes(bytes(head))
    same(read(path), BASE)


def test_joint_names_reorder_columns(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    order = [1, 2, 0]
    for where in ("file", "dataset"):
        with h5py.File(path, "w") as file:
            file["t"] = BASE.t
            for signal in SIGNALS:
                file[signal] = getattr(BASE, signal)[:, order]
                if where == "dataset":
                    file[signal].attrs["joint_names"] = [JOINTS[j] for j in order]
            if where == "file":
                file.attrs["joint_names"] = [JOINTS[j] for j in order]
        same(read(path), BASE)


def test_one_dataset_per_joint_and_mapped_paths(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["clock/us"] = np.round(BASE.t * 1e6).astype(np.int64)
        for j, joint in enumerate(JOINTS):
            file[f"arm/{joint}/angle"] = np.degrees(BASE.q[:, j])
            file[f"motor/{j + 1}"] = BASE.theta[:, j].astype(np.float32)
        file["efforts"] = BASE.tau
    mapping = {
        "t": {"from": "/clock/us", "unit": "us"},
        "q": {"from": "/arm/{joint}/angle", "unit": "deg"},
        "theta": "/motor/{i}",
        "tau": "/efforts",
    }
    got = read(path, mapping=mapping)
    same(got, BASE, 1e-7)


def test_datasets_with_their_own_stamps(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "log.h5", t=BASE.t, theta=BASE.theta, tau=BASE.tau, tq=BASE.t[::2], q=BASE.q[::2])
    refused(path, "/q has 300 samples, /t has 600", "time:")
    got = read(path, mapping={"q": {"from": "/q", "time": "/tq"}})
    assert np.abs(got.q - BASE.q[: got.samples]).max() < 1e-9


def test_no_time_vector_needs_a_rate(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "log.h5", theta=BASE.theta, tau=BASE.tau, q=BASE.q)
    refused(path, "no time", "--rate")
    same(read(path, rate=1000.0), BASE)


@pytest.mark.parametrize("kind", ["huge", "external", "virtual", "link", "object", "reference"])
def test_hdf5_that_allocates_or_reaches_out_is_refused(tmp_path: Path, kind: str) -> None:
    path = hdf5(tmp_path / "log.h5", t=BASE.t, theta=BASE.theta, tau=BASE.tau)
    other = hdf5(tmp_path / "other.h5", q=BASE.q)
    with h5py.File(path, "a") as file:
        if kind == "huge":
            file.create_dataset("q", shape=(1 << 40, 3), dtype="f8", chunks=(1000, 3))
        elif kind == "external":
            (tmp_path / "raw").write_bytes(BASE.q.tobytes())
            file.create_dataset(
                "q", shape=BASE.q.shape, dtype="f8", external=[(str(tmp_path / "raw"), 0, BASE.q.nbytes)]
            )
        elif kind == "virtual":
            layout = h5py.VirtualLayout(shape=BASE.q.shape, dtype="f8")
            layout[:] = h5py.VirtualSource(str(other), "q", shape=BASE.q.shape)
            file.create_virtual_dataset("q", layout)
        elif kind == "link":
            file["q"] = h5py.ExternalLink(str(other), "q")
        elif kind == "object":
            file.create_dataset("q", data=np.array([b"x"] * 600, dtype=object), dtype=h5py.string_dtype())
        else:
            file.create_dataset("q", data=np.array([file["t"].ref] * 600, dtype=object), dtype=h5py.ref_dtype)
    tracemalloc.start()
    refused(path, "/q")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
