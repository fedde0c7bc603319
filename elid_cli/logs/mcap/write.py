"""Write a recording as MCAP: JointState messages on /joint_states and /motor_states, Imu on /imu/JOINT; CDR, zstd."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.mcap.ros_schema import KNOWN
from elid_cli.signals.recording import LINK_SENSORS, Recording

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
CHUNK_SIZE = 1 << 20
RULE = "=" * 80
VECTORS = ("geometry_msgs/Quaternion", "geometry_msgs/Vector3")
IMU_START, FLOATS = 20, 37
"""Bytes before the numbers of an Imu without a frame's name, and how many numbers it has."""
ORIENTATION_KNOWN = 4
"""Of these the first of the orientation's covariance: -1 says that a quantity is not known."""
SENSED = {"gyroscope": slice(13, 16), "accelerometer": slice(25, 28)}
"""Angular velocity and linear acceleration, the covariance of each behind it."""


def joint_state_schema() -> bytes:
    """Return the ros2msg text of sensor_msgs/msg/JointState with all that it needs."""
    return _schema("sensor_msgs/JointState")


def _schema(name: str, *more: str) -> bytes:
    """Return the ros2msg text of a stamped message with the definitions that it needs."""
    needed = ("std_msgs/Header", "builtin_interfaces/Time", *more)
    return "".join([KNOWN[name], *(f"{RULE}\nMSG: {part}\n{KNOWN[part]}" for part in needed)]).encode()


def write_mcap(recording: Recording, name: str) -> bytes:
    """Return the bytes of a recording as MCAP; stamps are the recording's times in ns."""
    from mcap.writer import CompressionType, Writer

    stamps = np.rint(recording.t * 1e9).astype(np.int64)
    topics = [
        ("/joint_states", (recording.q, recording.dq, recording.tau_link)),
        ("/motor_states", (recording.theta, recording.dtheta, recording.tau)),
    ]
    buffer = BytesIO()
    writer = Writer(buffer, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="elid")
    schema = writer.register_schema(JOINT_STATE, "ros2msg", joint_state_schema())
    encoded = []
    for topic, signals in topics:
        messages = joint_states(stamps, recording.joints, signals)
        if messages:
            encoded.append((writer.register_channel(topic, "cdr", schema), messages))
    carried = {"gyroscope": recording.turning, "accelerometer": recording.accelerated}
    held = {**recording.gyro, **recording.accel}
    watched = np.flatnonzero(recording.turning | recording.accelerated).tolist()
    if watched:
        schema = writer.register_schema(IMU, "ros2msg", _schema("sensor_msgs/Imu", *VECTORS))
    for joint in watched:
        sensed = {
            kind: np.stack([held[axis][:, joint] for axis in LINK_SENSORS[kind]], axis=1)
            for kind, joints in carried.items()
            if joints[joint]
        }
        channel = writer.register_channel(f"/imu/{recording.joints[joint]}", "cdr", schema)
        encoded.append((channel, imus(stamps, sensed)))
    for row, stamp in enumerate(stamps.tolist()):
        for channel, messages in encoded:
            writer.add_message(channel, stamp, messages[row], stamp, row)
    writer.finish()  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def joint_states(
    stamps: NDArray[np.int64], joints: tuple[str, ...], signals: tuple[Array | None, Array | None, Array | None]
) -> list[bytes]:
    """Return one CDR JointState per stamp (ns); signals are position, velocity, effort, shape (N, n) or None.

    Joints without any value are left out of the names, signals without any value are empty arrays.
    """
    present = [values if values is not None and not np.isnan(values).all() else None for values in signals]
    held = [values for values in present if values is not None]
    if not held:
        return []
    chosen = [j for j in range(len(joints)) if any(not np.isnan(values[:, j]).all() for values in held)]
    template, offsets = _template([joints[j] for j in chosen], [values is not None for values in present])
    table = np.tile(np.frombuffer(template, np.uint8), (stamps.size, 1))
    table[:, 4:8].view("<i4")[:, 0] = stamps // 1_000_000_000
    table[:, 8:12].view("<u4")[:, 0] = stamps % 1_000_000_000
    for values, offset in zip(present, offsets, strict=True):
        if values is not None:
            table[:, offset : offset + 8 * len(chosen)].view("<f8")[:] = values[:, chosen]
    return [row.tobytes() for row in table]


def imus(stamps: NDArray[np.int64], sensed: Mapping[str, Array]) -> list[bytes]:
    """Return one CDR Imu per stamp (ns).

    `sensed` are angular velocities, rad/s, and specific forces, m/s², (N, 3) each, by what senses them; what is not
    there is not known, nor is the orientation.
    """
    numbers = np.zeros((stamps.size, FLOATS))
    numbers[:, ORIENTATION_KNOWN] = -1.0
    for kind, place in SENSED.items():
        if kind in sensed:
            numbers[:, place] = sensed[kind]
        else:
            numbers[:, place.stop] = -1.0
    table = np.zeros((stamps.size, IMU_START), np.uint8)
    table[:, 1] = 1
    table[:, 4:8].view("<i4")[:, 0] = stamps // 1_000_000_000
    table[:, 8:12].view("<u4")[:, 0] = stamps % 1_000_000_000
    table[:, 12] = 1  # the frame's name is empty: its length, and a zero
    return [head.tobytes() + row.tobytes() for head, row in zip(table, numbers.astype("<f8"), strict=True)]


def _template(names: list[str], present: list[bool]) -> tuple[bytes, list[int]]:
    """Return a message of zeros and the offsets of its three arrays."""
    out = bytearray(b"\x00\x01\x00\x00" + bytes(8))
    _string(out, "")
    _length(out, len(names))
    for name in names:
        _string(out, name)
    offsets = []
    for here in present:
        _length(out, len(names) if here else 0)
        if here:
            out += bytes(-(len(out) - 4) % 8)
        offsets.append(len(out))
        out += bytes(8 * len(names) if here else 0)
    return bytes(out), offsets


def _length(out: bytearray, count: int) -> None:
    out += bytes(-(len(out) - 4) % 4)
    out += struct.pack("<I", count)


def _string(out: bytearray, text: str) -> None:
    data = text.encode() + b"\x00"
    _length(out, len(data))
    out += data
