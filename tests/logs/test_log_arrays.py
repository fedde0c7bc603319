"""Arrays as NumPy, HDF5 and MATLAB before v7.3 write them: paths, budgets, damage, a sample rate asked for once."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs import read_recording
from tests import peaks
from tests.logs.made_logs import ROBOT, read, recording, same
from tests.logs.mcap_made import canonical
from tests.system.field_logs import old_matlab

BASE = recording(400)


@pytest.mark.parametrize("inside", ["", "run"])
def test_variables_and_fields_of_structures_are_read_exactly(tmp_path: Path, inside: str) -> None:
    path = old_matlab(tmp_path, BASE, inside)
    place = f"/{inside}/" if inside else "/"
    mapping = {signal: {"from": f"{place}{signal}"} for signal in ("t", "q", "theta", "tau")} if inside else None
    same(read_recording([path], ROBOT, mapping), BASE)


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data


def test_a_compressed_element_of_zeros_takes_no_memory(tmp_path: Path) -> None:
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    packer = zlib.compressobj(1)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(300)) + packer.flush()
    (path := tmp_path / "bomb.mat").write_bytes(header + element(15, packed))
    before = peaks.begin()
    with pytest.raises(LogError, match="more than 256 MiB"):
        read(path)
    assert peaks.since() - before < 100


def test_cut_and_changed_files_are_refused_in_one_error(tmp_path: Path) -> None:
    good = old_matlab(tmp_path, BASE).read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(40):
        data = bytearray(good[: int(rng.integers(130, len(good)))])
        data[int(rng.integers(128, len(data)))] ^= 1 << int(rng.integers(8))
        (path := tmp_path / "bad.mat").write_bytes(bytes(data))
        with pytest.raises(LogError):
            read(path)


def header_of(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


@pytest.mark.parametrize("shape", ["(1000000000, 9)", "(" + "2, " * 60 + ")", "(9,", "(-1, 9)"])
def test_a_header_that_lies_is_refused(tmp_path: Path, shape: str) -> None:
    (path := tmp_path / "a.npy").write_bytes(header_of(shape) + bytes(800))
    with pytest.raises(LogError):
        read(path)

    with zipfile.ZipFile(archive := tmp_path / "a.npz", "w") as file:
        file.writestr("q.npy", header_of(shape) + bytes(800))
    with pytest.raises(LogError):
        read(archive)


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    np.save(path := tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(LogError, match="the array holds Python objects"):
        read(path)


def test_an_array_without_names_and_time_is_asked_for_in_one_hint(tmp_path: Path) -> None:
    robot = ROBOT.stiffened(np.ones(ROBOT.n, dtype=bool))
    np.save(path := tmp_path / "a.npy", np.hstack([BASE.q, BASE.q, BASE.q, BASE.tau]))
    with pytest.raises(LogError) as caught:
        read_recording([path], robot)
    assert caught.value.hint.count("--map") == 2
    assert caught.value.hint.endswith("--rate 1000")
    assert "put its own sample rate" in caught.value.detail
    with pytest.raises(LogError) as caught:
        read_recording([path], robot, rate=250.0)
    assert "--rate" not in caught.value.hint


def test_a_name_that_is_no_array_is_no_archive(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, t=BASE.t)
    (path := tmp_path / "a.npz").write_bytes(buffer.getvalue()[:200])
    with pytest.raises(LogError):
        read(path)


def test_the_first_slash_of_a_path_may_be_left_out(tmp_path: Path) -> None:
    path, base = tmp_path / "log.h5", recording(400)
    with h5py.File(path, "w") as file:
        for name in ("q", "theta", "tau", "clock"):
            file[f"arr/{name}"] = base.t if name == "clock" else getattr(base, name)
    for slash in ("", "/"):
        mapping = {name: {"from": f"{slash}arr/{name}"} for name in ("q", "theta", "tau")}
        for more in ({"t": {"from": f"{slash}arr/clock"}}, {}):
            own = {} if more else {"time": f"{slash}arr/clock"}
            same(read(path, mapping={name: entry | own for name, entry in mapping.items()} | more), base)
    with pytest.raises(LogError, match="no position") as caught:
        read(path, mapping={"theta": {"from": "ar/theta"}, "t": {"from": "arr/clock"}})
    assert "the log has no 'ar/theta' (nearest: '/arr/theta')" in caught.value.detail


def test_a_topic_may_be_named_without_its_slash(tmp_path: Path) -> None:
    path = canonical(tmp_path / "log.mcap")
    same(read(path, mapping={"theta": {"from": "motor_states.position"}}), recording(400))
