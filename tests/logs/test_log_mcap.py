"""MCAP: every container, encoding and schema gives the same numbers as the official decoder, bit for bit."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_ros2.decoder import DecoderFactory

from elid_cli.errors import LogError
from elid_cli.logs import read_recording
from elid_cli.logs.contract import Pick
from elid_cli.logs.formats.mcap import McapLog
from elid_cli.logs.mcap.ros_schema import KNOWN
from elid_cli.logs.source import open_source
from tests.logs.made_logs import JOINTS, ROBOT, like, read, recording, same
from tests.logs.mcap_made import (
    DYNAMIC,
    PLAIN,
    ROBOT_STATE,
    RULE,
    STAMP,
    Bag,
    add_recording,
    canonical,
    joint_state,
)

BASE = recording(400)
CONTAINERS = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "none": {"compression": CompressionType.NONE},
    "one chunk": {"chunk_size": 1 << 24},
    "small chunks": {"chunk_size": 500},
    "without chunks": {"use_chunking": False},
    "without index": PLAIN,
    "without chunks or index": {"use_chunking": False, **PLAIN},
    "json": {"encoding": "json"},
}


def load(path: Path, *wanted: tuple[str, str, tuple[int | str, ...]]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return values and log times of (topic, field, columns)."""
    source = open_source(path)
    log = McapLog(source.name, [source])
    streams = log.load([Pick(*pick) for pick in wanted])
    return [s.values for s in streams], [s.clocks["header stamp"] for s in streams]


@pytest.mark.parametrize("name", CONTAINERS)
def test_every_container_holds_the_same_log(tmp_path: Path, name: str) -> None:
    got = read(canonical(tmp_path / "log.mcap", BASE, **CONTAINERS[name]))
    same(got, BASE)
    assert got.samples == 400
    assert got.repairs == ()


