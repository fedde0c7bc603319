"""Few bytes that ask for much memory or time: one error that names the file, soon and in little memory."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sqlite3
import struct
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests import forked, peaks
from tests.logs.mcap_made import HEADER, RULE, STAMP, Bag
from tests.system.hostile.bags import joint_states

SOON = 10.0
"""s of processor time."""
ROOM = 6 << 30
"""Bytes of address space."""


def bounded(*arguments: object, stdin: bytes | None = None, memory: int = ROOM) -> subprocess.CompletedProcess[str]:
    """Run one command in a process of its own, which may use `SOON` and `memory`."""
    if stdin is None and memory == ROOM:
        # the system ends the process that uses more
        done = forked.run(
            [str(a) for a in arguments], limits={resource.RLIMIT_CPU: int(SOON), resource.RLIMIT_AS: ROOM}
        )
        assert done.returncode >= 0, done
        return done

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "elid_cli", *map(str, arguments)], input=stdin, capture_output=True, check=False,
        preexec_fn=limit, timeout=300,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime - before.ru_utime < SOON
    return subprocess.CompletedProcess(done.args, done.returncode, done.stdout.decode(), done.stderr.decode())


def clean(path: Path, *codes: int, robot: str = "planar2") -> None:
    """Assert that info and identify end in one error that names the file, or in a result."""
    for line in (("info", path), ("identify", path, "--robot", robot)):
        done = bounded(*line)
        assert done.returncode in (*codes, 0), (line, done)
        assert "Traceback" not in done.stderr
        assert max(map(len, done.stderr.splitlines()), default=0) < 5000
        if done.returncode:
            assert str(path) in done.stderr
            assert done.stderr.count("error: ") == 1


def nested(levels: int = 19, each: int = 3) -> bytes:
    """Return an MCAP whose message type holds types that hold types."""
    text = f"{HEADER}" + "".join(f"t/T0 f{k}\n" for k in range(each))
    for level in range(levels):
        inner = f"t/T{level + 1}" if level + 1 < levels else "float64"
        text += f"{RULE}\nMSG: t/T{level}\n" + "".join(f"{inner} f{k}\n" for k in range(each))
    text += STAMP
    bag = Bag()
    schema = bag.writer.register_schema("t/msg/T", "ros2msg", text.encode())
    channel = bag.writer.register_channel("/x", "cdr", schema)
    bag.writer.add_message(channel, 1, b"\x00\x01\x00\x00" + bytes(400), 1, 0)
    return bag.bytes()


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def with_chunk(compression: str, uncompressed: int, packed: bytes) -> bytes:
    """Return an MCAP of one chunk with a header of our own."""
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 1, uncompressed, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    head = record(1, struct.pack("<I", 0) * 2)
    return b"\x89MCAP0\r\n" + head + record(6, body) + record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"


def lz4_bomb() -> bytes:
    import lz4.frame

    return with_chunk("lz4", 100, lz4.frame.compress(bytes(1 << 28)))


def empty_records() -> bytes:
    import zstandard

    records = struct.pack("<BQ", 0x80, 0) * (100 << 20)
    return with_chunk("zstd", len(records), zstandard.compress(records))


def attachment() -> bytes:
    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    out = packer.compress(b"\x89MCAP0\r\n" + record(1, bytes(8)) + struct.pack("<BQ", 9, 1500 << 20))
    for _ in range(1500):
        out += packer.compress(bytes(1 << 20))
    return out + packer.flush()


def many_fields() -> bytes:
    messages = json.dumps({f"field{k}": float(k) for k in range(30_000)}).encode()
    bag = Bag()
    schema = bag.writer.register_schema("x", "jsonschema", b"{}")
    channel = bag.writer.register_channel("/x", "json", schema)
    for k in range(20):
        bag.writer.add_message(channel, k, messages, k, k)
    return bag.bytes()


def huge_integers() -> bytes:
    bag = Bag()
    channel = bag.writer.register_channel("/joint_states", "json", bag.writer.register_schema("x", "jsonschema", b"{}"))
    for k in range(50):
        bag.writer.add_message(channel, k, b'{"position": [1' + b"0" * 400 + b"]}", k, k)
    return bag.bytes()


def long_names() -> bytes:
    from tests.logs.mcap_made import joint_state

    bag = Bag()
    bag.topic("/joint_states")
    for k in range(30):
        bag.add("/joint_states", k * 10**6, joint_state(k * 10**6, ["j" * 100_000, "joint2"], [0.1, 0.2]))
    return bag.bytes()


MCAPS: dict[str, Callable[[], bytes]] = {
    "types in types": nested, "lz4 that lies": lz4_bomb, "empty records": empty_records, "attachment": attachment,
    "many fields": many_fields, "integers of 400 digits": huge_integers, "names of 100 kB": long_names,
}  # fmt: skip


@pytest.mark.parametrize("name", MCAPS)
def test_mcap(tmp_path: Path, name: str) -> None:
    data = MCAPS[name]()
    path = tmp_path / ("log.mcap.zstd" if name == "attachment" else "log.mcap")
    path.write_bytes(data)
    assert len(data) < 10 << 20
    clean(path, 2, 3)


def test_hdf5_of_sparse_width_and_many_datasets(tmp_path: Path) -> None:
    path = tmp_path / "sparse.h5"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(6000) * 1e-3
        file.create_dataset("q", shape=(6000, 1_000_000_000), dtype="f8", chunks=(1, 1024))
    clean(path, 2, 3)
    path = tmp_path / "many.h5"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(100) * 1e-3
        for k in range(15_000):
            file[f"x{k}"] = np.zeros(1)
    clean(path, 2, 3)


def test_hdf5_of_times(tmp_path: Path) -> None:
    path = tmp_path / "times.h5"
    log = np.arange(4000) * 1e-3
    with h5py.File(path, "w") as file:
        file["t"] = log
        kind = h5py.h5t.UNIX_D32LE.copy()
        h5py.h5d.create(file.id, b"when", kind, h5py.h5s.create_simple((4000,)))
    done = bounded("info", path)
    assert done.returncode == 0, done
    assert "that NumPy does not have" in done.stdout + done.stderr


@pytest.mark.parametrize("shape", [(90_000_000,), (1,) * 60, (2,) * 33], ids=str)
def test_npz(tmp_path: Path, shape: tuple[int, ...]) -> None:
    path = tmp_path / "log.npz"
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("elid.npy", "q.npy"):
            with archive.open(name, "w", force_zip64=True) as file:
                file.write(member.getvalue())
                for _ in range(8 if len(shape) > 1 else 720):
                    file.write(bytes(1_000_000) if len(shape) == 1 else b"\0")
    clean(path, 2, 3)


COUNTED = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
DATABASES = {
    "messages without end": f"DROP TABLE messages; CREATE VIEW messages AS {COUNTED} i AS id, 1 AS topic_id,"
    " i AS timestamp, zeroblob(100) AS data FROM n",
    "topics without end": f"DROP TABLE topics; CREATE VIEW topics AS {COUNTED} i AS id, '/x' AS name, 'y' AS type,"
    " 'cdr' AS serialization_format FROM n",
    "computed data": "ALTER TABLE messages ADD COLUMN data AS (zeroblob(900000000)); "
    f"INSERT INTO messages(topic_id, timestamp) {COUNTED} 1, i FROM n LIMIT 2000",
}


@pytest.mark.parametrize("name", DATABASES)
def test_sqlite(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.db3"
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        base.execute("INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER)")
        base.executescript(DATABASES[name])
        base.commit()
    clean(path, 2, 3)


@pytest.mark.parametrize(("megabytes", "said"), [(120, False), (257, True)])
def test_sqlite_with_a_large_message_of_another_topic(tmp_path: Path, megabytes: int, said: bool) -> None:
    """It is held twice at most, and one that is too long is left out without the others."""
    from dataclasses import replace

    from tests.system.field_logs import rosbag_sqlite
    from tests.system.hostile.hostile import base as good

    log = replace(good(), dq=np.gradient(good().q, good().dt, axis=0))
    path = rosbag_sqlite(tmp_path, log) / "run_0.db3"
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.execute("INSERT INTO topics VALUES(2, '/image', 'sensor_msgs/msg/Image', 'cdr')")
        stamp = 1_700_000_001 * 10**9
        base.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES(2, ?, zeroblob(?))", (stamp, megabytes << 20)
        )
        base.commit()
    status, printed, complaint, peak = peaks.of_command("identify", path, "--robot", "planar2")
    assert status == 0, complaint
    assert peak < 200 + (0 if said else 3 * megabytes)  # 100 are elid's own
    assert ("1 rows are neither messages" in printed + complaint) == said, complaint


def test_parquet_of_one_number(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "log.parquet"
    table = arrow.table({name: np.zeros(10_000_000) for name in ("t", "q.joint1", "theta.joint1", "tau.joint1")})
    parquet.write_table(table, path, compression="zstd")
    clean(path, 3)
    assert path.stat().st_size < 1 << 20


@pytest.mark.parametrize("kind", ["commas", "header", "no end", "gzip"])
def test_csv_of_one_line(tmp_path: Path, kind: str) -> None:
    import gzip

    path = tmp_path / ("log.csv.gz" if kind == "gzip" else "log.csv")
    good = b"t,q.joint1\n" + b"".join(b"%.3f,1\n" % (k * 1e-3) for k in range(100))
    if kind == "commas":
        path.write_bytes(good + b"," * (200 << 20) + b"\n" + good)
    elif kind == "header":
        path.write_bytes(b"a," * (50 << 20) + b"\n" + good)
    elif kind == "gzip":
        path.write_bytes(gzip.compress(b"1," * (200 << 20)))
    else:
        path.write_bytes(b"1" * (100 << 20))
    clean(path, 3)


def test_standard_input_without_end() -> None:
    yes = subprocess.Popen(["yes", "1,2,3"], stdout=subprocess.PIPE)
    done = subprocess.run(
        [sys.executable, "-m", "elid_cli", "identify", "-", "--robot", "planar2"], stdin=yes.stdout,
        capture_output=True, check=False, timeout=120, text=True,
    )  # fmt: skip
    yes.kill()
    yes.wait()
    assert yes.stdout is not None
    yes.stdout.close()
    assert done.returncode == 3, done
    assert "standard input: more than 1024 MiB" in done.stderr


def urdf(joints: int, axis: str = "0 0 1") -> str:
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
        for k in range(joints + 1)
    )
    chain = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="{axis}"/>'
        '<origin xyz="0.1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        for k in range(joints)
    )
    return f'<robot name="r">{links}{chain}</robot>'


@pytest.mark.parametrize(("joints", "axis"), [(100, "0 0 1"), (200, "0 0 1"), (300, "0 0 1"), (2, "0 0 1e200")])
def test_urdf(tmp_path: Path, joints: int, axis: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(joints, axis))
    done = bounded("classify", "--robot", path)
    assert done.returncode == 2, done
    assert done.stderr.startswith("error: ")
    assert "joints" in done.stderr or "no quantity" in done.stderr


@pytest.mark.parametrize(
    ("joints", "nested", "said"),
    [
        (60, True, ""),
        (61, True, "61 joints"),
        (201, True, "200 joints"),
        (201, False, "200 joints"),
        (999, True, "250"),
    ],
)
def test_mjcf(tmp_path: Path, joints: int, nested: bool, said: str) -> None:
    path = tmp_path / "arm.xml"
    end = "</body>"
    bodies = [
        f'<body pos="0.1 0 0"><joint name="j{k}"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        + ("" if nested else end)
        for k in range(joints)
    ]
    tail = end * joints if nested else ""
    path.write_text(f"<mujoco><worldbody>{''.join(bodies)}{tail}</worldbody></mujoco>")
    done = bounded("classify", "--robot", path)
    assert done.returncode == (2 if said else 0), done
    assert said in done.stderr
    assert not said or done.stderr.startswith(f"error: {path}")


YAML = """
name: arm
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {{name: a, a: 0.5, alpha: 0, d: 0, theta: 0, gear_ratio: {gear}, parameters: {{m: 1, K: {K}, Jm: 1e-3}},
     limits: {{velocity: {velocity}, acceleration: {acceleration}}}}}
