"""--write-robot: only files that exist are named, and what a format cannot hold is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from elid_cli.cli import main
from elid_cli.logs.writing import write_recording
from elid_cli.signals.recording import Recording

ROOT = Path(__file__).parents[2]


ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 -9.81 0"/><worldbody>
<body name="one"><joint name="joint1" axis="0 0 1"/><inertial pos="0.25 0 0" mass="21" diaginertia="1 1 14"/>
<body name="two" pos="0.5 0 0"><joint name="joint2" axis="0 0 1"/>
<inertial pos="0.25 0 0" mass="6" diaginertia="1 1 2"/></body></body></worldbody></mujoco>"""


def test_a_stiffness_that_the_users_mjcf_cannot_hold_is_said(
    noisy: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, arm, out = tmp_path / "log.csv", tmp_path / "arm.xml", tmp_path / "out.xml"
    arm.write_text(ARM)
    write_recording(noisy, log)
    assert main(["identify", str(log), "--robot", str(arm), "--write-robot", str(out), "--json"]) == 0
    said = capsys.readouterr().err
    assert f"left out: {out}: K1, K2: the file's joints are rigid; arm.elid.yaml or a .yaml holds stiffnesses" in said
    assert "K1, K2: the file's joints are rigid" in out.read_text()


def test_a_file_that_could_not_be_written_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = ROOT / "sample_logs" / "planar2_stribeck.h5"
    good, bad = tmp_path / "found.yaml", tmp_path / "found.urdf"
    words = ["diagnose", str(log), "--robot", "planar2", "--only", "stribeck"]
    assert main([*words, "--write-robot", str(bad)]) == 2
    told = capsys.readouterr()
    assert not bad.exists()
    assert str(bad) not in told.out
    assert "this format cannot hold stribeck" in told.err
    assert main([*words, "--write-robot", str(good)]) == 0
    assert f"--robot {good}" in capsys.readouterr().out