def test_joint_orders_frames_and_lengths_may_change_at_any_message(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    bag = Bag(chunk_size=3000)
    bag.topic("/js")
    names = ["a", "b", "c", "d"]
    for k in range(300):
        order = list(rng.permutation(4)) if k % 7 == 0 else list(range(4))
        count = 2 if k % 11 == 0 else 4
        chosen = [names[j] for j in order[:count]]
        frame = "x" * int(rng.integers(0, 6)) if k % 3 == 0 else f"frame{k}"
        values = rng.standard_normal((3, count))
        velocity = values[1] if k % 5 else ()
        bag.add("/js", k * 1000, joint_state(k * 1000 + 5, chosen, values[0], velocity, values[2], frame))
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    columns = tuple(names)
    fields = ("position", "velocity", "effort")
    got, stamps = load(path, *(("/js", field, columns) for field in fields))
    with path.open("rb") as stream:
        decoded = [m[3] for m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    for field, values in zip(fields, got, strict=True):
        wanted = np.full((300, 4), np.nan)
        for row, message in enumerate(decoded):
            for name, value in zip(message.name, getattr(message, field), strict=False):
                wanted[row, names.index(name)] = value
        assert np.array_equal(values, wanted, equal_nan=True)
    assert stamps[0].tolist() == [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in decoded]


def test_dynamic_joint_states_by_interface_name(tmp_path: Path) -> None:
    bag = Bag()
    bag.topic("/dynamic", "control_msgs/msg/DynamicJointState", DYNAMIC)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        message = joint_state(t + 10**9, list(JOINTS), ())
        message["joint_names"] = list(reversed(JOINTS))
        message["interface_values"] = [
            {
                "interface_names": ["motor_position", "position", "torque"][: 3 if joint != "" else 2],
                "values": [BASE.theta[row, j], BASE.q[row, j], BASE.tau[row, j]],
            }
            for j, joint in reversed(list(enumerate(JOINTS)))
        ]
        bag.add("/dynamic", t, message)
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    mapping = {
        "q": {"from": "/dynamic", "field": "position"},
        "theta": {"from": "/dynamic", "field": "interface_values.motor_position"},
        "tau": "/dynamic.torque",
    }
    same(read(path, mapping=mapping), BASE)


def imu_bag(folder: Path, encoding: str, unknown: slice) -> Path:
    """Write a log whose messages on /imu say of some rows that accelerations, 1 to 3 m/s², are not measured."""
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    parts = [f"{RULE}\nMSG: {name}\n{KNOWN[name]}" for name in ("geometry_msgs/Quaternion", "geometry_msgs/Vector3")]
    bag.topic("/imu", "sensor_msgs/msg/Imu", "\n".join([KNOWN["sensor_msgs/Imu"], *parts, STAMP]), encoding=encoding)
    add_recording(bag, BASE)
    vector = {"x": 1.0, "y": 2.0, "z": 3.0}
    quantities = {"orientation": {**vector, "w": 0.0}, "angular_velocity": vector, "linear_acceleration": vector}
    known = {f"{name}_covariance": [0.0] * 9 for name in quantities}
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 1_700_000_000 * 10**9 + t
        message = {"header": joint_state(stamp, [], ())["header"], **quantities, **known}
        if row in range(400)[unknown]:
            message["linear_acceleration_covariance"] = [-1.0, *[0.0] * 8]
        bag.add("/imu", stamp, message)
    path = folder / "log.mcap"
    path.write_bytes(bag.bytes())
    return path


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_numbers_that_their_covariance_denies_are_left_out_and_said(tmp_path: Path, encoding: str) -> None:
    mapping = {f"gyro_{axis}": {"from": [None, "/imu", None]} for axis in "xyz"}
    mapping |= {f"accel_{axis}": {"from": [None, "/imu", None]} for axis in "xyz"}
    got = read(imu_bag(tmp_path, encoding, slice(None)), mapping=mapping)
    assert got.turning.tolist() == [False, True, False]
    assert not got.accelerated.any()
    assert got.notes == (
        "linear_acceleration of /imu is left out where its covariance says that it is not measured (-1)",
    )
    same(got, BASE)
    got = read(imu_bag(tmp_path, encoding, slice(0, 0)), mapping=mapping)
    assert (got.turning.tolist(), got.notes) == (got.accelerated.tolist(), ())
    assert np.all(got.accel["accel_z"][:, 1] == 3.0)


def test_covariances_deny_numbers_message_by_message(tmp_path: Path) -> None:
    fields = ("linear_acceleration.y", "angular_velocity.y", "linear_acceleration_covariance")
    path = imu_bag(tmp_path, "cdr", slice(100, 150))
    values, _ = load(path, *(("/imu", field, (0,)) for field in fields))
    assert np.array_equal(np.flatnonzero(np.isnan(values[0])), np.arange(100, 150))
    assert np.all(values[1] == 2.0)
    assert np.array_equal(np.flatnonzero(values[2]), np.arange(100, 150))


def test_custom_messages_by_dotted_path(tmp_path: Path) -> None:
    bag = Bag()
    bag.topic("/state", "arm_msgs/msg/RobotState", ROBOT_STATE)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        header = joint_state(t + 10**9, [], ())["header"]
        state = {"header": header, "mode": 1, "o_t_ee": [float(x) for x in range(16)]}
        state |= {"q": BASE.q[row].tolist(), "theta": BASE.theta[row].tolist(), "tau_j": BASE.tau[row].tolist()}
        bag.add("/state", t, state)
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path, mapping={"q": "/state.q", "theta": "/state.theta", "tau": "/state.tau_j"})
    same(got, BASE, signals=("q", "theta"))
    assert np.array_equal(got.tau, BASE.tau.astype(np.float32))
    assert any("no names" in note for note in got.notes)


@pytest.mark.parametrize(("language", "shown"), [("ros2idl", "module sensor_msgs { };"), ("", ""), ("ros2msg", "")])
def test_known_types_are_read_by_name_without_their_schema(tmp_path: Path, language: str, shown: str) -> None:
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, language=language, shown=shown)
    path = tmp_path / "log.mcap"
    path.write_bytes(add_recording(bag, BASE).bytes())
    same(read(path), BASE)


def test_other_types_are_named_with_what_was_expected(tmp_path: Path) -> None:
    bag = Bag()
    bag.topic("/joint_states", "arm_msgs/msg/Unknown", ROBOT_STATE, language="ros2idl", shown="module x {};")
    state = {"q": [0.0] * 3, "theta": [0.0] * 3, "tau_j": [0.0] * 3, "mode": 0, "o_t_ee": [0.0] * 16}
    bag.add("/joint_states", 1, {"header": joint_state(1, [], ())["header"], **state})
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    with pytest.raises(LogError) as caught:
        read(path)
    assert "arm_msgs/msg/Unknown" in str(caught.value)
    assert "ros2msg" in str(caught.value)


def test_zero_header_stamps_give_way_to_the_log_time(tmp_path: Path) -> None:
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    path = tmp_path / "log.mcap"
    path.write_bytes(add_recording(bag, BASE, header=False).bytes())
    got = read(path)
    same(got, BASE)
    assert any("log time" in note for note in got.notes)


def test_the_clock_can_be_chosen(tmp_path: Path) -> None:
    path = canonical(tmp_path / "log.mcap", BASE)
    same(read(path, time_source="log"), BASE)
    same(read(path, time_source="header"), BASE)


