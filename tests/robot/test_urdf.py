"""URDF: serial chains in and out, against Pinocchio and against themselves; everything else refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import fingerprint, read_robot, robot_from_text, write_robot
from elid_cli.robot.robot import Limits, Robot
from elid_cli.robot.urdf.read import read_urdf
from elid_cli.robot.urdf.write import urdf_text, with_parameters
from tests.robot.elastic_lagrange import frames, inertia_matrix, potential
from tests.robot.random_robots import random_robot

ARM = """\
<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/>
  <link name="base"><inertial><mass value="50"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper">
    <visual><geometry><box size="1 1 1"/></geometry></visual>
    <inertial>
      <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.1"/>
      <mass value="4"/>
      <inertia ixx="0.4" iyy="0.5" izz="0.3" ixy="0.01" ixz="-0.02" iyz="0.03"/>
    </inertial>
  </link>
  <link name="bracket">
    <inertial><origin xyz="0 0 0.05"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
  </link>
  <link name="fore"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.05"/></inertial></link>
  <link name="camera"><inertial><mass value="0.5"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
  <link name="tool"/>
  <joint name="stand" type="fixed"><origin xyz="0 0 0.4" rpy="0 0 1.5708"/><parent link="world"/><child link="base"/></joint>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.2" rpy="0 0.4 0"/><parent link="base"/><child link="upper"/><axis xyz="0 2 0"/>
    <limit lower="-2" upper="1.5" effort="100" velocity="3"/><dynamics damping="1.5" friction="0.7"/>
  </joint>
  <joint name="bolt" type="fixed"><origin xyz="0.5 0 0" rpy="0.1 0.2 0.3"/><parent link="upper"/><child link="bracket"/></joint>
  <joint name="slide" type="prismatic">
    <origin xyz="0 0.1 0" rpy="-0.4 0 0"/><parent link="bracket"/><child link="fore"/>
    <limit lower="0" upper="0.3" effort="0" velocity="0"/>
  </joint>
  <joint name="eye" type="fixed"><origin xyz="0.1 0 0"/><parent link="fore"/><child link="camera"/></joint>
  <joint name="spin" type="continuous"><origin xyz="0 0 0.3"/><parent link="fore"/><child link="tool"/><axis xyz="0 0 -1"/></joint>
  <transmission name="t1">
    <joint name="shoulder"/><actuator name="m1"><mechanicalReduction>100</mechanicalReduction></actuator>
    <stiffness>5000</stiffness>
  </transmission>
  <ros2_control name="c" type="system">
    <transmission name="t2"><joint name="slide" role="j"><mechanical_reduction>-20</mechanical_reduction></joint></transmission>
  </ros2_control>
