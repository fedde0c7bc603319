"""MCAP files of every kind, written with the official packages."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from elid_cli.logs.mcap.write import joint_state_schema
from elid_cli.signals.recording import Recording
from tests.logs.made_logs import JOINTS, recording

HEADER = "std_msgs/Header header\n"
RULE = "=" * 80
STAMP = f"{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
STAMP += f"{RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
DYNAMIC = (
    f"{HEADER}string[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"
    f"{RULE}\nMSG: control_msgs/InterfaceValue\nstring[] interface_names\nfloat64[] values\n{STAMP}"
)
ROBOT_STATE = f"{HEADER}float64[3] q\nfloat64[3] theta\nfloat32[3] tau_j\nuint8 mode\nfloat64[16] o_t_ee\n{STAMP}"


def joint_state(
    stamp: int, names: list[str], position: Any, velocity: Any = (), effort: Any = (), frame: str = ""
) -> dict:
    """Return a JointState as a dictionary."""
    return {
        "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame},
        "name": names,
        "position": [float(x) for x in position],
        "velocity": [float(x) for x in velocity],
        "effort": [float(x) for x in effort],
    }


def encoder(schema: str, text: str) -> Any:
    """Return the official CDR encoder of a message type."""
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic(schema, text)[schema]
    return lambda message: encode(attributes(message))


def attributes(message: Any) -> Any:
    """Return dictionaries as objects: mcap-ros2-support before 0.6 takes `dict.values` for a field of that name."""
    if isinstance(message, dict):
        return SimpleNamespace(**{name: attributes(value) for name, value in message.items()})
    return [attributes(item) for item in message] if isinstance(message, list) else message


class Bag:
    """A writer of MCAP bytes: any compression, chunking, encoding and schema language."""

    def __init__(self, **options: Any) -> None:
        self.buffer = BytesIO()
        options.setdefault("compression", CompressionType.ZSTD)
        options.setdefault("chunk_size", 64 * 1024)
        self.writer = Writer(self.buffer, **options)
        self.writer.start(profile="ros2", library="test")
        self.channels: dict[str, tuple[int, Any]] = {}
        self.sequence = 0

    def topic(
        self,
        topic: str,
        schema: str = "sensor_msgs/msg/JointState",
        text: str | None = None,
        *,
        encoding: str = "cdr",
        language: str = "ros2msg",
        shown: str | None = None,
    ) -> None:
        """Declare a topic; `shown` is the schema text stored instead of the real one."""
        text = joint_state_schema().decode() if text is None else text
        stored = text if shown is None else shown
        identifier = self.writer.register_schema(schema, language, stored.encode())
        channel = self.writer.register_channel(topic, encoding, identifier)
        encode = (lambda message: json.dumps(message).encode()) if encoding == "json" else encoder(schema, text)
        self.channels[topic] = (channel, encode)

    def add(self, topic: str, logged: int, message: dict) -> None:
        """Add one message."""
        channel, encode = self.channels[topic]
        self.writer.add_message(channel, logged, encode(message), logged, self.sequence)
        self.sequence += 1

    def bytes(self) -> bytes:
        """Finish and return the file."""
        self.writer.finish()
        return self.buffer.getvalue()


def add_recording(
    bag: Bag, base: Recording, *, epoch: int = 1_700_000_000 * 10**9, delay: int = 0, header: bool = True
) -> Bag:
    """Add the good log on the canonical topics."""
    for row, t in enumerate(np.rint(base.t * 1e9).astype(int).tolist()):
        stamp = epoch + t
        shown = stamp if header else 0
        bag.add("/joint_states", stamp + delay, joint_state(shown, list(JOINTS), base.q[row]))
        motor = joint_state(shown, list(JOINTS), base.theta[row], effort=base.tau[row])
        bag.add("/motor_states", stamp + delay, motor)
    return bag


def canonical(path: Path, base: Recording | None = None, **options: Any) -> Path:
    """Write the good log with the official writer and the given options."""
    encoding = options.pop("encoding", "cdr")
    bag = Bag(**options)
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic, encoding=encoding)
    path.write_bytes(add_recording(bag, base if base is not None else recording(400)).bytes())
    return path


PLAIN = {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}
PLAIN |= {"repeat_channels": False, "repeat_schemas": False}