def test_several_publishers_may_share_a_topic(tmp_path: Path) -> None:
    bag = Bag(chunk_size=2000)
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = t + 10**9
        bag.add("/joint_states", t, joint_state(stamp, ["gripper"], [0.1 * row]))
        bag.add("/joint_states", t, joint_state(stamp, list(JOINTS[:2]), BASE.q[row, :2]))
        bag.add("/joint_states", t, joint_state(stamp, [JOINTS[2]], BASE.q[row, 2:]))
        bag.add("/motor_states", t, joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row]))
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    same(read(path), BASE)


def test_split_bags_are_one_log(tmp_path: Path) -> None:
    pieces = [(0, 150), (150, 290), (290, 400)]
    bag = tmp_path / "bag"
    bag.mkdir()
    names = []
    for k, (start, stop) in enumerate(pieces):
        part = recording(400)
        piece = Bag()
        for topic in ("/joint_states", "/motor_states"):
            piece.topic(topic)
        cut = like(part, **{name: getattr(part, name)[start:stop] for name in ("t", "q", "theta", "tau")})
        names.append(f"bag_{k + 9}.mcap")
        (bag / names[-1]).write_bytes(add_recording(piece, cut).bytes())
    for listed in (False, True):
        if listed:
            lines = "\n".join(f"    - {name}" for name in names)
            (bag / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:\n{lines}\n")
        got = read(bag)
        same(got, BASE)
        assert len(got.segments) == 1
        assert got.samples == 400


def test_logs_of_one_time_are_no_parts_of_a_bag(tmp_path: Path) -> None:
    """A copy beside a log, or a part of it, would count its samples again, and make errors too small."""
    bag = tmp_path / "bag"
    bag.mkdir()
    canonical(bag / "run.mcap", BASE)
    whole = (bag / "run.mcap").read_bytes()
    for name, data in (("copy.mcap", whole), ("cut.mcap", whole[: len(whole) // 2])):
        (bag / name).write_bytes(data)
        with pytest.raises(LogError, match=r"of the same time: they are not the parts of one") as caught:
            read(bag)
        assert caught.value.exit_code == 3
        assert f"bag: {name} and run.mcap have messages" in str(caught.value)
        assert "name the logs that you mean one by one" in caught.value.hint
        (bag / name).unlink()
    canonical(bag / "next.mcap", replace(BASE, t=BASE.t + BASE.t[-1] + BASE.dt))
    assert read(bag).samples == 2 * BASE.samples


def test_what_metadata_lists_is_one_bag_whatever_its_times_are(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("bag_0.mcap", "bag_1.mcap"):
        canonical(bag / name, BASE)
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_0.mcap\n    - bag_1.mcap\n"
    )
    assert read(bag).samples == 2 * BASE.samples
    (bag / "other.mcap").write_bytes((bag / "bag_0.mcap").read_bytes())
    with pytest.raises(LogError, match=r"other\.mcap"):
        read(bag)


def test_a_whole_file_in_zstd_is_read(tmp_path: Path) -> None:
    import zstandard

    path = canonical(tmp_path / "log.mcap", BASE)
    packed = tmp_path / "log.mcap.zstd"
    packed.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
    same(read(packed), BASE)


def test_a_bag_of_the_robot_with_other_names_lists_them(tmp_path: Path) -> None:
    from elid_cli.robot.robot import Joint, Robot

    robot = Robot("other", (Joint("axis1"), Joint("axis2"), Joint("axis3")))
    with pytest.raises(LogError) as caught:
        read_recording([canonical(tmp_path / "log.mcap", BASE)], robot)
    assert "shoulder elbow wrist" in str(caught.value)
    assert caught.value.exit_code == 3
    mapping = {
        s: {"from": topic, "joints": dict(zip(robot.joint_names, JOINTS, strict=True))}
        for s, topic in (("q", "/joint_states"), ("theta", "/motor_states"), ("tau", "/motor_states"))
    }
    same(read_recording([tmp_path / "log.mcap"], robot, mapping), BASE)
    assert ROBOT.joint_names == JOINTS


def test_stamps_may_be_a_field_of_the_message(tmp_path: Path) -> None:
    text = "uint64 stamp_us\nstring[] name\nfloat64[] position\nfloat64[] effort\n"
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, "arm_msgs/msg/Stamped", text)
    for row, t in enumerate(BASE.t.tolist()):
        rest = {"stamp_us": round(t * 1e6) + 10**15, "name": list(JOINTS)}
        logged = row * 3_000_000
        bag.add("/joint_states", logged, {**rest, "position": BASE.q[row].tolist(), "effort": []})
        position, effort = BASE.theta[row].tolist(), BASE.tau[row].tolist()
        bag.add("/motor_states", logged, {**rest, "position": position, "effort": effort})
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    for spec in ({"from": "stamp_us", "unit": "us"}, {"from": "/joint_states", "field": "stamp_us", "unit": "us"}):
        same(read(path, mapping={"t": spec}), BASE)
    assert read(path).dt == pytest.approx(0.003)


def varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def entry(number: int, value: int | str | bytes) -> bytes:
    """One field of a protobuf message."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def described(name: str, *fields: tuple[str, int, int, int, str]) -> bytes:
    """A DescriptorProto; fields are (name, number, label, type, type name)."""
    parts = [entry(1, name)]
    for field, number, label, kind, of in fields:
        parts.append(entry(2, entry(1, field) + entry(3, number) + entry(4, label) + entry(5, kind) + entry(6, of)))
    return b"".join(parts)


def test_protobuf_joint_states(tmp_path: Path) -> None:
    import struct

    stamp = described("Timestamp", ("seconds", 1, 1, 3, ""), ("nanos", 2, 1, 5, ""))
    packed = [(name, k, 3, 1, "") for k, name in enumerate(("position", "effort"), start=3)]
    state = described("JointState", ("timestamp", 1, 1, 11, ".arm.Timestamp"), ("name", 2, 3, 9, ""), *packed)
    schema = entry(1, entry(1, "arm.proto") + entry(2, "arm") + entry(4, stamp) + entry(4, state))
    bag = Bag()
    identifier = bag.writer.register_schema("arm.JointState", "protobuf", schema)
    channels = [
        bag.writer.register_channel(topic, "protobuf", identifier) for topic in ("/joint_states", "/motor_states")
    ]
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        when = t + 10**18
        head = entry(1, entry(1, when // 10**9) + entry(2, when % 10**9)) + b"".join(entry(2, name) for name in JOINTS)
        motor = entry(3, struct.pack("<3d", *BASE.theta[row])) + entry(4, struct.pack("<3d", *BASE.tau[row]))
        link = b"".join(varint(3 << 3 | 1) + struct.pack("<d", x) for x in BASE.q[row])  # not packed: as valid
        for channel, body in zip(channels, (link, motor), strict=True):
            bag.writer.add_message(channel, when + 7, head + body, when)
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    same(read(path), BASE)


ROS1_STATE = (
    "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    f"{RULE}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
)


def ros1(message: dict) -> bytes:
    """Return a JointState as ROS 1 writes it: little-endian, nothing aligned, strings without a zero at their end."""
    stamp, frame = message["header"]["stamp"], message["header"]["frame_id"].encode()
    packed = struct.pack("<IIII", 7, stamp["sec"], stamp["nanosec"], len(frame)) + frame
    packed += struct.pack("<I", len(message["name"]))
    packed += b"".join(struct.pack("<I", len(name)) + name.encode() for name in message["name"])
    for key in ("position", "velocity", "effort"):
        packed += struct.pack(f"<I{len(message[key])}d", len(message[key]), *message[key])
    return packed


def test_messages_of_ros_1_are_read(tmp_path: Path) -> None:
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, "sensor_msgs/JointState", shown=ROS1_STATE, encoding="ros1", language="ros1msg")
        bag.channels[topic] = (bag.channels[topic][0], ros1)
    path = tmp_path / "log.mcap"
    path.write_bytes(add_recording(bag, BASE).bytes())
    same(read(path), BASE)
    names = list(reversed(JOINTS))
    bag = Bag()
    bag.topic("/joint_states", "sensor_msgs/JointState", shown=ROS1_STATE, encoding="ros1", language="ros1msg")
    bag.channels["/joint_states"] = (
        bag.channels["/joint_states"][0],
        lambda m: ros1(m) + b"\0" * (m["position"][0] > 5),
    )
    for k in range(4):  # lengths of strings and values that shift what follows, and a message that is too long
        position = [float(10 * (k == 3)), 2.0, 3.0]
        bag.add("/joint_states", k + 1, joint_state(k + 1, names, position, effort=(1.0,) * (k % 2), frame="f" * k))
    path.write_bytes(bag.bytes())
    (values,), (stamps,) = load(path, ("/joint_states", "position", tuple(JOINTS)))
    np.testing.assert_array_equal(values[:3], [[3.0, 2.0, 0.0]] * 3)
    assert np.isnan(values[3]).all()
    np.testing.assert_array_equal(stamps[:3], [1, 2, 3])
