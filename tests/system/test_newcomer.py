"""From a robot's own file and a log to the same file with identified numbers, by elid's own lines: no guess."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.robot.files import read_robot
from tests.system.reproduce.newcomer import CASES, shell, walk

FEW = "--only stribeck"
"""What diagnose is to look for here: the whole library takes a test too long."""
CHOSEN = ("URDF, rosbag2, Stribeck friction", "URDF, another topic", "MJCF, PlotJuggler")
"""Of the cases that the script walks through."""


def quick(line: str) -> tuple[int, str, str]:
    """Run a line of elid, a diagnosis with one effect only."""
    return shell(f"{line} {FEW}" if line.startswith("elid diagnose") and "--only" not in line else line)


@pytest.mark.parametrize("name", CHOSEN)
def test_nothing_has_to_be_guessed(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    case = replace(CASES[name], duration=8.0)
    found = walk(case, tmp_path, quick)
    assert found.guesses == [], found.commands
    assert found.validated
    verbs = [command.split()[1] for command in found.commands]
    assert [v for v in ("init", "identify", "diagnose", "validate") if v in verbs] == (
        ["init", "identify", "diagnose", "validate"] if case.effects else ["init", "identify", "validate"]
    )
    (file,) = found.written
    own, given = read_robot(file), read_robot(tmp_path / case.file)
    assert own.joint_names == given.joint_names
    for joint, truth in zip(own.joints, given.joints, strict=True):
        assert joint.parameters["fv"] == pytest.approx(truth.parameters["fv"], rel=0.1)
        if not case.effects:  # Stribeck friction shares slow motion with Coulomb's
            assert joint.parameters["fs"] == pytest.approx(truth.parameters["fs"], rel=0.03)
    if case.effects:
        assert [spec.effect for spec in read_robot(tmp_path / "arm-refined.yaml").effects].count("stribeck") == 1
