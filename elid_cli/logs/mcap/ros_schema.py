"""ROS message definitions as text: which fields a message has, in order."""

from __future__ import annotations

import re
from dataclasses import dataclass

PRIMITIVES: dict[str, str] = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""Primitive types -> numpy's names of them."""

TIME = "builtin_interfaces/Time"

UNITREE_IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
UNITREE_MOTOR = "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
UNITREE_COMMAND = "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\n"
KNOWN: dict[str, str] = {
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    ),
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "control_msgs/DynamicJointState": (
        "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"
    ),
    "control_msgs/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
    "std_msgs/Float64": "float64 data\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    TIME: "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
    # of unitree_ros2, whose robots record bags that hold no definitions (ROS 2 Foxy and Humble)
    "unitree_go/LowState": (
        "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n"
        "IMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\nint16[4] foot_force\n"
        "int16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n"
        "int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\nuint16[4] fan_frequency\n"
        "uint32 reserve\nuint32 crc\n"
    ),
    "unitree_go/LowCmd": (
        "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n"
        "MotorCmd[20] motor_cmd\nBmsCmd bms_cmd\nuint8[40] wireless_remote\nuint8[12] led\nuint8[2] fan\nuint8 gpio\n"
        "uint32 reserve\nuint32 crc\n"
    ),
    "unitree_go/IMUState": f"{UNITREE_IMU}int8 temperature\n",
    "unitree_go/MotorState": (
        f"{UNITREE_MOTOR}float32 q_raw\nfloat32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\n"
        "uint32[2] reserve\n"
    ),
    "unitree_go/MotorCmd": f"{UNITREE_COMMAND}uint32[3] reserve\n",
    "unitree_go/BmsState": (
        "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\nuint16 cycle\nint8[2] bq_ntc\n"
        "int8[2] mcu_ntc\nuint16[15] cell_vol\n"
    ),
    "unitree_go/BmsCmd": "uint8 off\nuint8[3] reserve\n",
    "unitree_hg/LowState": (
        "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\n"
        "MotorState[35] motor_state\nuint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc\n"
    ),
    "unitree_hg/LowCmd": "uint8 mode_pr\nuint8 mode_machine\nMotorCmd[35] motor_cmd\nuint32[4] reserve\nuint32 crc\n",
    "unitree_hg/IMUState": f"{UNITREE_IMU}int16 temperature\n",
    "unitree_hg/MotorState": (
        f"{UNITREE_MOTOR}int16[2] temperature\nfloat32 vol\nuint32[2] sensor\nuint32 motorstate\nuint32[4] reserve\n"
    ),
    "unitree_hg/MotorCmd": f"{UNITREE_COMMAND}uint32 reserve\n",
}
"""Types known by name, for logs whose schemas are empty or in another language (ros2idl).

A message of another length than its definition says is not decoded, so one of another version is refused.
"""

MOST_DEFINITIONS = 500
MOST_FIELDS = 2000


@dataclass(frozen=True)
class Field:
    """One field: a primitive, ``string`` or another message; `count` None: one value, 0: a sequence, else an array."""

    name: str
    type: str
    count: int | None = None


Definitions = dict[str, tuple[Field, ...]]
"""Message type (``package/Name``) -> its fields."""


def short_name(type_name: str) -> str:
    """Return ``package/Name`` of ``package/msg/Name`` (or of ``package::msg::dds_::Name_``)."""
    parts = [part for part in type_name.replace("::", "/").split("/") if part]
    name = parts[-1].removesuffix("_") if "dds_" in parts else parts[-1] if parts else ""
    return f"{parts[0]}/{name}" if len(parts) > 1 else name


def definitions_of(type_name: str, text: str) -> Definitions | None:
    """Return the definitions that a message type needs, or None where they are neither in `text` nor known."""
    main = short_name(type_name)
    found: Definitions = {}
    for name, body in KNOWN.items():
        found[name] = _fields(body, name)
    if text.strip() and not re.search(r"^\s*(module|struct)\s", text, re.MULTILINE):  # IDL is not understood
        blocks = re.split(r"^=+[ \t]*$", text, flags=re.MULTILINE)[:MOST_DEFINITIONS]
        for k, block in enumerate(blocks):
            title = re.match(r"\s*MSG:\s*(\S+)", block)
            name = short_name(title.group(1)) if title else main
            if title is None and k > 0:
                continue
            found[name] = _fields(block[title.end() :] if title else block, name)
    return found if main in found and _complete(main, found, (), set()) else None


def _fields(body: str, owner: str) -> tuple[Field, ...]:
    fields = []
    for line in body.splitlines():
        words = line.split("#")[0].split()
        if len(words) < 2 or "=" in words[1] or (len(words) > 2 and words[2].startswith("=")):
            continue  # empty, or a constant
        fields.append(_field(words[0], words[1], owner))
        if len(fields) > MOST_FIELDS:
            break
    return tuple(fields)


def _field(type_name: str, name: str, owner: str) -> Field:
    match = re.fullmatch(r"([\w/]+)(?:<=\d+)?(\[(<=)?(\d*)\])?", type_name)
    if match is None:
        return Field(name, f"?{type_name}")
    base, array, bounded, size = match.groups()
    if base == "Header":
        base = "std_msgs/Header"
    elif base == "time":
        base = TIME
    elif base == "duration":
        base = "builtin_interfaces/Duration"
    elif base not in PRIMITIVES and base not in ("string", "wstring"):
        base = short_name(base) if "/" in base else f"{owner.split('/', maxsplit=1)[0]}/{base}"
    count = None if array is None else 0 if bounded or not size else int(size)
    return Field(name, base, count)


def _complete(name: str, found: Definitions, above: tuple[str, ...], known: set[str]) -> bool:
    """Whether everything that a type needs is defined, without a type that holds itself; `known` are complete ones."""
    if name in known:
        return True
    if name in above or name not in found or len(above) > 20:
        return False
    whole = all(
        field.type in PRIMITIVES
        or field.type in ("string", "wstring")
        or _complete(field.type, found, (*above, name), known)
        for field in found[name]
    )
    if whole:
        known.add(name)
    return whole
