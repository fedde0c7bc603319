"""A newcomer with a robot's own file and a log, who types `elid init` and from then on only what elid prints.

    python -m tests.system.reproduce.newcomer

From a URDF or MJCF and a log to the same file with identified numbers: init, identify, diagnose, write, validate. Every
command is the line after ``Next:``, or what the hint of an error adds to the command that failed. A line that cannot be
typed as it stands, or leads nowhere, is a guess that the newcomer would have to make; there must be none.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from elid_cli.cli import main as elid
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.locking import locked
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from tests.system.field_logs import LOGS

LINKS = """  <link name="base"/>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="150" velocity="3"/><dynamics friction="1.5" damping="0.8"/></joint>
  <link name="upper"><inertial><origin xyz="0.2 0 0.02"/><mass value="4"/>
    <inertia ixx="0.02" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint2" type="revolute"><origin xyz="0.4 0 0"/><parent link="upper"/><child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="80" velocity="3"/>
    <dynamics friction="0.9" damping="0.4"/></joint>
  <link name="lower"><inertial><origin xyz="0.15 0 -0.01"/><mass value="2.5"/>
    <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
FINGER = """  <joint name="finger" type="prismatic"><origin xyz="0.3 0 0"/><parent link="lower"/><child link="tip"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.1"/></joint>
  <link name="tip"><inertial><mass value="0.05"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
URDF = f'<robot name="arm">\n{LINKS}</robot>\n'
GRIPPER = f'<robot name="arm">\n{LINKS}{FINGER}</robot>\n'
MJCF = """<mujoco model="arm">
  <worldbody><body name="upper">
    <joint name="joint1" axis="0 1 0" range="-143 143" frictionloss="1.5" damping="0.8" armature="0.3"/>
    <inertial pos="0.2 0 0.02" mass="4" diaginertia="0.02 0.08 0.08"/>
    <body name="lower" pos="0.4 0 0">
      <joint name="joint2" axis="0 1 0" range="-143 143" frictionloss="0.9" damping="0.4" armature="0.3"/>
      <inertial pos="0.15 0 -0.01" mass="2.5" diaginertia="0.01 0.04 0.04"/>
    </body>
  </body></worldbody>
</mujoco>
"""
STRIBECK = EffectSpec("stribeck", "joint1", {"amplitude": -0.8, "velocity": 0.1})
PLACEHOLDERS = re.compile(r"…|\?|\b(LOG|ROBOT|PLACE|HZ|FILE|NAME|TRAJ)\b")
MOST = 10
"""Commands after which nobody goes on."""


@dataclass(frozen=True)
class Case:
    """What somebody has: a robot's file, and a log as a tool writes it, with what the file does not say in it."""

    file: str
    text: str
    log: str
    effects: tuple[EffectSpec, ...] = ()
    duration: float = 16.0
    """s."""


CASES = {
    "URDF, rosbag2, Stribeck friction": Case("arm.urdf", URDF, "rosbag2 mcap", (STRIBECK,)),
    "URDF, another topic": Case("arm.urdf", URDF, "mcap, joint states on another topic"),
    "URDF with a gripper, German export": Case("arm.urdf", GRIPPER, "German export", (STRIBECK,)),
    "MJCF, PlotJuggler": Case("arm.xml", MJCF, "PlotJuggler CSV of arrays"),
    "URDF, HDF5 of an episode": Case("arm.urdf", URDF, "HDF5 of an episode"),
    "URDF, long form": Case("arm.urdf", URDF, "long form", (STRIBECK,)),
}


@dataclass
class Walk:
    """What the newcomer typed, and where elid left them alone."""

    commands: list[str] = field(default_factory=list)
    guesses: list[str] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)
    validated: bool = False


def driven(robot: Robot, effects: tuple[EffectSpec, ...]) -> Robot:
    """Return the true robot: joints rigid, rotors, and what nobody has told."""
    robot = locked(robot, dict.fromkeys(set(robot.joint_names) - {"joint1", "joint2"}, 0.0))
    added = {"Ja": 0.3}
    joints = (replace(j, transmission="rigid", parameters={**j.parameters, **added}) for j in robot.joints)
    return replace(robot, joints=tuple(joints), effects=effects)


def recorded(case: Case, file: Path) -> Recording:
    """Return a log of the true robot."""
    sensors = SensorOptions(position_noise=1e-5, velocity_noise=1e-3, torque_noise_relative=0.01, velocities=True)
    options = SimulationOptions(duration=case.duration, rate=250, sensors=sensors)
    return simulate(driven(read_robot(file), case.effects), options)


def shell(line: str) -> tuple[int, str, str]:
    """Run one line of elid; return its exit code, standard output and standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = elid(shlex.split(line, comments=True)[1:])
    return code, out.getvalue(), err.getvalue()


def walk(case: Case, folder: Path, run: Callable[[str], tuple[int, str, str]] = shell) -> Walk:
    """Follow elid's own lines in a folder, which is the working one, until the robot's file is written and judged."""
    (file := folder / case.file).write_text(case.text)
    log = LOGS[case.log](folder, recorded(case, file)).name
    found, line = Walk(), f"elid init {case.file} {log}"
    while len(found.commands) < MOST and not found.validated:
        found.commands.append(line)
        code, out, err = run(line)
        told = following(line, code, out, err)
        found.written = sorted(p for p in folder.glob("*-*") if p.suffix == file.suffix)
        found.validated = code == 0 and line.startswith("elid validate")
        if told in found.commands or not told.startswith("elid ") or PLACEHOLDERS.search(told):
            if not found.validated:
                found.guesses.append(told or f"nothing after {line!r}: {err.strip()[-200:]}")
            break
        line = told
    if not found.written:
        found.guesses.append("no file of the robot's own kind was written")
    return found


def following(line: str, code: int, out: str, err: str) -> str:
    """Return what elid says to type next, empty where it says nothing."""
    if code == 0:
        _, said, after = " ".join(out.split()).rpartition("Next: ")
        asked = re.findall(r"map it: (\w+: \{.*\})", err)
        if asked and "--map" not in line:
            return f"{line} {shlex.join(w for mapping in dict.fromkeys(asked) for w in ('--map', mapping))}"
        return after.partition(" # ")[0].strip() if said else ""
    hint = err.partition("hint: ")[2].strip()
    if hint.startswith("elid ") and " or " not in hint:
        return hint
    options = re.search(r"--(map|rate|force)\b.*", hint)
    return f"{line} {options[0]}" if options else hint


def main() -> None:
    """Walk through every case and count the guesses."""
    guesses = 0
    for name, case in CASES.items():
        with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
            found = walk(case, Path(place))
        print(name)
        for command in found.commands:
            print(f"  $ {command}")
        for guess in found.guesses:
            print(f"  guess: {guess}")
        print(f"  written: {', '.join(path.name for path in found.written)}")
        guesses += len(found.guesses)
    print(f"{guesses} guesses in {len(CASES)} cases")


if __name__ == "__main__":
    main()
