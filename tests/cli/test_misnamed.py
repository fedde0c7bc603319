"""Joints that a mapping, a log and a robot call by different names: what the error says is missing, and of which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.logs.writing import write_recording
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.write import urdf_text
from elid_cli.signals.recording import Recording, Segment

BODY = {"m": 2.0, "cx": 0.2, "cy": 0.0, "cz": 0.0, "Ixx": 0.01, "Iyy": 0.1, "Izz": 0.1, "Ixy": 0.0, "Ixz": 0.0,
        "Iyz": 0.0}  # fmt: skip
NAMES = ("rail", "arm", "wrist")


@pytest.fixture
def robot(tmp_path: Path) -> str:
    """Return the URDF of a robot of three joints: those of a URDF that a log does not hold are locked."""
    joints = tuple(Joint(name, xyz=(0.4 * (k > 0), 0.0, 0.0), transmission="rigid", gear_ratio=1.0, parameters=BODY)
                   for k, name in enumerate(NAMES))  # fmt: skip
    (tmp_path / "gantry.urdf").write_text(urdf_text(Robot("gantry", joints, dh="urdf")))
    return str(tmp_path / "gantry.urdf")


def motion() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(600) / 200.0
    return t, np.stack([0.2 * np.sin((2.0 + k) * t) for k in range(3)], axis=1)


@pytest.fixture
def columns(tmp_path: Path) -> str:
    t, q = motion()
    head = "Zeit,X_Ist,A_Ist,B_Ist,X_Moment,A_Moment,B_Moment"
    np.savetxt(tmp_path / "run.csv", np.column_stack([t, q, np.cos(q)]), delimiter=",", header=head, comments="")
    return str(tmp_path / "run.csv")


@pytest.mark.parametrize("command", ["identify", "info"])
@pytest.mark.parametrize("unit", ["[mm, deg, deg]", "deg"])
def test_a_misnamed_column_is_named_and_not_what_follows_from_it(
    robot: str, columns: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, unit: str
) -> None:
    named = "joints: {rail: Q, arm: A, wrist: B}"
    file = tmp_path / "map.yaml"
    file.write_text(f't: {{from: Zeit}}\nq: {{from: "{{joint}}_Ist", {named}, unit: {unit}}}\n'
                    'tau: {from: "{joint}_Moment", joints: {rail: X, arm: A, wrist: B}}\n')  # fmt: skip
    assert main([command, columns, "--robot", robot, "--map", str(file)]) == 2
    err = capsys.readouterr().err
    assert "map.yaml:2: q of rail: the log has no 'Q_Ist'\n  hint: did you mean 'X_Ist'?" in err
    assert "locked" not in err


def array_log(path: Path, *names: str) -> str:
    t, q = motion()
    segments = (Segment(0, len(t)),)
    write_recording(Recording(names, 1 / 200.0, t, q, q, np.cos(q), segments=segments), path)
    return str(path)


def test_a_mapped_name_that_an_array_does_not_have_is_named(
    robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = array_log(tmp_path / "run.h5", "x1", "a1", "b1")
    line = "{from: /%s, joints: {rail: q9, arm: a1, wrist: b1}}"
    mapped = [f"--map={signal}: {line % signal}" for signal in ("q", "theta", "tau")]
    assert main(["identify", log, "--robot", robot, *mapped]) == 2
    assert "q of rail: /q names x1 a1 b1, not 'q9'" in capsys.readouterr().err


def test_a_log_of_other_joints_says_so_first(robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own, other = array_log(tmp_path / "own.h5", *NAMES), array_log(tmp_path / "other.h5", "turn", "swing", "bend")
    assert main(["identify", own, other, "--robot", robot]) == 3
    detail = capsys.readouterr().err.partition("other.h5: no position for rail\n")[2]
    assert detail.startswith("  the log's joints are turn, swing, bend; those of 'gantry' are rail, arm, wrist; ")
    assert "joints: {rail: turn, arm: swing, wrist: bend}" in detail


def test_one_joint_of_another_name_says_so_first(
    robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own, other = array_log(tmp_path / "own.h5", *NAMES), array_log(tmp_path / "other.h5", "rail", "swing", "wrist")
    assert main(["identify", own, other, "--robot", robot]) == 3
    detail = capsys.readouterr().err.partition("other.h5: no position for arm\n")[2]
    assert detail.startswith("  the log's joints are rail, swing, wrist; those of 'gantry' are rail, arm, wrist; ")
    assert "arm: swing" in detail
