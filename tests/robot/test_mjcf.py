"""MJCF robots against MuJoCo: the same mass matrix and the same bias forces, whatever the file uses to say them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot, robot_from_text
from elid_cli.robot.robot import Limits, Robot

mujoco = pytest.importorskip("mujoco", reason="needs the wheel mujoco (extra: test)")

MODEL = """
<mujoco model="everything">
  <!-- a comment that stays -->
  <compiler eulerseq="XYz"/>
  <option gravity="0.3 0 -9.7"/>
  <default>
    <joint armature="0.02" damping="0.4"/>
    <geom density="700"/>
    <default class="arm">
      <joint frictionloss="0.3" axis="0 1 0"/>
      <motor ctrlrange="-5 5" ctrllimited="true" gear="3"/>
      <default class="wrist"><joint range="-90 45" damping="0.1"/></default>
    </default>
  </default>
  <worldbody>
    <body name="stand" pos="0 0 0.4" euler="10 20 30" childclass="arm">
      <freejoint name="float"/>
      <geom type="box" size="0.1 0.2 0.1"/>
      <body name="upper" pos="0.1 0 0.2" axisangle="1 1 0 35">
        <joint name="lift" pos="0.05 0.01 -0.02" axis="0.3 1 0.2" ref="15"/>
        <joint name="twist" pos="0 0.03 0.1" axis="0 0 1"/>
        <inertial pos="0.02 0.01 0.2" quat="0.9 0.1 0.2 0.3" mass="3" diaginertia="0.03 0.025 0.01"/>
        <body name="bracket" pos="0 0 0.4" xyaxes="0 1 0 -1 0 0.2">
          <geom type="capsule" fromto="0 0 0 0.1 0.2 0.1" size="0.04"/>
          <geom type="ellipsoid" size="0.1 0.05 0.07" pos="0.1 0 0" mass="0.7"/>
          <frame pos="0 0.1 0" euler="0 0 40">
            <geom type="cylinder" size="0.03 0.1" zaxis="1 0 1"/>
            <body name="slider" pos="0.2 0 0" zaxis="0 1 1">
              <joint name="slide" type="slide" class="wrist" ref="0.02" range="-0.1 0.2" limited="true"/>
              <inertial pos="0 0 0.01" mass="0.5" fullinertia="0.002 0.003 0.004 1e-4 -2e-4 3e-4"/>
            </body>
          </frame>
        </body>
        <body name="finger" pos="-0.1 0 0.3" childclass="wrist">
          <joint name="bend"/><site name="tip"/>
          <geom type="sphere" size="0.05" pos="0 0 0.1"/>
        </body>
      </body>
    </body>
    <body name="second" pos="1 0 0"><joint name="other" stiffness="4" springref="20"/><geom type="box" size="0.1 0.1 0.3"/></body>
  </worldbody>
  <actuator><motor class="arm" joint="lift"/><motor joint="bend" gear="2" forcerange="-7 7"/></actuator>
