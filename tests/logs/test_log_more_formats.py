"""SQLite bags, NumPy archives, Parquet tables, and logs packed in zip or gzip, made as their own tools make them."""

from __future__ import annotations

import gzip
import sqlite3
import zipfile
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard

from elid_cli.errors import LogError
from elid_cli.logs.formats import db3
from elid_cli.logs.inspect import inspect_log
from elid_cli.logs.mcap.container import Container, Messages
from elid_cli.logs.mcap.write import joint_state_schema
from elid_cli.logs.source import Source
from elid_cli.logs.writing import recognise
from tests.logs.made_logs import JOINTS, ROBOT, read, recording, same, written
from tests.logs.mcap_made import encoder, joint_state

BASE = recording(800)
KIND = "sensor_msgs/msg/JointState"


def database(path: Path, rows: slice = slice(None), packed: bool = False, definitions: bool = True) -> Path:
    """Write what `ros2 bag record -s sqlite3` writes; `packed`: with --compression-mode message."""
    encode = encoder(KIND, joint_state_schema().decode())
    squeeze = zstandard.ZstdCompressor().compress if packed else bytes
    with closing(sqlite3.connect(path)) as base, base:
        base.execute("CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)")
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        if definitions:
            base.execute(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT, "
                "encoded_message_definition TEXT, type_description_hash TEXT)"
            )
            text = joint_state_schema().decode()
            base.execute("INSERT INTO message_definitions VALUES(1, ?, 'ros2msg', ?, '')", (KIND, text))
        for k, topic in enumerate(("/joint_states", "/motor_states"), start=1):
            base.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (k, topic, KIND))
        for row in range(800)[rows]:
            stamp = 10**18 + round(BASE.t[row] * 1e9)
            link = joint_state(stamp, list(JOINTS), BASE.q[row])
            motor = joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row])
            for k, message in ((1, link), (2, motor)):
                made = (k, stamp, squeeze(encode(message)))
                base.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", made)
    return path


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("definitions", [False, True])
def test_a_sqlite_bag_is_read(tmp_path: Path, packed: bool, definitions: bool) -> None:
    path = database(tmp_path / "run.db3", packed=packed, definitions=definitions)
    same(read(path), BASE)
    assert inspect_log(path).missing == ()


