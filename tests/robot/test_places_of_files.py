"""A user's MJCF that is written to another folder finds what it includes, and MuJoCo moves what only shapes weigh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.patch import patched
from elid_cli.signals.recording import Recording

ARM = """<mujoco model="arm">
  <include file="parts/defaults.xml"/>
  <compiler angle="radian" meshdir="shapes"/>
  <worldbody>
    <body name="upper"><joint name="one" axis="0 1 0" class="soft"/>
      <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.002"/></body>
  </worldbody>
</mujoco>"""
DEFAULTS = '<mujoco><default><default class="soft"><joint damping="0.1" armature="0.02"/></default></default></mujoco>'


def test_what_is_included_is_named_from_the_new_folder(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    for name in ("own/parts", "other/deep"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "own" / "parts" / "defaults.xml").write_text(DEFAULTS)
    (tmp_path / "own" / "arm.xml").write_text(ARM)
    arm = read_robot(tmp_path / "own" / "arm.xml")
    heavier = replace(arm, joints=(replace(arm.joints[0], parameters={**arm.joints[0].parameters, "fv": 0.3}),))
    there = tmp_path / "other" / "deep" / "arm.xml"
    there.write_text(patched(heavier, folder=there.parent))
    assert 'file="../../own/parts/defaults.xml"' in there.read_text()
    assert 'meshdir="../../own/shapes"' in there.read_text()
    assert read_robot(there).joint("one").parameters["fv"] == pytest.approx(0.3)
    model = mujoco.MjModel.from_xml_path(str(there))
    assert (float(model.dof_damping[0]), float(model.dof_armature[0])) == pytest.approx((0.3, 0.02))
    at_home = patched(heavier, folder=tmp_path / "own")
    assert 'file="parts/defaults.xml"' in at_home
    assert 'meshdir="shapes"' in at_home


def test_bodies_whose_inertia_is_their_shapes_are_replayed_by_mujoco(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file = tmp_path / "rod.xml"
    file.write_text(
        '<mujoco model="rod"><worldbody><geom type="plane" size="1 1 1"/><body name="rod">'
        '<joint name="one" axis="0 1 0" damping="0.2" armature="0.02" frictionloss="0.05"/>'
        '<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" density="1500"/></body>'
        "</worldbody></mujoco>"
    )
    rod = read_robot(file)
    moved = simulate(rod, SimulationOptions(duration=3.0, rate=500.0))
    log: Recording = replace(moved, commands={
        "q_des": moved.q + moved.tau / 50.0, "kp": np.full_like(moved.q, 50.0), "kd": np.zeros_like(moved.q)
    })  # fmt: skip
    own = replay(rod, log).mean_abs
    assert replay(rod, log, ReplayOptions(engine="mujoco", mjcf=str(file))).mean_abs < own + 2e-3


def test_a_reduced_log_is_identified_with_the_robot_that_it_was_reduced_with(tmp_path: Path) -> None:
    urdf = (
        '<robot name="arm"><link name="base"/>{}</robot>'.format("".join(
            f'<link name="l{k}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>'
            f'<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/>'
            f'<child link="l{k}"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>'
            '<limit lower="-3" upper="3" effort="200" velocity="5"/><dynamics damping="0.5" friction="0.3"/></joint>'
            for k, parent in (("1", "base"), ("2", "l1"), ("3", "l2"))
        ))
    )  # fmt: skip
    (tmp_path / "arm.urdf").write_text(urdf)
    arm, log = str(tmp_path / "arm.urdf"), tmp_path / "log.csv"
    assert (
        main(["simulate", "--robot", arm, "--lock", "j3=0", "--ideal-drives", "--duration", "8", "-o", str(log)]) == 0
    )
    assert main(["reduce", str(log), "--robot", arm, "-o", str(tmp_path / "log.npz")]) == 0
    assert main(["identify", str(tmp_path / "log.npz"), "--robot", arm, "--json"]) == 0
