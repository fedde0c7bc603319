"""Schemas that are empty, unknown or IDL; JSON; custom messages by mapping; names and values apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.logs.mcap_made import DYNAMIC, Bag
from tests.system.hostile.bags import (
    ARRAYS,
    HEADER,
    STAMP,
    arrays,
    header,
    joint_states,
    names_and_values,
    one_topic,
    stamps,
)
from tests.system.hostile.hostile import JOINTS, base, elid, one_message, refused, used


def saved(folder: Path, data: bytes) -> Path:
    path = folder / "log.mcap"
    path.write_bytes(data)
    return path


def mapped(folder: Path, **signals: str) -> tuple[object, ...]:
    """Return the options for a mapping file."""
    path = folder / "map.yaml"
    path.write_text("".join(f"{signal}: {place}\n" for signal, place in signals.items()))
    return ("--map", path)


@pytest.mark.parametrize(
    "topic",
    [
        {"shown": ""},
        {"language": "ros2idl", "shown": "module sensor_msgs { module msg { struct JointState { double x; }; }; };"},
        {"language": "omgidl", "shown": "?"},
        {"encoding": "json", "language": "jsonschema", "shown": "{}"},
    ],
    ids=["empty", "ros2idl", "unknown", "json"],
)
def test_joint_states_are_known_by_name(tmp_path: Path, topic: dict[str, Any]) -> None:
    used(saved(tmp_path, joint_states(**topic)), tolerance=1e-9)


@pytest.mark.parametrize(("language", "shown"), [("ros2idl", "module my { };"), ("ros2msg", ""), ("?", "?")])
def test_other_types_are_named_with_what_was_expected(tmp_path: Path, language: str, shown: str) -> None:
    data = one_topic("/state", "my_msgs/msg/Arm", ARRAYS, arrays, language=language, shown=shown)
    refused(saved(tmp_path, data), "my_msgs/msg/Arm", "expected ros2msg", "sensor_msgs/JointState", "/state")


def test_arrays_of_a_custom_message_by_mapping(tmp_path: Path) -> None:
    log = saved(tmp_path, one_topic("/state", "my_msgs/msg/Arm", ARRAYS, arrays))
    places = {"q": "{from: /state, field: link}", "theta": "/state.position", "tau": "/state.effort"}
    used(log, more=mapped(tmp_path, **places), tolerance=1e-9)
    refused(log, "no position", "/state.position")
    places["q"] = "{from: /state, field: links}"
    refused(log, "no field 'links'", "nearest: 'link'", "--map", more=mapped(tmp_path, **places))


def test_franka_robot_states_by_mapping(tmp_path: Path) -> None:
    text = f"{HEADER}float64[2] q\nfloat64[2] theta\nfloat32[2] tau_j\nuint8 mode\nfloat64[16] o_t_ee\n{STAMP}"

    def row(k: int, stamp: int) -> dict[str, Any]:
        rest = {"tau_j": base().tau[k].tolist(), "mode": 2, "o_t_ee": [0.0] * 16}
        return {"header": header(stamp), "q": base().q[k].tolist(), "theta": base().theta[k].tolist(), **rest}

    log = saved(tmp_path, one_topic("/franka/state", "franka_msgs/msg/FrankaState", text, row))
    spec = {signal: f"{{from: /franka/state, field: {name}}}" for signal, name in
            {"q": "q", "theta": "theta", "tau": "tau_j"}.items()}  # fmt: skip
    used(log, "joint order", more=mapped(tmp_path, **spec), tolerance=1e-4)


@pytest.mark.parametrize("language", ["ros2msg", "ros2idl"])
def test_dynamic_joint_states_with_any_interface_names(tmp_path: Path, language: str) -> None:
    def row(k: int, stamp: int) -> dict[str, Any]:
        log = base()
        last = {"interface_names": ["drive/angle", "torque", "position"],
                "values": [log.theta[k, 0], log.tau[k, 0], log.q[k, 0]]}  # fmt: skip
        first = {"interface_names": ["position", "drive/angle", "torque"],
                 "values": [log.q[k, 1], log.theta[k, 1], log.tau[k, 1]]}  # fmt: skip
        spare = {"interface_names": ["voltage"], "values": [24.0]}
        return {
            "header": header(stamp), "joint_names": ["joint2", "gpio", "joint1"],
            "interface_values": [first, spare, last],
        }  # fmt: skip

    data = one_topic("/dynamic_joint_states", "control_msgs/msg/DynamicJointState", DYNAMIC, row, language=language)
    places = {"q": "position", "theta": "interface_values.drive/angle", "tau": "torque"}
    spec = {signal: f"{{from: /dynamic_joint_states, field: {name}}}" for signal, name in places.items()}
    used(saved(tmp_path, data), more=mapped(tmp_path, **spec), tolerance=1e-9)


@pytest.mark.parametrize(
    "pair",
    [{}, {"late": True}, {"change": 1500}, {"change": 1500, "version": False}],
    ids=["names first", "names last", "names change", "names change without a version"],
)
@pytest.mark.parametrize(
    "places",
    [
        "{{from: /arm/values, field: '{signal}.{{joint}}'}}",
        "'/arm/values.{signal}.{{joint}}'",
        "{{from: /arm/values, joints: {{joint1: {signal}.joint1, joint2: {signal}.joint2}}}}",
    ],
    ids=["field", "short", "joints"],
)
def test_names_and_values_on_two_topics(tmp_path: Path, pair: dict[str, Any], places: str) -> None:
    spec = {signal: places.format(signal=signal) for signal in ("q", "theta", "tau")}
    used(saved(tmp_path, names_and_values(**pair)), more=mapped(tmp_path, **spec), tolerance=1e-9)


def test_values_by_number_are_refused_where_their_names_change(tmp_path: Path) -> None:
    numbers = {"q": (1, 4), "theta": (2, 5), "tau": (3, 6)}
    spec = {s: f"{{from: /arm/values, joints: {{joint1: {a}, joint2: {b}}}}}" for s, (a, b) in numbers.items()}
    options = mapped(tmp_path, **spec)
    used(saved(tmp_path, names_and_values()), more=options, tolerance=1e-9)
    refused(saved(tmp_path, names_and_values(change=1500)), "not always the same", "by name", more=options)


def test_names_are_listed_and_the_nearest_named(tmp_path: Path) -> None:
    log = saved(tmp_path, names_and_values())
    spec = {signal: f"'/arm/values.{signal}.{{joint}}'" for signal in ("q", "tau")}
    options = mapped(tmp_path, **spec, theta="'/arm/values.tetha.{joint}'")
    refused(log, "no field 'tetha.joint1'", "theta.joint1", more=options)
    done = elid("info", log)
    assert done.code == 0
    assert "theta.joint1" in done.out


def test_plain_arrays_need_no_field(tmp_path: Path) -> None:
    text = "std_msgs/MultiArrayLayout layout\nfloat64[] data\n"
    text += f"{'=' * 80}\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    text += f"{'=' * 80}\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
    bag = Bag()
    for signal in ("q", "theta", "tau"):
        bag.topic(f"/{signal}", "std_msgs/msg/Float64MultiArray", text)
    for row, stamp in stamps():
        for signal in ("q", "theta", "tau"):
            data = getattr(base(), signal)[row].tolist()
            bag.add(f"/{signal}", stamp, {"layout": {"dim": [], "data_offset": 0}, "data": data})
    log = saved(tmp_path, bag.bytes())
    used(log, more=("--map", "q=/q", "--map", "theta=/theta", "--map", "tau=/tau"), tolerance=1e-9)
    one_message(elid("identify", log, "--robot", "planar2"), "/theta.data")


def test_joints_are_matched_by_name_in_any_order(tmp_path: Path) -> None:
    from tests.logs.mcap_made import joint_state

    bag = Bag()
    bag.topic("/joint_states")
    bag.topic("/motor_states")
    log = base()
    for row, stamp in stamps():
        q, theta, tau = log.q[row], log.theta[row], log.tau[row]
        bag.add("/joint_states", stamp, joint_state(stamp, ["tool", *JOINTS[::-1]], [9.0, *q[::-1]]))
        bag.add("/motor_states", stamp, joint_state(stamp, [*JOINTS, "fan"], [*theta, 1.0], effort=[*tau, 2.0]))
    used(saved(tmp_path, bag.bytes()), tolerance=1e-9)
