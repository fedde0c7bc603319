"""Robot descriptions: what is read, what is refused and how, and that what is written reads back the same."""

from __future__ import annotations

import math
import os
import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elid_cli.errors import EXIT_USAGE, RobotError, UsageError
from elid_cli.model.effects.declared import check_effects
from elid_cli.robot.files import fingerprint, read_robot, robot_from_text, shipped_robots, write_robot
from elid_cli.robot.parameter import JOINT_PARAMETERS
from elid_cli.robot.robot import EffectSpec, Joint, Limits, Robot
from elid_cli.robot.text import text_of

GOOD = """\
name: arm
description: a test arm
gravity: [0, -9.81, 0]
dh: standard
joints:
  - name: shoulder
    a: 0.5
    alpha: pi/2
    d: -1/160
    theta: 0
    gear_ratio: 1e2
    limits: {position: [-pi, pi], velocity: 2}
    parameters: {m: 21, K: 3000}
  - name: slide
    type: prismatic
    a: 0
    alpha: -2*pi/3
    d: 0
    theta: 0
    gear_ratio: -62.6
    motor_axis: [0, sqrt(2)/2, sqrt(2)/2]
    transmission: rigid
effects:
  - {effect: stribeck, joint: slide, parameters: {amplitude: -0.25, velocity: 0.1}}
log:
  q: {from: "q{i}", unit: "counts:4096", scale: [1e-3, 2]}
"""


def refused(text: str) -> str:
    with pytest.raises(RobotError) as caught:
        check_effects(robot_from_text(text, "arm.yaml"))
    assert caught.value.exit_code == EXIT_USAGE
    return str(caught.value)


def test_every_key_is_read():
    robot = robot_from_text(GOOD, "arm.yaml")
    shoulder, slide = robot.joints
    assert (robot.name, robot.description, robot.gravity, robot.dh) == ("arm", "a test arm", (0, -9.81, 0), "standard")
    assert (shoulder.alpha, shoulder.d, shoulder.gear_ratio) == (math.pi / 2, -1 / 160, 100)
    assert shoulder.limits == Limits(position=(-math.pi, math.pi), velocity=2)
    assert shoulder.type == "revolute"
    assert shoulder.transmission == "elastic"
    assert shoulder.parameters == {"m": 21, "K": 3000}
    assert slide.type == "prismatic"
    assert slide.transmission == "rigid"
    assert math.hypot(*slide.motor_axis) == pytest.approx(1, abs=1e-15)
    assert robot.effects == (EffectSpec("stribeck", "slide", {"amplitude": -0.25, "velocity": 0.1}),)
    assert robot.log == {"q": {"from": "q{i}", "unit": "counts:4096", "scale": [1e-3, 2]}}


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("gear_ratio: 1e2", "gear_ration: 1e2", ["arm.yaml:11:", "shoulder", "'gear_ration'", "mean 'gear_ratio'"]),
        ("dh: standard\n", "", ["arm.yaml:1:", "missing key 'dh'", "standard (distal", "modified (proximal)"]),
        ("name: arm\n", "", ["missing key 'name'"]),
        ("dh: standard", "dh: standrd", ["arm.yaml:4:", "did you mean 'standard'"]),
        ("a: 0.5", "a: [1]", ["arm.yaml:7:", "shoulder: a", "a list where a number"]),
        ("a: 0.5", "a: .nan", ["arm.yaml:7:", "shoulder: a", "not finite"]),
        ("a: 0.5", "a: 1/0", ["divides by zero"]),
        ("a: 0.5", "a: 9**9**9", ["not finite"]),
        ("a: 0.5", "a: __import__('os')", ["arm.yaml:7:", "shoulder: a"]),
        ("a: 0.5", "a:", ["arm.yaml:7:", "empty, a number is needed"]),
        ("a: 0.5", "a: true", ["arm.yaml:7:", "'true' is not a number"]),
        ("a: 0.5", "a: 0.5\n    a: 0.6", ["arm.yaml:8:", "'a' a second time", "line 7"]),
        ("gravity: [0, -9.81, 0]", "gravity: [0, -9.81]", ["arm.yaml:3:", "gravity: 2 numbers where 3"]),
        ("gear_ratio: 1e2", "gear_ratio: 0", ["arm.yaml:11:", "shoulder: gear_ratio: 0"]),
        ("sqrt(2)/2, sqrt(2)/2", "1, 1", ["arm.yaml:21:", "slide: motor_axis", "unit vector", "[0, 0.707106781, "]),
        ("name: slide", "name: shoulder", ["arm.yaml:14:", "second joint of this name"]),
        ("{m: 21,", "{m1: 21,", ["arm.yaml:13:", "shoulder: parameters", "'m1'", "did you mean 'm'"]),
        ("{m: 21,", "{Ja: 2, Jm: 1,", ["arm.yaml:13:", "shoulder: parameters", "Ja and Jm are the same inertia"]),
        ("effect: stribeck", "effect: stribek", ["arm.yaml:24:", "did you mean 'stribeck'"]),
        ("amplitude: -0.25", "amplitud: -0.25", ["arm.yaml:24:", "of slide", "'amplitud'", "mean 'amplitude'"]),
        ("velocity: 0.1}", "velocity: 0.1, width: 3}", ["arm.yaml:24:", "'width'", "amplitude, velocity, exponent"]),
        ("joint: slide", "joint: slid", ["arm.yaml:24:", "no joint 'slid'", "did you mean 'slide'"]),
        ("amplitude: -0.25", "amplitude: inf", ["arm.yaml:24:", "stribeck of slide: amplitude", "not finite"]),
        ("[-pi, pi]", "[pi, -pi]", ["limits: position"]),
        ("velocity: 2}", "velocity: -2}", ["not a positive magnitude"]),
        ("type: prismatic", "type: sliding", ["arm.yaml:15:", "revolute, prismatic"]),
        ("joints:\n", "joints: {}\nbones:\n", ["unknown key 'bones'", "joints"]),
        ("a: 0.5", "a: !!python/object:os.system 1", ["arm.yaml:7:", "tag"]),
        ("a: 0.5", "a: *nowhere", ["arm.yaml:7:", "alias"]),
        ("a: 0.5", "a: {b", ["arm.yaml:"]),
    ],
)  # fmt: skip
def test_faults_name_file_line_joint_key_and_the_nearest_key(old, new, expected):
    assert old in GOOD
    message = refused(GOOD.replace(old, new, 1))
    for part in expected:
        assert part in message, message
    assert len(message.splitlines()) <= 3