effects:
{effects}
"""
PLAIN = {"gear": "10", "K": "1e3", "velocity": "1", "acceleration": "10", "effects": "  []"}
STRIBECK = "  - {effect: stribeck, joint: a, parameters: {amplitude: %s, velocity: %s}}"


@pytest.mark.parametrize(
    "change",
    [
        {"K": "1e300"}, {"velocity": "1e-300"}, {"acceleration": "1e300"}, {"gear": "1e-300"}, {"gear": "1e200"},
        {"effects": STRIBECK % ("1e300", "0.1")}, {"effects": STRIBECK % ("1", "1e-300")},
        {"effects": "\n".join([STRIBECK % ("1", "0.1")] * 1000)},
        {"effects": "\n".join([STRIBECK % ("1", "0.1")] * 21)},
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("verb", ["simulate", "excite", "classify"])
def test_robots_without_quantities(tmp_path: Path, change: dict[str, str], verb: str) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(YAML.format(**(PLAIN | change)))
    more = [] if verb == "classify" else ["-o", tmp_path / "out.csv", "--duration", "2"]
    done = bounded(verb, "--robot", path, *more)
    assert done.returncode == 2, done
    assert done.stderr.count("error: ") == 1
    assert "arm.yaml:" in done.stderr


@pytest.mark.parametrize("megabytes", [120, 220, 319])
def test_little_address_space(tmp_path: Path, megabytes: int) -> None:
    """NumPy's library ends the process there, and SciPy's waits for memory for ever: one error instead, at once."""
    path = tmp_path / "log.mcap"
    path.write_bytes(joint_states())
    for line in (("identify", path, "--robot", "planar2"), ("info", path)):
        done = bounded(*line, memory=megabytes << 20)
        assert (done.returncode, done.stdout) == (3, "")
        assert done.stderr.startswith(f"error: not enough memory\n  {megabytes} MiB of address space (ulimit -v); ")
    assert bounded("--version", memory=megabytes << 20).returncode == 0


def test_enough_address_space(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(joint_states())
    begin = time.monotonic()
    done = bounded("identify", path, "--robot", "planar2", memory=400 << 20)
    assert time.monotonic() - begin < 60
    assert done.returncode == 0, done
    assert "K1" in done.stdout


def test_tiny_efforts_are_none(tmp_path: Path) -> None:
    from tests.system.hostile.test_csv_files import table

    path = tmp_path / "log.csv"
    path.write_text(table().with_column("tau.joint1", lambda v: v * 1e-160).text())
    done = bounded("identify", path, "--robot", "planar2")
    assert done.returncode == 0, done
    assert "tau of joint1 is zero throughout" in done.stderr


@pytest.mark.parametrize("value", ["1" + "0" * 400, "1e999", "NaN", '"x"', "[1]", "true"])
@pytest.mark.parametrize("key", ["estimate", "std_error"])
def test_saved_results_with_numbers_that_are_none(tmp_path: Path, value: str, key: str) -> None:
    """Never treated as a parameter that was refused: file and key are named."""
    from tests.system.hostile.hostile import elid, one_message

    entry = '{"name": "%s", "terms": {"%s": 1}, "unit": "kg", "estimate": %s, "std_error": %s}'
    text = '{"schema": "elid/1", "command": "identify", "base_parameters": [%s, %s], "covariance": [[1, 0], [0, 1]]}'
    first = entry % ("m1", "m1", 1.0, 0.1)
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    good.write_text(text % (first, entry % ("m2", "m2", 1, 1)))
    numbers = {"estimate": "1", "std_error": "1"} | {key: value}
    bad.write_text(text % (first, entry % ("m2", "m2", numbers["estimate"], numbers["std_error"])))
    for line in (("compare", good, bad), ("compare", bad, good), ("trend", good, good, good, bad), ("sample", bad)):
        done = elid(*line)
        assert done.code == 2, (line, done)
        assert done.out == ""
        one_message(done, f"{bad}: base_parameters[1].{key} cannot be used: ")
    done = elid("excite", "--robot", "planar2", "--after", bad, "-o", tmp_path / "x.csv")
    assert done.code == 2, done


def test_saved_results_with_a_negative_standard_error(tmp_path: Path) -> None:
    from tests.system.hostile.hostile import elid, one_message

    (path := tmp_path / "a.json").write_text(
        '{"schema": "elid/1", "base_parameters": [{"name": "m1", "estimate": 1, "std_error": -0.1, "unit": "kg"}]}'
    )
    done = elid("compare", path, path)
    assert done.code == 2, done
    one_message(done, f"{path}: base_parameters[0].std_error cannot be used: -0.1")


def test_a_zip_archive_whose_directory_is_before_its_beginning(tmp_path: Path) -> None:
    import io
    import zipfile

    from tests.system.hostile.hostile import refused

    with zipfile.ZipFile(held := io.BytesIO(), "w") as archive:
        archive.writestr("log.csv", "t,q.joint1\n0,0\n")
    data = bytearray(held.getvalue())
    end = data.rindex(b"PK\x05\x06")
    entry = data.index(b"PK\x01\x02")
    data[end + 16 : end + 20] = (entry + 2).to_bytes(4, "little")  # so the archive would begin 2 bytes before the file
    data[entry + 42 : entry + 46] = bytes(4)
    (path := tmp_path / "a.zip").write_bytes(bytes(data))
    refused(path, str(path))
