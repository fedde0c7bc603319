"""Items 9 and 12: HDF5 and MATLAB files that are cut, transposed, full of references, or made to do harm."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests import peaks
from tests.system.hostile.hostile import JOINTS, SIGNALS, base, refused, used

Fill = Callable[[h5py.File], None]


def arrays(*without: str) -> dict[str, np.ndarray]:
    named = {"t": base().t, **{signal: getattr(base(), signal) for signal in SIGNALS}}
    return {name: values for name, values in named.items() if name not in without}


def made(folder: Path, fill: Fill, *without: str) -> Path:
    """Return the good log with something else in the place of some arrays."""
    path = folder / "log.h5"
    with h5py.File(path, "w") as file:
        for name, values in arrays(*without).items():
            file[name] = values
        fill(file)
    return path


def nothing(file: h5py.File) -> None:
    """Add nothing."""


@pytest.mark.parametrize("size", [10, 100, 600, 2000, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path: Path, size: float) -> None:
    path = made(tmp_path, nothing)
    data = path.read_bytes()
    path.write_bytes(data[: int(size if size > 1 else size * len(data))])
    refused(path, "cut or damaged", "h5clear")


@pytest.mark.parametrize("seed", range(12))
def test_a_corrupt_file_is_read_right_or_refused(tmp_path: Path, seed: int) -> None:
    from tests.system.hostile.hostile import ROBOT, agrees, elid, one_message

    path = made(tmp_path, nothing)
    data, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for place in rng.integers(0, 800, 6).tolist():  # its directory, not its numbers
        data[place] ^= int(rng.integers(1, 255))
    path.write_bytes(bytes(data))
    done = elid("identify", path, "--robot", ROBOT, "--json")
    if done.code == 0:
        agrees(done)
    else:
        assert done.code in (3, 4)
        one_message(done)


@pytest.mark.parametrize("marked", [True, False])
def test_matlab_files_are_transposed(tmp_path: Path, marked: bool) -> None:
    def fill(file: h5py.File) -> None:
        for name, values in arrays().items():
            file[name] = np.atleast_2d(values.T)
            if marked:
                file[name].attrs["MATLAB_class"] = np.bytes_("double")

    used(made(tmp_path, fill, *arrays()), tolerance=1e-9)


def test_cells_of_matlab_are_followed(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for name, values in arrays().items():
            inside = file.create_dataset(f"#refs#/{name}", data=np.atleast_2d(values.T))
            file.create_dataset(name, data=np.array([[inside.ref]], dtype=h5py.ref_dtype))

    used(made(tmp_path, fill, *arrays()), tolerance=1e-9)


def test_one_cell_per_joint_is_followed(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for name in SIGNALS:
            columns = [file.create_dataset(f"#refs#/{name}{k}", data=arrays()[name][:, k : k + 1].T) for k in (0, 1)]
            file.create_dataset(name, data=np.array([[c.ref for c in columns]], dtype=h5py.ref_dtype))

    used(made(tmp_path, fill, *SIGNALS), tolerance=1e-9)


def test_links_inside_the_file_are_followed(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["raw/positions"] = base().q
        file["q"] = h5py.SoftLink("/raw/positions")
        file["raw/again"] = file["/"]  # a cycle

    used(made(tmp_path, fill, "q"), tolerance=1e-9)


def test_episodes_are_segments(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for k in range(3):
            for name, values in arrays().items():
                file[f"data/demo_{k}/{name}"] = values[1000 * k : 1000 * (k + 1)]

    path = made(tmp_path, fill, *arrays())
    assert used(path).json["log"]["segments"] == 3
    with h5py.File(path, "a") as file:
        del file["data/demo_1/tau"]
    refused(path, "demo_1", "no torque")


def test_no_time_vector_needs_a_rate(tmp_path: Path) -> None:
    path = made(tmp_path, nothing, "t")
    refused(path, "no time", "--rate")
    used(path, "250 Hz as given", more=("--rate", "250"), tolerance=1e-9)
    for wrong in ("0", "-1", "nan", "inf", "fast"):
        refused(path, "--rate", code=2, more=("--rate", wrong))
    refused(path, "too fast", more=("--rate", "1e12"))


def text(file: h5py.File) -> None:
    file.create_dataset("q", data=["a"] * base().samples, dtype=h5py.string_dtype())


def pickled(file: h5py.File) -> None:
    file.create_dataset("q", data=np.void(b"cos\nsystem\n(S'touch pwned'\ntR."))


def ragged(file: h5py.File) -> None:
    file.create_dataset("q", (base().samples,), dtype=h5py.vlen_dtype(float))


def compound(file: h5py.File) -> None:
    file["q"] = np.zeros(base().samples, dtype=[("joint1", "f8"), ("joint2", "f8")])


def complex_numbers(file: h5py.File) -> None:
    file["q"] = base().q.astype(complex)


def references(file: h5py.File) -> None:
    group = file.create_group("somewhere")
    file.create_dataset("q", data=np.array([group.ref, group.ref], dtype=h5py.ref_dtype))


def regions(file: h5py.File) -> None:
    file["raw"] = base().q
    file.create_dataset("q", data=np.array([file["raw"].regionref[:10]], dtype=h5py.regionref_dtype))


def external(file: h5py.File) -> None:
    file.create_dataset("q", shape=base().q.shape, dtype="f8", external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def linked(file: h5py.File) -> None:
    file["q"] = h5py.ExternalLink("/etc/passwd", "/x")


def lost(file: h5py.File) -> None:
    file["q"] = h5py.SoftLink("/nowhere")


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(base().q.shape, "f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", shape=base().q.shape)
    file.create_virtual_dataset("q", layout)


def endless(file: h5py.File) -> None:
    file.create_dataset("q", shape=(1 << 40, 2), chunks=(1024, 2), dtype="f8", compression="gzip")


def bomb(file: h5py.File) -> None:
    file.create_dataset("q", data=np.zeros((10_000_000, 2)), chunks=(1_000_000, 2), compression="gzip")


def short(file: h5py.File) -> None:
    file["q"] = base().q[:-5]


def wide(file: h5py.File) -> None:
    file["q"] = np.hstack([base().q, base().q])


@pytest.mark.parametrize(
    ("fill", "word"),
    [
        (text, "text"), (pickled, "opaque"), (ragged, "variable length"), (compound, "compound"),
        (complex_numbers, "complex"), (references, "references"), (regions, "references"),
        (external, "another file"), (linked, "another file"), (lost, "/nowhere"), (virtual, "another file"),
        (endless, "declares 1.76e+13 bytes|1099511627776"), (bomb, "10000000 samples"), (short, "2995 samples"),
        (wide, "4 unnamed values"),
    ],
)  # fmt: skip
def test_what_is_no_array_of_the_log_is_refused_by_name(tmp_path: Path, fill: Fill, word: str) -> None:
    path = made(tmp_path, fill, "q")
    before = peaks.begin()
    done = refused(path, "/q")
    assert any(one in done.err for one in word.split("|")), done.err
    assert not os.path.exists("pwned")  # noqa: PTH110
    assert peaks.since() - before < 300


@pytest.mark.parametrize("name", ["t", "theta", "tau"])
def test_every_signal_is_refused_alike(tmp_path: Path, name: str) -> None:
    def fill(file: h5py.File) -> None:
        file.create_dataset(name, data=["a"] * 10, dtype=h5py.string_dtype())

    refused(made(tmp_path, fill, name), f"/{name}", "text")

    def endless_one(file: h5py.File) -> None:
        file.create_dataset(name, shape=(1 << 40,), chunks=(1024,), dtype="f8")

    refused(made(tmp_path, endless_one, name), f"/{name}")


def test_files_without_end_in_depth_or_breadth(tmp_path: Path) -> None:
    def deep(file: h5py.File) -> None:
        group: h5py.Group = file
        for _ in range(100):
            group = group.create_group("g")

    def broad(file: h5py.File) -> None:
        for k in range(20_500):
            file.create_group(f"x{k}")

    refused(made(tmp_path, deep, *arrays()), "no position", "no channels")
    refused(made(tmp_path, broad), "20000 entries")


def test_joint_names_of_the_file_order_the_columns(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        for name in SIGNALS:
            file[name] = arrays()[name][:, ::-1]
        file.attrs["joint_names"] = list(JOINTS[::-1])

    used(made(tmp_path, fill, *SIGNALS), tolerance=1e-9)

    def other(file: h5py.File) -> None:
        file.attrs["joint_names"] = ["a", "b"]

    refused(made(tmp_path, other), "a b", "none of them joint1 joint2")