def test_a_folder_of_sqlite_splits_is_one_log(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    database(folder / "bag_0.db3", slice(0, 400))
    whole = database(tmp_path / "rest.db3", slice(400, 800)).read_bytes()
    (folder / "bag_1.db3.zstd").write_bytes(zstandard.ZstdCompressor().compress(whole))
    names = "\n".join(f"    - {name}" for name in ("bag_0.db3", "bag_1.db3.zstd"))
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:\n{names}\n")
    same(read(folder), BASE)


def test_a_damaged_database_is_one_error(tmp_path: Path) -> None:
    path = database(tmp_path / "run.db3")
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(LogError):
        read(path)


@pytest.mark.parametrize("sized", [True, False])
def test_a_sqlite_bag_in_zstd_is_read_alone_and_through_a_pipe(tmp_path: Path, sized: bool) -> None:
    whole = database(tmp_path / "run.db3").read_bytes()
    packer = zstandard.ZstdCompressor().compressobj(size=len(whole) if sized else -1)
    data = packer.compress(whole) + packer.flush()
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(data)
    same(read(path), BASE)
    assert inspect_log(path).missing == ()
    piped = Source("-", data=data)
    (log,) = recognise(piped).open(piped)
    assert {channel.source for channel in log.channels} == {"/joint_states", "/motor_states"}


def test_zstd_of_unknown_size_keeps_within_the_budget(tmp_path: Path) -> None:
    packer = zstandard.ZstdCompressor().compressobj()
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(packer.compress(db3.SQLITE + bytes(300 << 20)) + packer.flush())
    with pytest.raises(LogError, match="more than 256 MiB in a file"):
        read(path)


def test_arrays_of_python_objects_are_called_so(tmp_path: Path) -> None:
    arrays = {s: getattr(BASE, s) for s in ("t", "q", "theta", "tau")}
    np.savez(tmp_path / "more.npz", more=np.array([{"a": 1}]), **arrays)
    log = read(tmp_path / "more.npz")
    same(log, BASE)
    assert "more holds Python objects: not read" in log.notes
    np.savez(tmp_path / "log.npz", **(arrays | {"q": BASE.q.astype(object)}))
    with pytest.raises(LogError, match=r"log.npz: q holds Python objects") as caught:
        read(tmp_path / "log.npz")
    assert "q=numpy.array(q.tolist())" in caught.value.hint
    np.save(tmp_path / "log.npy", BASE.q.astype(object))
    with pytest.raises(LogError, match=r"log.npy: the array holds Python objects"):
        read(tmp_path / "log.npy")


def wrong_types(path: Path, change: str) -> Path:
    with sqlite3.connect(database(path)) as base:
        base.executescript(change)
    base.close()
    return path


ROWS = "INSERT INTO messages (topic_id, timestamp, data) VALUES"


@pytest.mark.parametrize(
    "change",
    [
        f"{ROWS} (1, 1e300, x'00010000');",
        f"{ROWS} (1, 'soon', x'00010000');",
        f"{ROWS} (1, -5, x'00010000');",
        f"{ROWS} (1, 5, 'text');",
        "INSERT INTO topics VALUES (70000, '/x', 'a/msg/B', 'cdr');",
        "INSERT INTO topics VALUES (9, x'ff00', 5, NULL);",
        "INSERT INTO topics VALUES (9, '/x', NULL, 'cdr');",
    ],
)
def test_rows_of_a_database_of_other_types_are_left_out_and_said(tmp_path: Path, change: str) -> None:
    log = read(wrong_types(tmp_path / "log.db3", change))
    assert sum("1 rows are neither messages nor topics" in text for text in log.repairs) == 1
    sound = read(database(tmp_path / "sound.db3"))
    np.testing.assert_array_equal(log.q, sound.q)


def test_large_messages_beside_joint_states_are_not_held_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    largest, together = [0], db3._together

    def watched(rows: Sequence[tuple[int, int, bytes]], container: Container) -> Messages:
        largest.append(sum(len(data) for _, _, data in rows))
        return together(rows, container)

    monkeypatch.setattr(db3, "TOGETHER", 1 << 16)
    monkeypatch.setattr(db3, "_together", watched)
    images = "".join(f"{ROWS} (9, {k}, zeroblob(10000));" for k in range(1, 100))
    change = f"INSERT INTO topics VALUES (9, '/image', 'a/msg/B', 'cdr');{images}"
    read(wrong_types(tmp_path / "log.db3", change))
    assert (1 << 15) < max(largest) <= 1 << 16


def test_an_archive_of_numpy_is_read_like_hdf5(tmp_path: Path) -> None:
    order = [2, 0, 1]
    names = np.array(JOINTS)[order]
    arrays = {"q": BASE.q[:, order], "theta": BASE.theta[:, order], "tau": BASE.tau[:, order]}
    np.savez(tmp_path / "log.npz", t=BASE.t, joint_names=names, **arrays)
    same(read(tmp_path / "log.npz"), BASE)
    np.savez_compressed(tmp_path / "unnamed.npz", t=BASE.t, q=BASE.q, theta=BASE.theta, tau=BASE.tau)
    same(read(tmp_path / "unnamed.npz"), BASE)


def test_a_numpy_archive_that_would_run_code_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogError, match="t holds Python objects, which elid does not read"):
        read(tmp_path / "log.npz")


