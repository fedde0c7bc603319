"""Joints of an MJCF with a rotor of its own: read as elastic ones, written back, and the same to MuJoCo."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.experiment.real_bodies import apart, known_parameters
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot, robot_from_text
from elid_cli.robot.locking import locked
from elid_cli.robot.mjcf.held import folded
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.patch import patched
from elid_cli.robot.robot import EffectSpec, Joint, Robot
from tests.robot.random_robots import random_robot

SERIES = """
<mujoco model="series">
  <!-- a person's arm -->
  <compiler angle="degree"/>
  <option gravity="0 -9.81 0.5"/>
  <default>
    <joint damping="0.05"/>
    <tendon stiffness="0.5"/>
    <default class="rotor"><joint damping="0.002" frictionloss="0.01"/></default>
  </default>
  <worldbody>
    <body name="pedestal" pos="0 0 0.3" euler="0 20 0">
      <geom type="box" size=".1 .1 .1"/>
      <body name="shoulder_motor" pos="0 0 0.05" childclass="rotor">
        <joint name="shoulder_motor" axis="0 0 1"/>
        <geom type="cylinder" size="0.03 0.02" density="7800"/>
      </body>
      <body name="upper">
        <joint name="shoulder" pos="0.01 0 0" axis="0 0 1" range="-120 120" frictionloss="0.3"/>
        <inertial pos="0.2 0 0" mass="4" diaginertia="0.03 0.08 0.09"/>
        <body name="elbow_motor" pos="0.1 0 0.05" euler="30 40 0" childclass="rotor">
          <joint name="elbow_motor" pos="0 0.02 0" axis="2 0 0"/>
          <inertial pos="-0.01 0.02 0" mass="0.2" diaginertia="8e-4 5e-4 5e-4"/>
          <body name="magnet" pos="0.01 0.02 0"><inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/></body>
        </body>
        <body name="fore" pos="0.4 0 0" euler="0 60 10">
          <joint name="elbow" axis="0 1 0.2" stiffness="3" springref="10"/>
          <inertial pos="0.15 0.01 0" mass="2" diaginertia="0.005 0.03 0.03"/>
          <body name="wrist_motor" pos="0.1 0 0" childclass="rotor">
            <joint name="wrist_motor" axis="1 0 0" armature="0.0004"/>
            <inertial pos="0 0 0" mass="0.05" diaginertia="1e-9 1e-9 1e-9"/>
          </body>
          <body name="hand" pos="0.25 0 0">
            <joint name="wrist" axis="1 0 0"/>
            <inertial pos="0.02 0.03 0" mass="0.7" diaginertia="0.002 0.003 0.003"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="s" springlength="0">
      <joint joint="shoulder" coef="50"/><joint joint="shoulder_motor" coef="-1"/>
    </fixed>
    <fixed name="e" springlength="0" stiffness="0.2" damping="0.001">
      <joint joint="elbow_motor" coef="1"/><joint joint="elbow" coef="30"/>
    </fixed>
    <fixed name="w" stiffness="90"><joint joint="wrist" coef="1"/><joint joint="wrist_motor" coef="-0.05"/></fixed>
  </tendon>
  <actuator>
    <motor joint="shoulder_motor" ctrlrange="-4 4" ctrllimited="true"/>
    <motor joint="elbow_motor" gear="0.5" ctrlrange="-4 4" ctrllimited="true"/>
    <motor joint="wrist_motor"/>
  </actuator>
</mujoco>
"""
JOINTS = ("shoulder", "elbow", "wrist")
CYLINDER = np.pi * 0.03**2 * 0.04 * 7800 * 0.03**2 / 2
"""kg·m²; inertia of the shoulder's rotor about its axis."""


def reflected(robot: Robot) -> Robot:
    """Return the robot with reflected inertias in place of its rotors'."""
    joints = []
    for joint in robot.joints:
        values = {("Ja" if key == "Jm" else key): value for key, value in joint.parameters.items()}
        joints.append(replace(joint, gear_ratio=None, parameters=values))
    return replace(robot, joints=tuple(joints))


