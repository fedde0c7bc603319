"""The step that `elid excite` names next works, whatever the robot file knows of the robot."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from elid_cli.cli.group import elid as commands

URDF = """\
<robot name="arm">
  <link name="base"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="200" velocity="5"/>{dynamics}
  </joint>
  <link name="upper">{inertial}</link>
</robot>
"""
INERTIAL = (
    '<inertial><origin xyz="0.2 0 0"/><mass value="3"/>'
    '<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def next_of(folder: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(commands, ["excite", "--robot", name, "-o", "traj.csv", "--duration", "4"])
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    (place,) = [k for k, line in enumerate(lines) if line.startswith("Next:")]
    return " ".join(line.strip() for line in lines[place:]).removeprefix("Next: ")


def test_a_robot_without_its_drives_is_simulated_with_ideal_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arm.urdf").write_text(URDF.format(dynamics="", inertial=INERTIAL))
    said = next_of(tmp_path, "arm.urdf", monkeypatch)
    assert said == "elid simulate --robot arm.urdf --reference traj.csv -o try.mcap --ideal-drives"
    assert CliRunner().invoke(commands, shlex.split(said)[1:]).exit_code == 0
    assert (tmp_path / "try.mcap").exists()


def test_a_robot_without_its_bodies_is_recorded_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bare.urdf").write_text(URDF.format(dynamics="", inertial=""))
    assert next_of(tmp_path, "bare.urdf", monkeypatch) == (
        "move the robot along traj.csv and record it, then: elid identify LOG --robot bare.urdf"
    )


def test_a_known_robot_is_simulated_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = next_of(tmp_path, "planar2", monkeypatch)
    assert said == "elid simulate --robot planar2 --reference traj.csv -o try.mcap"
    assert CliRunner().invoke(commands, shlex.split(said)[1:]).exit_code == 0