@pytest.mark.parametrize(
    "text",
    [
        "",
        "just words",
        "[1, 2",
        "- a\n- b",
        "name: [a]",
        "joints: []\nname: a\ndh: standard\ngravity: [0,0,0]",
        "--- 1\n--- 2",
        "a: \x00",
        "<robot",
        "[" * 5000,
        "{a: " * 5000,
        "&a [*a]",
        "a: &x [1]\n" + "\n".join(f"b{i}: *x" for i in range(1000)),
    ],
)
def test_texts_that_are_no_robot_are_refused(text):
    assert "arm.yaml" in refused(text)


def test_billion_laughs_end_early():
    lines = ["l0: &l0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    lines += [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]" for i in range(1, 10)]
    assert "values" in refused("\n".join(lines))


def test_a_megabyte_is_not_parsed():
    assert "1000000" in refused("# " + "x" * 1_000_001)


def test_anchors_and_merges_repeat_joints():
    text = GOOD.replace("  - name: shoulder", "  - &first\n    name: shoulder").replace(
        "effects:", "  - {<<: *first, name: elbow, a: 0.7}\neffects:"
    )
    robot = robot_from_text(text, "arm.yaml")
    assert robot.joint_names == ("shoulder", "slide", "elbow")
    assert robot.joints[2].a == 0.7
    assert robot.joints[2].gear_ratio == robot.joints[0].gear_ratio


def test_shipped_robots_are_found_by_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "planar2").mkdir()  # a folder of the same name does not hide it
    assert set(shipped_robots()) >= {"planar2", "puma560", "emps", "kr300", "quanser_2dsfl"}
    assert read_robot("planar2").n == 2
    with pytest.raises(RobotError, match="did you mean 'puma560'"):
        read_robot("puma56")
    with pytest.raises(RobotError, match="'puma560', the robot that ships"):
        read_robot("puma560.yaml")


def test_files_that_cannot_be_read_are_one_clear_error(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "binary.yaml").write_bytes(b"\x89PNG\r\n\xff\x00")
    (tmp_path / "large.yaml").write_bytes(b"#" * 1_000_002)
    (tmp_path / "arm.yaml").write_text(GOOD)
    cases = {
        "pipe.yaml": "pipe",
        "folder.yaml": "folder",
        "binary.yaml": "not UTF-8 text",
        "large.yaml": "1000002 bytes",
        "arn.yaml": "did you mean",
        "x" * 300 + ".yaml": "cannot be read",
        "a\0b.yaml": "",
    }
    for name, expected in cases.items():
        with pytest.raises(RobotError) as caught:
            read_robot(tmp_path / name)
        assert expected in str(caught.value)
        assert caught.value.exit_code == EXIT_USAGE


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_an_unreadable_file_is_one_clear_error(tmp_path):
    (tmp_path / "arm.yaml").write_text(GOOD)
    (tmp_path / "arm.yaml").chmod(0)
    with pytest.raises(RobotError, match="cannot be read"):
        read_robot(tmp_path / "arm.yaml")


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_shipped_robots_round_trip_exactly(name, tmp_path):
    robot = read_robot(name)
    write_robot(robot, tmp_path / "r.yaml")
    again = read_robot(tmp_path / "r.yaml")
    assert again == robot
    assert text_of(again) == (tmp_path / "r.yaml").read_text(encoding="utf-8")
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert [path.name for path in tmp_path.iterdir()] == ["r.yaml"]