</mujoco>
"""  # noqa: E501


def rigid(robot: Robot) -> Robot:
    """Return the robot with what its file leaves open: no friction, no armature."""
    joints = [replace(j, transmission="rigid", parameters={"Ja": 0, "fs": 0, "fv": 0, **j.parameters})
              for j in robot.joints]  # fmt: skip
    return replace(robot, joints=tuple(joints), effects=())


def held(text: str) -> str:
    """Return the model as elid takes it: its base held, nothing in the way of a comparison."""
    return text.replace('<freejoint name="float"/>', "").replace('stiffness="4"', "")


def compared(robot: Robot, model: object, tolerance: float = 1e-9) -> None:
    """Compare mass matrices and the torques of random motions, friction left out."""
    joints = [model.joint(name) for name in robot.joint_names]
    places, dofs = ([int(adr[0]) for adr in each] for each in ([j.qposadr for j in joints], [j.dofadr for j in joints]))
    data = mujoco.MjData(model)
    dynamics = Dynamics(robot)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, dq, ddq = rng.normal(size=(3, robot.n))
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = q, dq, ddq
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, mass, data.qM) if not hasattr(data, "M") else mujoco.mj_fullM(model, data, mass)
        mass = mass[np.ix_(dofs, dofs)]
        ours = dynamics.mass_matrix(q)
        np.testing.assert_allclose(ours, mass, atol=tolerance * np.abs(mass).max())
        damping = model.dof_damping[dofs] * dq
        friction = np.array([joint.parameters["fs"] for joint in robot.joints]) * np.tanh(dq / dynamics.widths)
        expected = mass @ ddq + data.qfrc_bias[dofs] + damping + friction
        found = dynamics.inverse(q, dq, ddq, q, dq, ddq)[1]
        np.testing.assert_allclose(found, expected, atol=tolerance * np.abs(expected).max())


def test_every_way_to_say_it_means_what_mujoco_reads() -> None:
    robot = robot_from_text(MODEL, "everything.xml")
    assert robot.joint_names == ("lift", "twist", "slide", "bend", "other")
    assert robot.parents == (-1, 0, 1, 1, -1)
    assert "stand is held fixed: free joints are not modelled" in robot.notes
    compared(rigid(robot), mujoco.MjModel.from_xml_string(held(MODEL)))


def test_defaults_classes_limits_and_springs() -> None:
    robot = robot_from_text(MODEL, "everything.xml")
    lift, twist, slide, bend, other = robot.joints
    assert lift.parameters["Ja"] == 0.02
    assert (lift.parameters["fs"], lift.parameters["fv"], bend.parameters["fv"]) == (0.3, 0.4, 0.1)
    assert "fs" not in other.parameters
    assert lift.limits == Limits(torque=15)
    assert bend.limits == Limits(position=(-np.pi / 2, np.pi / 4), torque=14)
    assert slide.limits.position == (-0.1, 0.2)
    assert twist.limits == Limits()
    assert {joint.gear_ratio for joint in robot.joints} == {None}
    assert {joint.transmission for joint in robot.joints} == {"auto"}
    (spring,) = robot.effects
    assert (spring.effect, spring.joint, spring.parameters["stiffness"]) == ("link_spring", "other", 4)
    assert spring.parameters["preload"] == pytest.approx(-4 * np.radians(20))
    assert robot.links["bracket"] == "twist"


def test_a_measured_quadrupeds_model() -> None:
    path = Path(__file__).parents[3] / "shared" / "data" / "go2.xml"
    if not path.is_file():
        pytest.skip("the folder of measured logs is not here")
    robot = read_robot(path)
    assert robot.n == 12
    assert [j.limits.torque for j in robot.joints[:3]] == [23.7, 23.7, 45.43]
    compared(rigid(robot), mujoco.MjModel.from_xml_string(path.read_text().replace("<freejoint />", "")))


def test_includes_are_read_and_their_faults_have_their_file(tmp_path: Path) -> None:
    (tmp_path / "parts.xml").write_text(
        "<mujocoinclude>" + MODEL[MODEL.index("<worldbody>") : MODEL.index("<actuator>")] + "</mujocoinclude>"
    )
    main = MODEL[: MODEL.index("<worldbody>")] + '<include file="parts.xml"/></mujoco>'
    (tmp_path / "arm.xml").write_text(main)
    robot = read_robot(tmp_path / "arm.xml")
    assert robot.n == 5
    compared(rigid(robot), mujoco.MjModel.from_xml_string(held(MODEL)))
    (tmp_path / "arm.elid.yaml").write_text("joints: {lift: {gear_ratio: 10, transmission: elastic}}\n")
    lift = read_robot(tmp_path / "arm.xml").joints[0]
    assert (lift.gear_ratio, lift.elastic, lift.parameters["Jm"]) == (10, True, pytest.approx(2e-4))
    (tmp_path / "parts.xml").write_text(
        "<mujocoinclude><worldbody><body><joint axis='0 0 0'/></body></worldbody></mujocoinclude>"
    )
    with pytest.raises(RobotError, match=r"parts.xml:1: .*axis 0 0 0"):
        read_robot(tmp_path / "arm.xml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<actuator>", '<equality><connect body1="slider" body2="finger" anchor="0 0 0"/></equality><actuator>',
         "body 'slider' to 'finger' closes a loop"),
        ("<actuator>", '<equality><connect body1="finger" anchor="0 0 0"/></equality><actuator>',
         "body 'finger' to 'world' closes a loop"),
        ("<actuator>", '<equality><weld body1="world" body2="finger"/></equality><actuator>',
         "body 'world' to 'finger' closes a loop"),
        ("<worldbody>", '<equality><weld site1="here" site2="tip"/></equality><worldbody><site name="here"/>',
         "site 'here' to 'tip' closes a loop"),
        ('<joint name="bend"/>', '<joint name="bend" type="ball"/>', "type 'ball' is not modelled"),
        ('class="wrist" ref', 'class="hand" ref', "no default class 'hand'"),
        ("<worldbody>", "<worldbody><replicate count='3'/>", "replicate"),
        ("diaginertia", "diagInertia='x' mass='y' fullinertia", "not well-formed"),
        ('mass="3"', 'mass="three"', "not made of numbers"),
    ],
)  # fmt: skip
def test_what_is_not_modelled_is_refused_by_name(old: str, new: str, said: str) -> None:
    assert old in MODEL
    with pytest.raises(RobotError) as caught:
        robot_from_text(MODEL.replace(old, new), "arm.xml")
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 3


def test_what_no_joint_parts_is_no_loop() -> None:
    ties = '<weld body1="stand" body2="world"/><connect body1="upper" body2="bracket" anchor="0 0 0"/>'
    tied = MODEL.replace("<actuator>", f"<equality>{ties}</equality><actuator>")
    assert robot_from_text(tied, "arm.xml").joint_names == robot_from_text(MODEL, "arm.xml").joint_names


def test_meshes_are_weighed_by_mujoco(tmp_path: Path) -> None:
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 0.2) for y in (0, 0.3) for z in (0, 0.4))
    faces = (
        "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
    )
    (tmp_path / "block.obj").write_text(corners + faces)
    text = """<mujoco><asset><mesh file="block.obj"/></asset><worldbody><body>
      <joint name="a" pos="0.1 0 0" axis="0 1 0"/><geom type="mesh" mesh="block"/>
      <body pos="0 0 1"><geom type="sphere" size="0.1"/>
      <body><joint name="b"/><geom type="box" size="0.1 0.1 0.2"/></body></body></body></worldbody></mujoco>"""
    (tmp_path / "arm.xml").write_text(text)
    compared(rigid(read_robot(tmp_path / "arm.xml")), mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")))


def test_gains_of_position_actuators_stand_for_the_drives() -> None:
    body = "<inertial pos='0 0 0.1' mass='1' diaginertia='.1 .1 .1'/>"
    arm = f"<body><joint name='a' axis='0 1 0'/>{body}<body><joint name='b' axis='0 1 0'/>{body}</body></body>"

    def control(*actuators: str) -> object:
        text = f"<mujoco><worldbody>{arm}</worldbody><actuator>{''.join(actuators)}</actuator></mujoco>"
        return robot_from_text(text, "arm.xml").control

    a, b = "<position joint='a' kp='40' kv='1.5'/>", "<position joint='b' kp='30' kv='1'/>"
    assert control(a, b) == {"kp": {"a": 40, "b": 30}, "kd": {"a": 1.5, "b": 1}}
    assert control(a) == control(a, "<motor joint='b'/>") == {}
    # of these the gains at the joint are another matter
    for other in ("kp='30'", "kp='30' dampratio='1'", "kp='30' kv='1' gear='2'"):
        assert control(a, f"<position joint='b' {other}/>") == {}
