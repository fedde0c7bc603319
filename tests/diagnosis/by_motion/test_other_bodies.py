"""A diagnosis by motion tells where other bodies than the file's would do as well as an effect."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_report
from elid_cli.report.answers.summary import MISSING
from elid_cli.report.tree import KeyValues
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant


def test_a_lighter_body_is_told_beside_what_imitates_it(tmp_path: Path) -> None:
    log = plant.written(tmp_path, "log.h5", plant.moved(5, 6.0))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    joints = list(robot.joints)
    lighter = {k: 0.8 * v if k in LINK_PARAMETERS else v for k, v in joints[1].parameters.items()}
    joints[1] = replace(joints[1], parameters=lighter)
    wrong = replace(robot, joints=tuple(joints))
    found = diagnose_motion(wrong, prepare(read_recording([log], wrong), wrong), only=("link_spring",))
    assert found.other_bodies.keys() == {"two"}
    assert found.other_bodies["two"] > 0.9
    section = next(s for s in motion_diagnosis_report(found, "pendulums.xml", ()).sections if isinstance(s, KeyValues))
    said = str(dict(section.items)[MISSING])
    assert "Other bodies than pendulums describes would bring the motion of two nearer as well" in said


def test_bodies_that_come_nearer_than_effects_are_told_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], diagnosed_once: None
) -> None:
    path = plant.robot(tmp_path).source
    text = Path(path).read_text()
    # bodies of another mass, at other places: neither a gain nor a spring is the same, nor a load of one of them
    text = text.replace('pos="0 0 -0.2" mass="0.8"', 'pos="0.05 0 -0.12" mass="0.7"')
    Path(path).write_text(text.replace('pos="0 0 -0.15" mass="0.5"', 'pos="0.06 0 -0.1" mass="0.45"'))
    log, out = plant.written(tmp_path, "log.h5", plant.moved(5, 7.0)), str(tmp_path / "found.yaml")
    assert main(["diagnose", log, "--robot", path, "--write-robot", out, "--json", "--fail-on-effect"]) == 1
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert not found["sufficient"]
    assert found["free_bodies"]["mean_abs"] < 0.9 * found["after"]["mean_abs"]
    assert "has the bodies of the file" in said.err
    assert "the bodies are others" in said.err
    assert main(["diagnose", log, "--robot", path]) == 0
    said_so = " ".join(capsys.readouterr().out.split())
    assert "what is missing? Bodies other than pendulums describes" in said_so
    assert "Next: elid identify" in said_so
