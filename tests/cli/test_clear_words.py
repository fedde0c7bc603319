"""What a newcomer meets in replay, trend, init and the trajectory fit: one clear message, and the right unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import write_robot
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import Recording, Segment

BODY = {"m": 1.0, "cx": 0.0, "cy": 0.0, "cz": 0.0, "Ixx": 0.01, "Iyy": 0.02, "Izz": 0.02, "Ixy": 0.0, "Ixz": 0.0,
        "Iyz": 0.0, "Ja": 0.02, "fs": 0.05, "fv": 0.2}  # fmt: skip


@pytest.fixture
def machine(tmp_path: Path) -> tuple[Path, Path, Robot]:
    """Return a log of a sliding and a turning joint that follow commands closely, the robot's file and the robot."""
    joints = (Joint("lift", type="prismatic", transmission="rigid", parameters=BODY),
              Joint("turn", transmission="rigid", parameters=BODY))  # fmt: skip
    robot = Robot("both", joints, gravity=(0.0, 0.0, 0.0))
    t = np.arange(600) / 200.0
    q = np.stack([0.1 * np.sin(3 * t), 0.2 * np.sin(2 * t)], axis=1)
    gains = {"kp": np.full_like(q, 200.0), "kd": np.full_like(q, 5.0)}
    commands = {"q_des": q + 1e-3, "dq_des": np.gradient(q, t, axis=0), "tau_ff": np.zeros_like(q), **gains}
    recording = Recording(("lift", "turn"), 1 / 200.0, t, q, q, np.full_like(q, np.nan), commands=commands,
                          segments=(Segment(0, 600),))  # fmt: skip
    log, file = tmp_path / "run.h5", tmp_path / "both.yaml"
    write_recording(recording, log)
    write_robot(robot, file)
    return log, file, robot


def said(words: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what a command prints, with single spaces."""
    assert main(words) == code
    told = capsys.readouterr()
    return " ".join((told.out + told.err).split())


def test_turning_and_sliding_joints_have_no_common_average(
    machine: tuple[Path, Path, Robot], capsys: pytest.CaptureFixture[str]
) -> None:
    log, file, _ = machine
    words = said(["replay", str(log), "--robot", str(file)], 0, capsys)
    assert "mm (lift) and" in words
    assert "mrad (turn) on average." in words
    assert "farther off" not in words
    words = said(["replay", str(log), "--robot", str(file), "--max-error", "0.001mrad"], 1, capsys)
    assert "exceeds --max-error 0.001 mrad or mm" in words
    for limit, told in (
        ("1parsec", "'1parsec' is no distance; write 5mrad"), ("1", "1 would be 1 rad, or m; write 1mrad, 1deg or 1mm"),
        ("1e999", "'1e999' is no distance"), ("-5mrad", "'-5mrad' is no distance"),
    ):  # fmt: skip
        assert told in said(["replay", str(log), "--robot", str(file), "--max-error", limit], 2, capsys)
    words = said(["replay", str(log), "--robot", str(file), "--max-error", "0.0000001"], 1, capsys)
    assert "exceeds --max-error 0.0001 mrad or mm" in words


def test_a_replay_that_has_nothing_to_do_with_the_log_says_so(
    machine: tuple[Path, Path, Robot], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, _, robot = machine
    turn = replace(robot.joints[1], parameters={**BODY, "fs": -5.0})
    write_robot(replace(robot, joints=(robot.joints[0], turn)), tmp_path / "pushed.yaml")
    other = tmp_path / "shifted.h5"
    recording = read_recording([log], robot)
    moved = recording.commands["q_des"] + np.array([0.0, 1.0])
    write_recording(replace(recording, commands={**recording.commands, "q_des": moved}), other)
    words = said(["replay", str(other), "--robot", str(tmp_path / "both.yaml")], 0, capsys)
    assert "turn: farther off than a joint that stands still would be" in words
    words = said(["replay", str(log), "--robot", str(tmp_path / "pushed.yaml")], 2, capsys)
    assert "fs2 of turn is -5: friction brakes" in words


def test_choices_that_exclude_each_other_are_refused(
    machine: tuple[Path, Path, Robot], capsys: pytest.CaptureFixture[str]
) -> None:
    log, file, _ = machine
    for other in (["--accurate"], ["--estimator", "paper"]):
        words = said(["identify", str(log), "--robot", str(file), "--fit", "trajectory", *other], 2, capsys)
        assert f"--fit trajectory and {' '.join(other)} exclude each other" in words


def test_trend_and_init_name_what_was_given(
    machine: tuple[Path, Path, Robot], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file, _ = machine
    assert "is a folder hint: give its files:" in said(["trend", str(tmp_path)], 2, capsys)
    assert "needs --robot hint: elid trend" in said(["trend", str(log)], 2, capsys)
    assert "gone.csv: no such file" in said(["trend", str(tmp_path / "gone.csv")], 3, capsys)
    assert f"is a log; the robot's file comes first hint: elid init {file} {log}" in said(
        ["init", str(log), str(file)], 2, capsys
    )
    assert main(["identify", str(log), "--robot", str(file), "--json", "--quiet"]) == 0
    result = tmp_path / "one.json"
    result.write_text(capsys.readouterr().out, "utf-8")
    assert "1 recording is given, at least 3 are needed" in said(["trend", str(result)], 2, capsys)
    assert f"hint: elid compare {result} {result}" in said(["trend", str(result), str(result)], 2, capsys)


def test_a_faulty_log_block_is_named_by_file_and_line_with_and_without_a_log(
    machine: tuple[Path, Path, Robot], capsys: pytest.CaptureFixture[str]
) -> None:
    log, file, _ = machine
    sound = file.read_text()
    line = len(sound.splitlines()) + 3
    file.write_text(f"{sound}log:\n  q:\n    form: /q\n")
    for words in (["classify"], ["identify", str(log)]):
        assert f"both.yaml:{line}: q: unknown key 'form'" in said([*words, "--robot", str(file)], 2, capsys)
    file.write_text(f"{sound}log:\n  q: {{from: [a, b, c]}}\n")
    assert f"both.yaml:{line - 1}: q: from: 3 places for 2" in said(["classify", "--robot", str(file)], 2, capsys)


def test_hints_name_the_robot_as_it_was_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file's name is not that of the robot in it."""
    known = {name: value for name, value in BODY.items() if name != "fs"}
    robot = Robot("both", (Joint("turn", transmission="rigid", parameters=known),))
    t = np.arange(600) / 200.0
    q = 0.2 * np.sin(2 * t)[:, None]
    recording = Recording(("turn",), 1 / 200.0, t, q, q, np.cos(2 * t)[:, None], segments=(Segment(0, 600),))
    log, file = tmp_path / "run.h5", tmp_path / "my robot.yaml"
    write_recording(recording, log)
    write_robot(robot, file)
    told = said(["validate", str(log), "--robot", str(file)], 2, capsys)
    assert f"--robot '{file}' --write-robot both-identified.yaml" in told


@pytest.mark.parametrize("cutoff", ["100", "1000"])
def test_a_cut_off_that_filters_nothing_is_refused(
    machine: tuple[Path, Path, Robot], capsys: pytest.CaptureFixture[str], cutoff: str
) -> None:
    log, file, _ = machine
    words = ["identify", str(log), "--robot", str(file), "--cutoff", cutoff]
    told = said(words, 2, capsys)
    assert f"--cutoff {cutoff}: the log's 200 Hz hold nothing above 100 Hz" in told
    assert "hint: less than 100, or leave it out" in told