def test_parquet_is_read_as_csv_is(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = {"t": BASE.t}
    for signal in ("q", "theta", "tau"):
        columns |= {f"{signal}.{joint}": getattr(BASE, signal)[:, k] for k, joint in enumerate(JOINTS)}
    parquet.write_table(arrow.table(columns), tmp_path / "log.parquet")
    same(read(tmp_path / "log.parquet"), BASE)


def test_moments_numbers_and_gaps_of_parquet(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    epoch = 1_700_000_000_000_000
    stamps = epoch + np.round(BASE.t * 1e6).astype(np.int64)
    signals = {f"{s}.{j} [rad]": getattr(BASE, s)[:, k] for s in ("q", "theta") for k, j in enumerate(JOINTS)}
    signals |= {f"tau.{j}": BASE.tau[:, k].astype(np.float32) for k, j in enumerate(JOINTS)}
    moments = arrow.array(stamps).cast(arrow.timestamp("us"))
    text = arrow.array([str(moment) for moment in moments.to_pylist()])
    for kind, time in (("stamps", moments), ("text", text)):
        columns = {"t": time, "note": text, "list": [[1.0]] * BASE.t.size, **signals}
        path = tmp_path / f"{kind}.parquet"
        parquet.write_table(arrow.table(columns), path, row_group_size=300)
        found = read(path)
        np.testing.assert_allclose(found.q, BASE.q, atol=1e-6)
        np.testing.assert_allclose(found.tau, BASE.tau, rtol=1e-6, atol=1e-6)
        assert found.rate == pytest.approx(BASE.rate)
    gap = arrow.array([None if 10 <= k < 12 else x for k, x in enumerate(BASE.tau[:, 0].tolist())])
    columns[f"tau.{JOINTS[0]}"] = gap
    parquet.write_table(arrow.table(columns), path)
    assert any("2 of 800 values are not numbers" in said for said in read(path).repairs)


def test_a_changed_byte_of_parquet_is_seen_where_pages_have_checksums(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = {"t": BASE.t}
    for name in ("q", "theta", "tau"):
        columns |= {f"{name}.{joint}": getattr(BASE, name)[:, j] for j, joint in enumerate(JOINTS)}
    options = {"compression": "none", "use_dictionary": False, "write_page_checksum": True}
    parquet.write_table(arrow.table(columns), path := tmp_path / "log.parquet", **options)
    same(read(path), BASE)
    data = bytearray(path.read_bytes())
    at = data.index(np.float64(BASE.q[400, 1]).tobytes())
    data[at + 3] ^= 1  # a digit that no motion contradicts
    path.write_bytes(data)
    with pytest.raises(LogError, match="cut or damaged"):
        read(path)


def test_parquet_in_long_form(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    names = [f"{s}.{j}" for s in ("q", "theta", "tau") for j in JOINTS]
    values = np.array([getattr(BASE, s)[:, k] for s in ("q", "theta", "tau") for k in range(len(JOINTS))])
    columns = {"t": np.repeat(BASE.t, len(names)), "name": names * BASE.t.size, "value": values.T.ravel()}
    parquet.write_table(arrow.table(columns), tmp_path / "log.parquet")
    same(read(tmp_path / "log.parquet"), BASE)


@pytest.mark.parametrize("name", ["log.csv", "log.h5", "log.mcap"])
def test_a_log_packed_by_itself_is_read(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name, BASE)
    with zipfile.ZipFile(tmp_path / "log.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(path, f"folder/{name}")
    (tmp_path / f"{name}.gz").write_bytes(gzip.compress(path.read_bytes()))
    for packed in (tmp_path / "log.zip", tmp_path / f"{name}.gz"):
        same(read(packed, robot=ROBOT), BASE)


def test_a_zip_of_several_files_names_them(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.writestr("a.csv", "t\n1\n")
        archive.writestr("b.csv", "t\n1\n")
    with pytest.raises(LogError, match="a zip archive of 2 files") as caught:
        read(tmp_path / "log.zip")
    assert "a.csv, b.csv" in caught.value.detail