finite = st.floats(-1e11, 1e11).filter(lambda value: value == 0 or abs(value) > 1e-99)  # what a quantity may be
names = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=12)
texts = st.text(st.characters(codec="utf-8"))
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**15), 10**15) | finite | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8,
)


@st.composite
def robots(draw) -> Robot:
    dh = draw(st.sampled_from(["standard", "modified", "urdf"]))
    joints = []
    for name in draw(st.lists(names, min_size=1, max_size=4, unique=True)):
        numbers = iter(draw(st.lists(finite, min_size=6, max_size=6)))
        geometry = (
            {"xyz": tuple(next(numbers) for _ in range(3)), "rpy": tuple(next(numbers) for _ in range(3))}
            if dh == "urdf"
            else {key: next(numbers) for key in ("a", "alpha", "d", "theta")}
        )
        gear_ratio = draw(st.none() | st.floats(0.01, 1e5) | st.floats(-1e5, -0.01))
        other = "Jm" if gear_ratio is None else "Ja"
        parameters = draw(st.dictionaries(st.sampled_from([k for k in JOINT_PARAMETERS if k != other]), finite))
        joints.append(
            Joint(
                name=name,
                parent=draw(st.sampled_from(["", *(["base"] if joints else []), *(j.name for j in joints[:-1])])),
                type=draw(st.sampled_from(["revolute", "prismatic"])),
                gear_ratio=gear_ratio,
                motor_axis=draw(st.sampled_from([(0.0, 0.0, 1.0), (0.6, 0.0, -0.8), (0.0, -1.0, 0.0)])),
                transmission=draw(st.sampled_from(["elastic", "rigid", "auto"])),
                parameters=parameters,
                limits=Limits(position=draw(st.none() | st.just((-1.5, 2.25))), torque=draw(st.none() | st.just(3.0))),
                **geometry,
            )
        )
    where = st.none() | st.sampled_from([joint.name for joint in joints])
    effects = st.builds(
        EffectSpec,
        st.just("stribeck"),
        where,
        st.dictionaries(st.sampled_from(["amplitude", "velocity", "exponent"]), finite),
    )
    return Robot(
        name=draw(names),
        joints=tuple(joints),
        gravity=(0.0, draw(finite), -9.81),
        dh=dh,
        description=draw(texts),
        effects=tuple(draw(st.lists(effects, max_size=2))),
        log=draw(st.dictionaries(texts, plain, max_size=3)),
    )


@settings(max_examples=80, deadline=None)
@given(robots())
def test_any_robot_round_trips_exactly(robot):
    text = text_of(robot)
    again = robot_from_text(text, "generated")
    assert again == robot
    assert text_of(again) == text
    assert fingerprint(again) == fingerprint(robot)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=200) | st.text(st.sampled_from("{}[]:,-&*!<> \n'\"#?|a1"), max_size=60))
def test_no_text_makes_anything_but_a_robot_error(text):
    with pytest.raises(RobotError):
        robot_from_text(text, "noise.yaml")


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_description_is_read_or_refused_never_a_crash(data):
    cut = data.draw(st.integers(0, len(GOOD)))
    length = data.draw(st.integers(0, 20))
    text = GOOD[:cut] + data.draw(st.text(max_size=6)) + GOOD[cut + length :]
    robot, fault = None, ""
    try:
        robot = robot_from_text(text, "damaged.yaml")
    except RobotError as error:
        fault = str(error)
    assert fault.startswith("damaged.yaml") or robot_from_text(text_of(robot), "again") == robot


def test_the_fingerprint_is_that_of_the_model():
    robot = robot_from_text(GOOD, "arm.yaml")
    same = GOOD.replace("m: 21", "m: 22").replace("a test arm", "other words").replace("velocity: 2}", "velocity: 3}")
    assert fingerprint(robot_from_text(same, "x")) == fingerprint(robot)
    for old, new in (
        ("a: 0.5", "a: 0.6"),
        ("rigid", "elastic"),
        ("-9.81", "9.81"),
        ("amplitude: -0.25", "amplitude: 0"),
    ):
        assert fingerprint(robot_from_text(GOOD.replace(old, new, 1), "x")) != fingerprint(robot)


def test_a_robot_is_not_written_into_a_missing_folder(tmp_path):
    with pytest.raises(UsageError, match="no folder"):
        write_robot(read_robot("planar2"), tmp_path / "none" / "r.yaml")
