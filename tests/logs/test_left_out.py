"""Parts of a log that its user wants left out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli import LogRequest, UsageError, identify_logs, read_recording
from elid_cli.cli import main
from elid_cli.robot.files import read_robot

LOG = str(Path(__file__).parents[2] / "sample_logs" / "planar2.h5")
PLANAR = read_robot("planar2")


def test_what_is_left_out_is_gone_and_time_goes_on_as_in_the_log() -> None:
    whole = read_recording([LOG], PLANAR)
    part = read_recording([LOG], PLANAR, {"leave_out": [[0, 1.5], [6, 6.4]]})
    assert part.t[0] == pytest.approx(1.501)
    away = (whole.t < 1.5005) | ((whole.t > 5.9995) & (whole.t < 6.4005))
    assert np.array_equal(part.t, whole.t[~away])
    assert np.array_equal(part.tau, whole.tau[~away])
    assert len(part.segments) == 2
    assert "left out as asked: 0 to 1.5 s, 6 to 6.4 s" in part.repairs


def test_two_ways_of_asking_are_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answers = []
    given = tmp_path / "map.yaml"
    given.write_text("leave_out: [[6, 6.4]]\n", "utf-8")
    for more in (["--leave-out", "6:6.4"], ["--map", "leave_out: [[6, 6.4]]"], ["--map", str(given)]):
        assert main(["identify", LOG, "--robot", "planar2", "--json", *more]) == 0
        answers.append(json.loads(capsys.readouterr().out)["base_parameters"])
    assert answers[0] == answers[1] == answers[2]
    assert main(["identify", LOG, "--robot", "planar2", "--leave-out", "6:6.4", "--leave-out", "8:9"]) == 0
    assert "--leave-out 6:6.4 --leave-out 8:9" in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--leave-out", "6"], "write START:STOP"),
        (["--leave-out", "7:6"], "ends before it starts"),
        (["--leave-out", "-1:6"], "less than 0"),
        (["--leave-out", "20:21"], "the log ends at 12 s"),
        (["--leave-out", "6:6.4", LOG], "of 2 logs"),
        (["--map", "leave_out: [6, 7]"], "expected a start and an end"),
        (["--map", "leave_out: [[7, 6]]"], "no part of a log"),
        (["--map", "leave_ou: [[6, 7]]"], "leave_out"),
        (["--map", "leave_out: {from: a}", "--leave-out", "6:7"], "expected a start and an end"),
    ],
)
def test_what_cannot_be_left_out_is_said(capsys: pytest.CaptureFixture[str], more: list[str], words: str) -> None:
    assert main(["identify", LOG, "--robot", "planar2", *more]) == 2
    assert words in capsys.readouterr().err


def test_parts_of_several_logs_are_refused_in_python_too() -> None:
    mapping = {"leave_out": [[6, 7]]}
    with pytest.raises(UsageError, match="of 2 logs"):
        identify_logs(LogRequest((LOG, LOG), PLANAR, mapping=mapping))
    with pytest.raises(UsageError, match="of 2 logs"):
        read_recording([LOG, LOG], PLANAR, mapping)


def test_nothing_is_left_out_of_other_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = tmp_path / "short.csv"
    whole = read_recording([LOG], PLANAR)
    table = np.column_stack([whole.t, whole.q, whole.theta, whole.tau])[:4000]
    names = ",".join(f"{signal}.joint{k}" for signal in ("q", "theta", "tau") for k in (1, 2))
    np.savetxt(short, table, delimiter=",", header=f"t,{names}", comments="")
    asked = ["diagnose", LOG, "--robot", "planar2", "--leave-out", "6:6.4", "--check", str(short), "--json"]
    assert main([*asked, "--only", "stribeck"]) == 0
    captured = capsys.readouterr()
    assert len(json.loads(captured.out)["checks"]) == 1
    assert captured.err.count("left out as asked") == 1


def test_a_robot_file_leaves_nothing_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = tmp_path / "arm.yaml"
    text = (Path(__file__).parents[2] / "robots" / "planar2.yaml").read_text("utf-8")
    robot.write_text(f"{text}\nlog:\n  leave_out: [[6, 7]]\n", "utf-8")
    assert main(["identify", LOG, "--robot", str(robot)]) == 2
    assert "is of one log, not of a robot" in capsys.readouterr().err


def test_recordings_of_a_trend_are_several_logs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trend", LOG, LOG, LOG, "--robot", "planar2", "--leave-out", "6:6.4"]) == 2
    assert "of 3 logs" in capsys.readouterr().err