ROBOTS = {
    "planar2": lambda: read_robot("planar2"),
    "puma560": lambda: read_robot("puma560"),
    "slides, axes of their own, one of them rigid": lambda: random_robot(
        2, 3, "standard", kinds="rrp", own_axes=True, rigid=(2,)
    ),
    "no gear ratios": lambda: reflected(random_robot(7, 3, "modified", kinds="rp")),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_described_robot_comes_back_from_its_mjcf(name: str) -> None:
    robot = ROBOTS[name]()
    full, _ = apart(robot, known_parameters(robot))
    again = robot_from_text(mjcf_text(robot), "robot.xml")
    assert (again.notes, again.effects) == ((), ())
    assert (again.joint_names, again.parents) == (full.joint_names, full.parents)
    for ours, theirs in zip(again.joints, full.joints, strict=True):
        assert (ours.type, ours.gear_ratio, ours.elastic) == (theirs.type, theirs.gear_ratio, theirs.elastic)
        assert ours.limits.position == theirs.limits.position
        assert (ours.limits.torque or 0.0) == pytest.approx(theirs.limits.torque or 0.0, rel=1e-14)
        if theirs.gear_ratio is not None:
            np.testing.assert_allclose(ours.motor_axis, theirs.motor_axis, atol=1e-15)
        size = max(abs(theirs.parameters[key]) for key in LINK_PARAMETERS)
        for key, value in theirs.parameters.items():
            floor = 1e-14 * size if key in LINK_PARAMETERS else 0.0
            assert ours.parameters[key] == pytest.approx(value, rel=1e-14, abs=floor), (ours.name, key)
    joint, found = again.joint_names[0], {} if name == "no gear ratios" else {"gear_ratio": robot.joints[0].gear_ratio}
    assert again.rotors[joint] == (f"{joint}_rotor", found.get("gear_ratio", 1.0))


def test_effects_of_links_and_transmissions_come_back() -> None:
    specs = (
        EffectSpec("link_viscous", "joint1", {"friction": 0.7}),
        EffectSpec("link_coulomb", "joint1", {"friction": 0.2}),
        EffectSpec("transmission_damping", "joint2", {"damping": 3.0}),
    )
    text = mjcf_text(replace(read_robot("planar2"), effects=specs))
    assert "not in this file" not in text
    assert robot_from_text(text, "robot.xml").effects == specs


def test_a_series_elastic_joint_is_read_as_one() -> None:
    robot = robot_from_text(SERIES, "series.xml")
    assert robot.notes == ()
    assert robot.joint_names == JOINTS
    assert [(joint.transmission, joint.elastic) for joint in robot.joints] == [("auto", True)] * 3
    assert [joint.gear_ratio for joint in robot.joints] == [50, -30, None]
    rotors = {"shoulder": ("shoulder_motor", 50), "elbow": ("elbow_motor", -30), "wrist": ("wrist_motor", 20)}
    assert robot.rotors == rotors
    assert robot.links["shoulder_motor"] == "base"
    assert robot.links["elbow_motor"] == robot.links["magnet"] == "shoulder"
    shoulder, elbow, wrist = (joint.parameters for joint in robot.joints)
    drives = {"K": 0.5 * 50**2, "Jm": CYLINDER, "fs": 0.01 * 50, "fv": 0.002 * 50**2}
    assert {key: shoulder[key] for key in drives} == pytest.approx(drives)
    drives = {"K": 0.2 * 30**2, "Jm": 8.1e-4, "fs": 0.01 * 30, "fv": 0.002 * 30**2}
    assert {key: elbow[key] for key in drives} == pytest.approx(drives)
    drives = {"K": 90, "Ja": (0.0004 + 1e-9) * 20**2, "fs": 0.01 * 20, "fv": 0.002 * 20**2}
    assert {key: wrist[key] for key in drives} == pytest.approx(drives)
    assert shoulder["m"] == pytest.approx(4.21)
    assert [joint.limits.torque for joint in robot.joints] == pytest.approx([200, 60, None])
    effects = {(spec.effect, spec.joint): spec.parameters for spec in robot.effects}
    assert effects.pop(("link_spring", "elbow"))["stiffness"] == 3
    assert effects == {
        **{("link_viscous", name): {"friction": 0.05} for name in JOINTS},
        ("link_coulomb", "shoulder"): {"friction": 0.3},
        ("transmission_damping", "elbow"): {"damping": 0.001 * 30**2},
    }
    assert robot.known_ratios("a motor's encoder").tolist() == [50, -30, 20]


def compared(text: str) -> None:
    """Compare accelerations in random states, without friction, damping and springs on links."""
    mujoco = pytest.importorskip("mujoco", reason="needs the wheel mujoco (extra: test)")
    model = mujoco.MjModel.from_xml_string(text)
    model.dof_damping[:] = model.dof_frictionloss[:] = model.jnt_stiffness[:] = model.tendon_damping[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    robot = robot_from_text(text, "series.xml")
    joints = [replace(j, parameters={**j.parameters, "fs": 0.0, "fv": 0.0}) for j in robot.joints]
    robot = replace(robot, joints=tuple(joints), effects=())
    dynamics, data = Dynamics(robot), mujoco.MjData(model)
    names = [robot.rotors[name][0] for name in robot.joint_names]
    turns = np.array([robot.rotors[name][1] for name in robot.joint_names])
    (at, dof), (own, push) = (
        (np.array([model.joint(n).qposadr[0] for n in group]), np.array([model.joint(n).dofadr[0] for n in group]))
        for group in (robot.joint_names, names)
    )
    for q, dq, deflection, slip, tau in np.random.default_rng(4).normal(size=(20, 5, robot.n)):
        theta, dtheta = q + 0.01 * deflection, dq + 0.1 * slip
        data.qpos[at], data.qvel[dof], data.qpos[own], data.qvel[push] = q, dq, theta * turns, dtheta * turns
        data.qfrc_applied[push] = tau / turns
        mujoco.mj_forward(model, data)
        links, motors = dynamics.acceleration(*(x.tolist() for x in (q, dq, theta, dtheta, tau)))
        np.testing.assert_allclose(data.qacc[dof], links, atol=2e-6 * np.abs(links).max())
        np.testing.assert_allclose(data.qacc[push] / turns, motors, atol=2e-6 * np.abs(motors).max())


def test_mujoco_accelerates_the_file_as_elid_does() -> None:
    compared(SERIES)


def changed(robot: Robot) -> Robot:
    """Return the robot with other parameters of bodies, drives, transmissions and effects."""
    joints: list[Joint] = []
    for k, joint in enumerate(robot.joints, start=1):
        kinds = {**dict.fromkeys(LINK_PARAMETERS, 0.1), "Jm": 0.2, "Ja": 0.3, "K": -0.2, "fs": 0.4, "fv": 0.5}
        values = {key: value * (1 + kinds[key] * k) for key, value in joint.parameters.items()}
        joints.append(replace(joint, parameters=values))
    effects = tuple(replace(s, parameters={n: 1.3 * v for n, v in s.parameters.items()}) for s in robot.effects)
    return replace(robot, joints=tuple(joints), effects=effects)


def test_new_parameters_read_back_and_nothing_else_changes(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    robot = read_robot(tmp_path / "series.xml")
    assert patched(robot) == SERIES
    new = changed(robot)
    text = patched(new)
    again = robot_from_text(text, "series.xml")
    for ours, theirs in zip(again.joints, new.joints, strict=True):
        size = max(abs(theirs.parameters[key]) for key in LINK_PARAMETERS)
        for key, value in theirs.parameters.items():
            floor = 1e-12 * size if key in LINK_PARAMETERS else 0.0
            assert ours.parameters[key] == pytest.approx(value, rel=1e-9, abs=floor), (ours.name, key)
        assert (ours.limits, ours.gear_ratio, ours.motor_axis) == (theirs.limits, theirs.gear_ratio, theirs.motor_axis)
    for ours, theirs in zip(again.effects, new.effects, strict=True):
        assert (ours.effect, ours.joint) == (theirs.effect, theirs.joint)
        assert ours.parameters == pytest.approx(theirs.parameters)
    numbers = r'<inertial[^>]*/>|(armature|damping|frictionloss|stiffness|springref)="[^"]*"|\s+'
    assert re.sub(numbers, "", text) == re.sub(numbers, "", SERIES)
    compared(text)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_file_of_elids_own_is_patched_as_others_are(name: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the wheel mujoco (extra: test)")
    robot = ROBOTS[name]()
    (tmp_path / "own.xml").write_text(mjcf_text(robot))
    own = read_robot(tmp_path / "own.xml")
    assert patched(own) == (tmp_path / "own.xml").read_text()
    joints = []
    for k, joint in enumerate(own.joints, start=1):
        drives = {key: 1 + 0.01 * k for key in ("Jm", "Ja", "fs", "fv", "K")}
        joints.append(replace(joint, parameters={n: v * drives.get(n, 1.02) for n, v in joint.parameters.items()}))
    text = patched(replace(own, joints=tuple(joints)))
    assert mujoco.MjModel.from_xml_string(text).nv == 2 * robot.n
    for ours, theirs in zip(robot_from_text(text, "own.xml").joints, joints, strict=True):
        size = max(abs(theirs.parameters[key]) for key in LINK_PARAMETERS)
        for key, value in theirs.parameters.items():
            floor = 1e-12 * size if key in LINK_PARAMETERS else 0.0
            assert ours.parameters[key] == pytest.approx(value, rel=1e-10, abs=floor), (ours.name, key)


def test_of_two_balanced_bodies_the_driven_one_is_the_rotor() -> None:
    wheel = '<body name="{0}"><joint name="{0}" axis="0 0 1"/><geom type="cylinder" size="0.1 0.01"/></body>'
    bench = "<mujoco><worldbody>" + wheel.format("one") + wheel.format("two") + "</worldbody><tendon>"
    bench += '<fixed stiffness="5" springlength="0"><joint joint="one" coef="{0}"/>'
    bench += '<joint joint="two" coef="{1}"/></fixed>'
    bench += "</tendon><actuator>{2}</actuator></mujoco>"
    for levers, drive, rotor, turns in (
        ((1, -0.5), "", "two", 2.0),
        ((-0.5, 1), "", "one", 2.0),
        ((1, -0.5), '<motor joint="one"/>', "one", 0.5),
        ((1, 0.5), '<motor joint="two"/>', "two", -2.0),
    ):
        robot = robot_from_text(bench.format(*levers, drive), "bench.xml")
        (joint,) = robot.joint_names
        assert robot.rotors == {joint: (rotor, turns)}
        assert joint != rotor


def test_a_gear_ratio_beside_the_file_makes_an_armature_a_rotors_own(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    (tmp_path / "series.elid.yaml").write_text("joints: {wrist: {gear_ratio: 20}}")
    robot = read_robot(tmp_path / "series.xml")
    wrist = robot.joint("wrist")
    assert wrist.parameters["Jm"] == pytest.approx(0.0004, rel=1e-4)
    assert wrist.motor_axis == pytest.approx((1, 0, 0))
    assert patched(robot) == SERIES
    joint = replace(wrist, parameters={**wrist.parameters, "Jm": 0.0005})
    assert 'armature="0.000499999"' in patched(replace(robot, joints=(*robot.joints[:2], joint)))


def test_a_rotor_on_a_locked_joint_changes_what_that_is_fixed_to(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    robot = locked(read_robot(tmp_path / "series.xml"), {"shoulder": 0.4, "elbow": -0.3})
    assert patched(robot) == SERIES
    robot = locked(read_robot(tmp_path / "series.xml"), {"elbow": -0.3})
    new = changed(robot)
    again = locked(robot_from_text(patched(new), "series.xml"), {"elbow": -0.3})
    for ours, theirs in zip(again.joints, new.joints, strict=True):
        for key, value in theirs.parameters.items():
            assert ours.parameters[key] == pytest.approx(value, rel=1e-9, abs=1e-12), (ours.name, key)


def test_another_torque_limit_and_no_more_damping_read_back(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    robot = read_robot(tmp_path / "series.xml")
    limits = (70.0, 60.0, 5.0)
    joints = [replace(j, limits=replace(j.limits, torque=t)) for j, t in zip(robot.joints, limits, strict=True)]
    again = robot_from_text(patched(replace(robot, joints=tuple(joints), effects=())), "series.xml")
    assert again.torque_limits == pytest.approx(limits)
    assert again.effects == ()


def test_friction_of_a_link_is_one_with_the_motors_where_the_joint_counts_as_rigid(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    robot = read_robot(tmp_path / "series.xml")
    rigid = folded(replace(robot, joints=tuple(replace(j, transmission="rigid") for j in robot.joints)))
    assert [spec.effect for spec in rigid.effects] == ["link_spring"]
    for stiff, joint in zip(rigid.joints, robot.joints, strict=True):
        assert stiff.parameters["fv"] == pytest.approx(joint.parameters["fv"] + 0.05)
        assert stiff.parameters["fs"] == pytest.approx(joint.parameters["fs"] + 0.3 * (joint.name == "shoulder"))
    assert folded(robot) == robot
    again = robot_from_text(patched(rigid), "series.xml")
    assert [spec.effect for spec in again.effects] == ["link_spring", "transmission_damping"]
    for found, stiff in zip(again.joints, rigid.joints, strict=True):
        assert found.parameters["fv"] == pytest.approx(stiff.parameters["fv"])
        assert found.parameters["K"] == pytest.approx(stiff.parameters["K"])


def test_a_rotor_of_no_inertia_is_refused(tmp_path: Path) -> None:
    (tmp_path / "series.xml").write_text(SERIES)
    robot = read_robot(tmp_path / "series.xml")
    first = replace(robot.joints[0], parameters={**robot.joints[0].parameters, "Jm": -1e-4})
    with pytest.raises(RobotError, match=r"the rotor of shoulder would have an inertia of -0\.0001"):
        patched(replace(robot, joints=(first, *robot.joints[1:])))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name="e" springlength="0"', 'name="e" springlength="0.1"', "at rest its length is 0.1"),
        ('name="e" springlength="0"', 'name="e" springlength="-0.1 0.1"', "at rest its length is -0.1 to"),
        ('name="e" springlength="0"', 'name="e"', "at rest its length is 5.2"),
        ('name="e" springlength="0"', 'name="e" springlength="0 0.1"', "at rest its length is 0 to 0.1"),
        ('name="e" springlength="0"', 'name="e" springlength="0" range="-1 1"', "stops of a transmission"),
        ('name="e" springlength="0"', 'name="e" springlength="0" frictionloss="1"', "frictionloss of a transmission"),
        ('stiffness="0.2"', 'stiffness="0.2 0 3"', "a polynomial as stiffness"),
        ('stiffness="0.2"', 'stiffness="0"', ""),
        ('<joint joint="elbow" coef="30"/>', '<joint joint="elbow" coef="30"/><joint joint="wrist" coef="1"/>', ""),
        ("-0.01 0.02 0", "-0.01 0.03 0", "elbow_motor is not balanced"),
        ("8e-4 5e-4 5e-4", "8e-4 5e-4 6e-4", "elbow_motor is not balanced"),
        ('<motor joint="elbow_motor" gear="0.5"', '<motor joint="elbow" gear="0.5"', "an actuator acts on elbow"),
        ('pos="0 0.02 0" axis="2 0 0"', 'pos="0 0.02 0" axis="2 0 0" stiffness="1"', "has a spring of its own"),
        ('joint="wrist_motor" coef="-0.05"', 'joint="elbow_motor" coef="-0.05"', "coupled to more than one joint"),
    ],
)  # fmt: skip
def test_another_tendon_is_not_read(old: str, new: str, said: str) -> None:
    assert SERIES.count(old) == 1
    robot = robot_from_text(SERIES.replace(old, new), "series.xml")
    assert "elbow_motor" in robot.joint_names
    assert not robot.joint("elbow").elastic
    assert any(note.endswith("tendons are not modelled") for note in robot.notes)
    assert said in " ".join(robot.notes)


HAND = """<mujoco><worldbody><body name="palm"><joint name="turn" axis="0 0 1"/><geom type="box" size=".05 .05 .05"/>
<body pos="0 .03 0"><joint name="left" type="slide" axis="0 1 0"/><geom type="box" size=".01 .01 .03"/></body>
<body pos="0 -.03 0"><joint name="right" type="hinge" axis="1 0 0"/>
<geom type="box" size=".01 .01 .03" pos="0 0 .03"/></body>
</body></worldbody>
<tendon><fixed stiffness="5"><joint joint="left" coef="1"/><joint joint="right" coef="-1"/></fixed></tendon>
<equality><joint joint1="right" joint2="left" polycoef="0 20 0 0 0"/></equality></mujoco>"""


def test_coupled_fingers_are_no_rotors() -> None:
    robot = robot_from_text(HAND, "hand.xml")
    assert robot.joint_names == ("turn", "left", "right")
    first, second = robot.notes
    assert first == "1 tendons are not modelled"
    assert "right follows another joint in the file" in second


CART = """<mujoco><worldbody><body name="mast"><joint name="lift" axis="0 1 0"/><inertial pos="0 0 .2" mass="3"
 diaginertia=".02 .02 .01"/>
<body name="a" pos="0 .2 0"><joint name="lw" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".01 .02 .01"/></body>
<body name="b" pos="0 -.2 0"><joint name="rw" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".01 .02 .01"/></body>
</body></worldbody><equality><joint joint1="lw" joint2="rw" polycoef="0 RATIO 0 0 0"/></equality>
<actuator><motor joint="lift"/><motor joint="rw"/>MORE</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("ratio", "more", "rotors"),
    [("1", "", set()), ("1", '<motor joint="lw"/>', set()), ("4", '<motor joint="lw"/>', set()), ("4", "", {"lw"})],
)
def test_two_wheels_of_a_cart_are_no_joint_with_its_rotor(
    tmp_path: Path, ratio: str, more: str, rotors: set[str]
) -> None:
    """Balanced hinges both: one is the rotor of the other only where a gear is between them and one motor drives."""
    (tmp_path / "cart.xml").write_text(CART.replace("RATIO", ratio).replace("MORE", more))
    assert read_robot(tmp_path / "cart.xml").rotors.keys() == rotors