</robot>
"""  # noqa: E501


def refused(text: str) -> str:
    with pytest.raises(RobotError) as caught:
        robot_from_text(text, "arm.urdf")
    return str(caught.value)


def same_motion(one: Robot, two: Robot, samples: int = 5) -> float:
    """Return the largest relative difference of inertia matrices and gravity potentials over random poses."""
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(samples):
        q, other = rng.uniform(-2, 2, (2, one.n))
        a, b = (inertia_matrix(robot, np.nan_to_num(robot.reference()), q) for robot in (one, two))
        worst = max(worst, float(np.abs(a - b).max() / np.abs(a).max()))
        heights = [
            potential(robot, robot.reference(), q) - potential(robot, robot.reference(), other) for robot in (one, two)
        ]
        worst = max(worst, abs(heights[0] - heights[1]) / max(1.0, abs(heights[0])))
    return worst


def described(text: str) -> Robot:
    """Return the robot of a URDF with what the file leaves open filled in: gears of 1, springs."""
    robot = robot_from_text(text, "arm.urdf")
    joints = (replace(joint.geared(joint.gear_ratio or 1.0), transmission="elastic") for joint in robot.joints)
    return replace(robot, joints=tuple(joints))


def test_a_chain_with_fixed_joints_becomes_a_robot():
    robot = robot_from_text(ARM, "arm.urdf")
    shoulder, slide, spin = robot.joints
    assert (robot.name, robot.dh, robot.gravity) == ("arm", "urdf", (0, 0, -9.81))
    assert robot.joint_names == ("shoulder", "slide", "spin")
    assert [joint.type for joint in robot.joints] == ["revolute", "prismatic", "revolute"]
    assert shoulder.axis == (0, 1, 0)
    assert shoulder.limits == Limits(position=(-2, 1.5), velocity=3, torque=100)
    assert slide.limits == Limits(position=(0, 0.3))
    assert spin.limits == Limits()
    assert (shoulder.parameters["fv"], shoulder.parameters["fs"]) == (1.5, 0.7)
    assert (shoulder.gear_ratio, shoulder.parameters["K"], slide.gear_ratio) == (100, 5000, -20)
    assert shoulder.parameters["m"] == 5  # upper + bracket
    assert slide.parameters["m"] == 2.5  # fore + camera
    assert "m" not in spin.parameters  # nothing known of the tool
    # 1.5708 is meant as pi/2 where structure counts, and is what it is where torques do
    np.testing.assert_allclose(shoulder.motor_axis, (-1, 0, 0), atol=1e-5)
    assert shoulder.rpy[2] == pytest.approx(1.5708, abs=1e-15)
    assert robot.squared().joints[0].rpy[2] == np.pi / 2
    assert shoulder.xyz == (0, 0, pytest.approx(0.6))


def test_inertias_and_places_are_those_that_pinocchio_reads():
    pin = pytest.importorskip("pinocchio")
    robot = described(ARM.replace('<link name="tool"/>', '<link name="tool"><inertial><origin xyz="0 .1 0"/>'
        '<mass value="1"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>').replace("1.5708", repr(np.pi / 2)))  # fmt: skip  # noqa: E501
    compare_with_pinocchio(pin, robot, urdf_text(robot))
    # Pinocchio reads the file with its fixed joints itself
    full = ARM.replace('<link name="tool"/>', '<link name="tool"><inertial><origin xyz="0 .1 0" rpy="0 0 0"/>'
        '<mass value="1"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>').replace("1.5708", repr(np.pi / 2))  # fmt: skip  # noqa: E501
    full = full.replace('izz="0.01"/>', 'izz="0.01" ixy="0" ixz="0" iyz="0"/>')
    full = full.replace('izz="0.05"/>', 'izz="0.05" ixy="0" ixz="0" iyz="0"/>').replace(
        'izz="0"/>', 'izz="0" ixy="0" ixz="0" iyz="0"/>'
    )
    compare_with_pinocchio(pin, robot, full)


@pytest.mark.parametrize("dh", ["standard", "modified", "urdf"])
def test_a_written_urdf_moves_in_pinocchio_as_the_robot_does(dh):
    pin = pytest.importorskip("pinocchio")
    robot = random_robot(11, 6, dh, kinds="rrp")
    compare_with_pinocchio(pin, robot, urdf_text(robot))


def compare_with_pinocchio(pin, robot: Robot, text: str) -> None:
    model = pin.buildModelFromXML(text)
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    rng = np.random.default_rng(0)
    n = robot.n
    for _ in range(5):
        q = rng.uniform(-2, 2, n)
        pinned = pin.neutral(model)
        for k, name in enumerate(robot.joint_names):
            joint = model.joints[model.getJointId(name)]
            if joint.nq == 2:  # continuous joints are (cos, sin) there
                pinned[joint.idx_q : joint.idx_q + 2] = (np.cos(q[k]), np.sin(q[k]))
            else:
                pinned[joint.idx_q] = q[k]
        theirs = pin.crba(model, data, pinned)
        theirs = np.triu(theirs) + np.triu(theirs, 1).T
        ours = inertia_matrix(robot, np.nan_to_num(robot.reference()), q)[:n, :n]
        np.testing.assert_allclose(ours, theirs, atol=1e-10 * np.abs(ours).max())
        step = 1e-30
        pull = [potential(robot, robot.reference(), q + 1j * step * e).imag / step for e in np.eye(n)]
        weight = pin.computeGeneralizedGravity(model, data, pinned)
        np.testing.assert_allclose(pull, weight, atol=1e-10 * np.abs(weight).max())


@pytest.mark.parametrize("name", ["planar2", "puma560"])
def test_a_dh_robot_keeps_its_frames_and_parameters_through_urdf(name, tmp_path):
    robot = read_robot(name)
    (tmp_path / "arm.urdf").write_text(urdf_text(robot), "utf-8")
    again = read_robot(tmp_path / "arm.urdf")
    assert fingerprint(again) == fingerprint(robot)
    assert again.description == robot.description
    np.testing.assert_allclose(again.reference(), robot.reference(), rtol=1e-9, atol=1e-13)
    for old, new in zip(robot.joints, again.joints, strict=True):
        assert new.limits == old.limits


def test_a_body_whose_mass_no_motion_shows_keeps_what_is_known_of_it(tmp_path):
    robot = read_robot("planar2")
    first = robot.joints[0]
    known = {name: value for name, value in first.parameters.items() if name not in ("m", "Ixx", "Iyy")}
    bare = replace(robot, joints=(replace(first, parameters={**known, "cx": 0.7, "Izz": 0.4}), *robot.joints[1:]))
    (tmp_path / "arm.urdf").write_text(urdf_text(bare), "utf-8")
    again = read_robot(tmp_path / "arm.urdf")
    names = robot.parameter_names()
    for name in ("cx1", "Izz1", "m2", "Izz2"):
        k = names.index(name)
        assert again.reference()[k] == pytest.approx(bare.reference()[k], rel=1e-9)
    assert again.joints[0].parameters["m"] > 0


def test_an_edited_geometry_is_read_as_it_stands():
    text = urdf_text(read_robot("planar2")).replace('xyz="0.5 0 0"', 'xyz="0.7 0 0"')
    robot = read_urdf(text, "x.urdf")
    assert robot.dh == "urdf"
    assert frames(robot, np.zeros(2))[2][0, 3] == 0.7


@pytest.mark.parametrize("dh", ["standard", "modified", "urdf"])
@pytest.mark.parametrize("seed", range(6))
def test_round_trips_within_1e_9(dh, seed, tmp_path):
    robot = random_robot(seed, 4, dh, kinds="rpr", rigid=(2,), own_axes=True)
    (tmp_path / "arm.urdf").write_text(urdf_text(robot), "utf-8")
    again = read_robot(tmp_path / "arm.urdf")
    assert again.dh == dh
    assert same_motion(robot, again) < 1e-9
    np.testing.assert_allclose(again.reference(), robot.reference(), rtol=1e-9, atol=1e-12)
    for old, new in zip(robot.joints, again.joints, strict=True):
        assert (new.transmission, new.gear_ratio, new.limits) == (old.transmission, old.gear_ratio, old.limits)
        np.testing.assert_allclose(new.motor_axis, old.motor_axis, atol=1e-12)
    write_robot(again, tmp_path / "arm.yaml")
    assert read_robot(tmp_path / "arm.yaml") == again


def test_identified_parameters_are_written_in_place_of_the_reference(tmp_path):
    robot = random_robot(2, 3, "standard")
    values = robot.reference() * 1.1
    (tmp_path / "arm.urdf").write_text(urdf_text(with_parameters(robot, values)), "utf-8")
    np.testing.assert_allclose(read_robot(tmp_path / "arm.urdf").reference(), values, rtol=1e-9, atol=1e-12)


def test_a_body_that_is_none_is_told_in_a_comment():
    robot = read_robot("planar2")
    slender = {"m": 10.0, "cx": -2.5, "cy": 0.0, "cz": 0.0, "Ixx": 0.1, "Iyy": 0.725, "Izz": 0.8}
    bodies = [replace(joint, parameters={**joint.parameters, **slender}) for joint in robot.joints]
    assert "no real body" not in urdf_text(replace(robot, joints=tuple(bodies)))
    bodies[1] = replace(
        bodies[1], parameters={**bodies[1].parameters, "Izz": 0.83}
    )  # about the centre 0.205 > 0.1 + 0.1
    text = urdf_text(replace(robot, joints=tuple(bodies)))
    remark = "moments of inertia of joint2_link are those of no real body, which some simulators refuse"
    assert remark in text.splitlines()[1]
    assert read_urdf(text, "x.urdf").joints[1].parameters["Izz"] == pytest.approx(0.83)


SEVEN = [  # a seven-joint arm, proximal DH: a, alpha, d
    (0, 0, 0.333), (0, -np.pi / 2, 0), (0, np.pi / 2, 0.316), (0.0825, np.pi / 2, 0),
    (-0.0825, -np.pi / 2, 0.384), (0, np.pi / 2, 0), (0.088, np.pi / 2, 0),
]  # fmt: skip


def test_a_seven_joint_arm_has_the_same_base_parameters_as_its_dh_description():
    robot = random_robot(0, 7, "modified")
    joints = [
        replace(joint, a=a, alpha=alpha, d=d, theta=0.0)
        for joint, (a, alpha, d) in zip(robot.joints, SEVEN, strict=True)
    ]
    robot = replace(robot, joints=tuple(joints), gravity=(0, 0, -9.81))
    base = find_base(Regressor(robot))
    # by hand, without elid's remarks and with the five digits that most files have
    lines = ['<robot name="seven"><link name="l0"/>']
    for i, (a, alpha, d) in enumerate(SEVEN, start=1):
        s, c = np.sin(alpha), np.cos(alpha)
        lines.append(f'<link name="l{i}"/><joint name="j{i}" type="continuous"><parent link="l{i - 1}"/>')
        lines.append(f'<child link="l{i}"/><axis xyz="0 0 1"/>')
        lines.append(f'<origin xyz="{a} {-d * s:.9f} {d * c:.9f}" rpy="{alpha:.4f} 0 0"/></joint>')
    by_hand = robot_from_text("".join(lines) + "</robot>", "seven.urdf")
    same_axes = replace(
        by_hand,
        joints=tuple(replace(joint, motor_axis=(0.0, 0.0, 1.0), gear_ratio=ours.gear_ratio, transmission="elastic")
                     for joint, ours in zip(by_hand.joints, joints, strict=True)),
    )  # fmt: skip
    found = find_base(Regressor(same_axes))
    assert found.count == base.count == 43 + 4 * 7
    assert found.names == base.names
    written = robot_from_text(urdf_text(robot), "x.urdf")
    assert find_base(Regressor(written)).names == base.names


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('name="spin" type="continuous"', 'name="spin" type="continous"', ["'spin'", "did you mean 'continuous'"]),
        ('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 0"/>', ["'spin'", "axis"]),
        ('<axis xyz="0 0 -1"/>', '<axis xyz="0 -1"/>', ["arm.urdf:30", "'spin'", "2 numbers where 3"]),
        ('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 nan"/>', ["not finite"]),
        ('<parent link="fore"/><child link="tool"/>', '<parent link="for"/><child link="tool"/>', ["mean 'fore'"]),
        ('<parent link="world"/>', '<parent link="tool"/>', ["loop"]),
        ('<child link="camera"/>', '<child link="tool"/>', ["'tool'", "moves already", "closed loops"]),
        ('<link name="tool"/>', '<link name="tool"/><link name="tool"/>', ["second link"]),
        ("<mechanicalReduction>100", "<mechanicalReduction>0", ["mechanical reduction 0"]),
        ("<mechanicalReduction>100", "<mechanicalReduction>fast", ["'fast'"]),
        ('<mass value="4"/>', '<mass value="four"/>', ["arm.urdf:9", "value='four'"]),
        ("<robot ", "<sdf ", ["not well-formed"]),
        ('<link name="world"/>', "<xacro:include/>", ["xacro", "hint"]),
        ('<?xml version="1.0"?>', '<!DOCTYPE robot [<!ENTITY a "b">]>', ["arm.urdf:1", "DOCTYPE"]),
        ('<?xml version="1.0"?>', '<!DOCTYPE robot SYSTEM "file:///etc/passwd">', ["DOCTYPE"]),
        ("</robot>", "", ["not well-formed"]),
        ("</robot>", "<a>" * 300 + "</a>" * 300 + "</robot>", ["levels"]),
    ],
)  # fmt: skip
def test_what_is_no_chain_is_refused_by_name(old, new, expected):
    assert old in ARM
    message = refused(ARM.replace(old, new, 1))
    for part in expected:
        assert part in message, message
    assert len(message.splitlines()) <= 3


@pytest.mark.parametrize(
    ("old", "new", "said", "joints"),
    [
        ('name="spin" type="continuous"', 'name="spin" type="floating"', ["spin is held fixed", "floating"], 2),
        ('name="spin" type="continuous"', 'name="spin" type="planar"', ["spin is held fixed", "planar"], 2),
        ('<joint name="shoulder"/><act', '<joint name="sholder"/><act', [":32", "mean 'shoulder'"], 3),
        ('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.3"/><origin xyz="1 0 0"/>', [":30", "a second <origin>"], 3),
    ],
)  # fmt: skip
def test_small_faults_are_read_and_told(old, new, said, joints):
    assert old in ARM
    robot = robot_from_text(ARM.replace(old, new, 1), "arm.urdf")
    assert robot.n == joints
    assert all(part in " ".join(robot.notes) for part in said), robot.notes


def test_nothing_is_computed_with_a_gear_ratio_that_nobody_wrote():
    robot = robot_from_text(ARM.replace("<mechanicalReduction>100", "<mechanicalReduction>1"), "arm.urdf")
    assert [joint.gear_ratio for joint in robot.joints] == [None, -20, None]
    assert [joint.transmission for joint in robot.joints] == ["auto"] * 3
    assert robot.elastic.tolist() == [True, False, False]  # a file that knows K means it
    names = robot.parameter_names()
    assert {"Ja1", "Jm2", "Ja3", "K1"} <= set(names)
    assert not {"Jm1", "Ja2", "K2"} & set(names)
    with pytest.raises(RobotError, match="encoders needs the gear ratio of shoulder spin"):
        robot.known_ratios("encoders")
    assert np.isnan(robot.known_ratios("encoders", ["slide"])[0])


def test_the_yaml_beside_completes_the_urdf(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    beside = tmp_path / "arm.elid.yaml"
    beside.write_text(
        "gravity: [0, -9.81, 0]\njoints:\n  spin: {gear_ratio: 50, motor_axis: [0, 0, 1], transmission: rigid,\n"
        "    parameters: {Jm: 1/1000}, limits: {torque: 9}}\n  slide: {parameters: {K: 7}}\nlog: {q: {from: a}}\n"
    )
    robot = read_robot(tmp_path / "arm.urdf")
    shoulder, slide, spin = robot.joints
    assert robot.gravity == (0, -9.81, 0)
    assert (spin.gear_ratio, spin.motor_axis, spin.transmission) == (50, (0, 0, 1), "rigid")
    assert (spin.parameters["Jm"], spin.limits.torque, slide.parameters["K"]) == (0.001, 9, 7)
    assert slide.parameters["m"] == 2.5
    assert shoulder.gear_ratio == 100
    assert robot.log == {"q": {"from": "a"}}
    beside.write_text("joints:\n  spin: {gear_ration: 50}\n")
    with pytest.raises(RobotError, match=r"arm.elid.yaml:2: spin: unknown key 'gear_ration'\n  hint: did you mean"):
        read_robot(tmp_path / "arm.urdf")
    beside.write_text("joints:\n  spine: {}\n")
    with pytest.raises(RobotError, match=r"arm.elid.yaml:2: joints: no joint 'spine'"):
        read_robot(tmp_path / "arm.urdf")


def test_a_body_without_mass_but_with_a_first_moment_cannot_be_a_urdf_link():
    robot = read_robot("planar2")
    values = robot.reference()
    values[robot.parameter_names().index("m2")] = 0
    with pytest.raises(RobotError, match=r"joint2: a first moment"):
        urdf_text(with_parameters(robot, values))
