"""The user's own file comes back with new numbers and nothing else changed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.body_torques import gravity_torques, inertial_torques
from elid_cli.robot.files import read_robot, robot_from_text, write_robot
from elid_cli.robot.locking import locked
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.patch import patched
from elid_cli.robot.patch_values import alike
from elid_cli.robot.robot import Robot
from elid_cli.robot.urdf.write import in_joint_frames
from elid_cli.robot.xml_edit import XmlEdit
from elid_cli.robot.zeros import with_zeros, zero_between
from tests.robot.elastic_lagrange import inertia_matrix
from tests.robot.test_mjcf import MODEL, compared, held, rigid
from tests.robot.test_urdf import ARM, described

URDF = ARM.replace(
    '<link name="tool"/>',
    '<link name="tool"><!-- a mesh --><visual><geometry><mesh filename="package://tool.stl"/></geometry></visual>'
    '<inertial><mass value="0.3"/><inertia ixx="0.01" iyy="0.02" izz="0.02"/></inertial></link>',
)
URDF = re.sub(r'( izz="[^"]*")/>', r'\1 ixy="0" ixz="0" iyz="0"/>', URDF)


def heavier(robot: Robot) -> Robot:
    """Return the robot with other masses, inertias, friction and reflected inertias."""
    joints = []
    for k, joint in enumerate(robot.joints, start=2):
        values = {n: v * (1 + 0.1 * k) if n in LINK_PARAMETERS else v for n, v in joint.parameters.items()}
        own = {"Ja" if joint.gear_ratio is None else "Jm": 0.01 * k}
        joints.append(replace(joint, parameters={**values, "fs": 0.2 * k, "fv": 0.3 * k, **own}))
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize(("text", "name"), [(URDF, "arm.urdf"), (MODEL, "arm.xml")])
def test_unchanged_parameters_leave_every_byte(text: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    assert patched(read_robot(tmp_path / name)) == text


@pytest.mark.parametrize(("text", "name"), [(URDF, "arm.urdf"), (MODEL, "arm.xml")])
def test_new_parameters_read_back_and_nothing_else_changes(text: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    robot = heavier(read_robot(tmp_path / name))
    written = patched(robot, ["Identified -- by elid."])
    again = robot_from_text(written, name)
    for ours, theirs in zip(robot.joints, again.joints, strict=True):
        size = max(abs(ours.parameters.get(n, 0.0)) for n in LINK_PARAMETERS)
        for key, value in ours.parameters.items():
            assert theirs.parameters[key] == pytest.approx(value, rel=1e-9, abs=1e-12 * size), (ours.name, key)
        assert (theirs.limits, theirs.gear_ratio, theirs.xyz) == (ours.limits, ours.gear_ratio, ours.xyz)
    assert "<!-- Identified - - by elid. -->" in written
    changed = r"<inertial>.*?</inertial>|<inertial[^>]*/>|<dynamics[^>]*/>|<elid[^>]*/>|<!-- Identified[^>]*-->|\s+"
    changed += r'|(armature|damping|frictionloss)="[^"]*"'
    kept = [re.sub(changed, "", t, flags=re.DOTALL) for t in (text, written)]
    assert kept[0] == kept[1]


@pytest.mark.parametrize(("text", "name"), [(URDF, "arm.urdf"), (MODEL, "arm.xml")])
def test_a_robot_turned_to_the_zeros_of_its_encoders_reads_back(text: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    before = read_robot(tmp_path / name)
    offsets = np.where(np.arange(before.n) % 2 == 0, 0.07, -0.3) * (np.arange(before.n) > 0)
    turned = with_zeros(before, offsets)
    assert [zero_between(before, turned, k) for k in range(before.n)] == pytest.approx(offsets, abs=1e-12)
    again = robot_from_text(patched(turned), name)
    for ours, theirs in zip(turned.placements(), again.placements(), strict=True):
        np.testing.assert_allclose(theirs[0] @ theirs[1], ours[0] @ ours[1], atol=1e-9)
    # positions that are read too large by the offsets hold it as the true ones hold the robot before
    q = np.random.default_rng(1).uniform(-1, 1, (20, before.n))
    np.testing.assert_allclose(gravity_torques(again, q + offsets), gravity_torques(before, q), atol=1e-7)


@pytest.mark.parametrize("name", ["puma560", "planar2", "emps"])
def test_a_described_robot_turned_to_the_zeros_of_its_encoders_holds_what_it_held(name: str, tmp_path: Path) -> None:
    before = read_robot(name)
    offsets = 0.1 * np.arange(1, before.n + 1)
    write_robot(with_zeros(before, offsets), tmp_path / "turned.yaml")
    again = read_robot(tmp_path / "turned.yaml")
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 20, before.n))
    for of in (lambda robot, q: gravity_torques(robot, q), lambda robot, q: inertial_torques(robot, q, v, a)):
        np.testing.assert_allclose(of(again, q + offsets), of(before, q), atol=1e-7)


def test_an_element_without_end_tag_before_the_end_of_another_is_replaced_alone() -> None:
    text = '<a><b x="1"/></a>'
    edit = XmlEdit(text, "a.xml")
    edit.replace(edit.root.children[0], '<b x="2"/>')
    assert edit.text() == '<a><b x="2"/></a>'
    for whole in ("<a><b></b></a>", "<a><b>t</b></a>", "<a><b/></a>", "<a><b><c/></b></a>", '<a><b y="/"></b></a>'):
        edit = XmlEdit(whole, "a.xml")
        edit.replace(edit.root.children[0], "")
        assert edit.text() == "<a></a>"


def test_comments_inside_an_inertial_stay(tmp_path: Path) -> None:
    text = re.sub(
        r'(<inertial>.*?)(<mass value="[^"]*"/>)', r"\1<!-- CAD -->\2 <!-- weighed -->", URDF, flags=re.DOTALL
    )
    (tmp_path / "arm.urdf").write_text(text)
    robot = heavier(read_robot(tmp_path / "arm.urdf"))
    written = patched(robot, ["One sentence.", "a remark", "another"])
    assert written.count("weighed") == written.count("CAD") == text.count("CAD") > 0
    assert "<!-- One sentence. a remark; another -->" in written
    for ours, theirs in zip(robot.joints, robot_from_text(written, "arm.urdf").joints, strict=True):
        assert theirs.parameters["Iyy"] == pytest.approx(ours.parameters["Iyy"], rel=1e-9)


def test_pinocchio_reads_the_patched_urdf_as_elid_does(tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    (tmp_path / "arm.urdf").write_text(URDF)
    robot = heavier(read_robot(tmp_path / "arm.urdf"))
    model = pin.buildModelFromXML(re.sub(r'(i[xyz]{2}="[^"]*")/>', r"\1 />", patched(robot)))
    data, full = model.createData(), described(patched(robot))
    q = np.array([0.3, 0.1, -0.7])
    theirs = pin.crba(model, data, np.array([q[0], q[1], np.cos(q[2]), np.sin(q[2])]))
    theirs = np.triu(theirs) + np.triu(theirs, 1).T
    ours = inertia_matrix(full, np.nan_to_num(full.reference()), q)[:3, :3]
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(ours).max())


def test_mujoco_reads_the_patched_mjcf_as_elid_does(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "arm.xml").write_text(held(MODEL))
    robot = heavier(read_robot(tmp_path / "arm.xml"))
    compared(rigid(robot), mujoco.MjModel.from_xml_string(patched(robot)))


def test_locked_joints_keep_their_own_links(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    robot = locked(read_robot(tmp_path / "arm.urdf"), {"slide": 0.2})
    assert patched(robot) == URDF
    again = locked(robot_from_text(patched(heavier(robot)), "arm.urdf"), {"slide": 0.2})
    for ours, theirs in zip(in_joint_frames(heavier(robot)).joints, again.joints, strict=True):
        assert theirs.parameters["m"] == pytest.approx(ours.parameters["m"], rel=1e-12)
        assert theirs.parameters["Izz"] == pytest.approx(ours.parameters["Izz"], rel=1e-9)


def test_what_the_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    robot = read_robot(tmp_path / "arm.urdf")
    light = replace(robot.joints[0], parameters={**robot.joints[0].parameters, "m": 0.1})
    with pytest.raises(RobotError, match=r"link 'upper' would have a mass of -0\.9 kg"):
        patched(replace(robot, joints=(light, *robot.joints[1:])))
    flat = replace(robot.joints[0], parameters={**robot.joints[0].parameters, "Ixx": 9.0})
    said = patched(replace(robot, joints=(flat, *robot.joints[1:])))
    assert "inertia of upper are those of no real body, which some simulators refuse" in said
    (tmp_path / "arm.urdf").write_text(URDF.replace('"slide"', '"glide"'))
    with pytest.raises(RobotError, match="no joint 'slide' any more"):
        patched(robot)


@pytest.mark.parametrize(("text", "name"), [(URDF, "arm.urdf"), (MODEL, "arm.xml")])
def test_another_torque_limit_reads_back(text: str, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    robot = read_robot(tmp_path / name)
    known = robot.torque_limits
    for limit in (0.25, 1e6):
        joint = replace(robot.joints[0], limits=replace(robot.joints[0].limits, torque=limit))
        written = patched(replace(robot, joints=(joint, *robot.joints[1:])))
        found = robot_from_text(written, name).torque_limits
        assert found[0] == limit  # of an MJCF, actuators with a lower one lose it
        assert np.array_equal(found[1:], known[1:])
    joint = replace(robot.joints[0], limits=replace(robot.joints[0].limits, torque=None))
    written = patched(replace(robot, joints=(joint, *robot.joints[1:])))
    assert robot_from_text(written, name).torque_limits[0] in (np.inf, known[0])


def test_attributes_of_several_numbers_or_words_are_compared_as_they_are() -> None:
    """A `actuatorfrcrange` that a file had already ended in an error."""
    assert alike("-6.0 6.0", "-6 6")
    assert alike("true", "true")
    assert not alike("-6.0 6.0", "-5 5")
    assert not alike("6.0", "-6 6")
    assert not alike("auto", "true")


TOOLED = {
    "a.xml": '<mujoco model="a"><worldbody><body name="one"><joint name="j" type="hinge" axis="0 1 0"/>'
    '<inertial pos="0 0 -0.2" mass="0.5" diaginertia="0.01 0.01 0.002"/>'
    '<body name="tool" pos="0 0 -0.4"><inertial pos="0.02 0 0" mass="0.6" diaginertia="0.001 0.001 0.001"/>'
    '<geom type="sphere" size="0.03"/><body name="tip" pos="0 0 -0.1"><geom type="sphere" size="0.02"/></body>'
    "</body></body></worldbody></mujoco>",
    "a.urdf": '<robot name="a"><link name="base"/><link name="one"><inertial><origin xyz="0 0 -0.2"/>'
    '<mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<link name="tool"><inertial><origin xyz="0.02 0 0"/><mass value="0.6"/><inertia ixx="0.001" iyy="0.001" '
    'izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="j" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/></joint>'
    '<joint name="hold" type="fixed"><origin xyz="0 0 -0.4"/><parent link="one"/><child link="tool"/></joint></robot>',
}


@pytest.mark.parametrize("name", list(TOOLED))
def test_a_tool_of_the_file_that_is_not_there_is_taken_off(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(TOOLED[name])
    robot = read_robot(tmp_path / name)
    rod = {"m": 0.5, "cx": 0.0, "cy": 0.0, "cz": -0.1, "Ixx": 0.03, "Iyy": 0.03, "Izz": 0.002}
    (joint,) = robot.joints
    text = patched(replace(robot, joints=(replace(joint, parameters={**joint.parameters, **rod, "Ixz": 0.0}),)))
    assert "one has the mass of what is fixed to it as well (tool" in text
    again = robot_from_text(text, name)
    for key, value in rod.items():
        assert again.joints[0].parameters[key] == pytest.approx(value, abs=1e-12)
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    assert model.body_mass.sum() == pytest.approx(0.5)
    # what a lighter tool leaves of the link is a body: only that changes
    lighter = {n: v * 0.9 for n, v in joint.parameters.items()}
    text = patched(replace(robot, joints=(replace(joint, parameters=lighter),)))
    assert "fixed to it" not in text
    assert robot_from_text(text, name).joints[0].parameters["m"] == pytest.approx(0.9 * joint.parameters["m"])
