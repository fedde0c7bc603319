"""The commands as a shell sees them: excite, --physical, --report and --plot."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.logs import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording


@pytest.fixture(scope="module")
def log(noisy: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run 07.h5"
    write_recording(noisy, path)
    return path


def test_excite_writes_a_trajectory_and_says_what_to_expect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "t.csv"
    line = ["excite", "--robot", "planar2", "-o", str(out), "--duration", "8", "--rate", "50", "--for", "Jm2", "--json"]
    assert main(line) == 0
    answer = json.loads(capsys.readouterr().out)
    table = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    assert len(table) == 401
    assert table["q.joint1"][0] == table["q.joint1"][-1]
    assert answer["aims"] == ["Jm2"]
    assert answer["condition"] > 1
    assert {e["name"] for e in answer["base_parameters"]} >= {"Jm2", "K1"}
    assert all(e["std_error"] > 0 for e in answer["base_parameters"])


def test_excite_refuses_an_aim_that_does_not_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", "--robot", "planar2", "-o", str(tmp_path / "t.csv"), "--for", "Jmm2"]) == 2
    assert "Jm2" in capsys.readouterr().err
    assert not (tmp_path / "t.csv").exists()


def test_physical_parameters_are_told_and_written(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = tmp_path / "built.yaml"
    line = ["identify", str(log), "--robot", "planar2", "--physical", "--write-robot", str(written), "--json"]
    assert main(line) == 0
    physical = json.loads(capsys.readouterr().out)["physical"]
    robot = read_robot(written)
    assert np.isfinite(robot.reference()).all()
    for name, value in zip(robot.parameter_names(), robot.reference(), strict=True):
        assert physical["parameters"][name] == pytest.approx(value, rel=1e-9, abs=1e-12)
    assert physical["loss"] < 0.02
    assert set(physical["origin"].values()) <= {"data", "split", "reference", "assumed"}


def test_the_robot_that_could_be_built_simulates_and_predicts(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = str(tmp_path / "built.yaml")
    assert main(["identify", str(log), "--robot", "planar2", "--physical", "--write-robot", written]) == 0
    assert "decided by" in capsys.readouterr().out
    assert main(["simulate", "--robot", written, "-o", str(tmp_path / "s.csv"), "--duration", "1"]) == 0
    assert main(["validate", str(log), "--robot", written, "--max-error", "3%"]) == 0


def test_the_suffix_chooses_the_robot_files_form(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for suffix, word in ((".urdf", "<robot name="), (".xml", "<mujoco"), (".yaml", "joints:")):
        written = tmp_path / f"mine{suffix}"
        line = ["identify", str(log), "--robot", "planar2", "--physical", "--write-robot", str(written)]
        assert main(line) == 0
        assert f"mine{suffix}" in capsys.readouterr().out
        assert word in written.read_text("utf-8")
    urdf, yaml = (read_robot(tmp_path / f"mine{suffix}").reference() for suffix in (".urdf", ".yaml"))
    np.testing.assert_allclose(urdf, yaml, rtol=1e-9, atol=1e-9)


def test_identify_writes_a_page_and_a_folder_of_figures(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, folder = tmp_path / "page.html", tmp_path / "figures"
    assert main(["identify", str(log), "--robot", "planar2", "--report", str(page), "--plot", str(folder)]) == 0
    capsys.readouterr()
    text = page.read_text("utf-8")
    assert text.startswith("<!doctype html>")
    assert "<svg" in text
    names = {path.stem for path in folder.iterdir()}
    assert {"torque_joint1", "residual_joint2", "spring_joint1", "parameters", "classification", "coverage"} <= names
    assert all(f'id="f-{name}"' in text for name in names)
    assert not [path for path in tmp_path.iterdir() if path.suffix == ".part" or path.name.startswith(".")]


def test_excite_after_a_log_aims_at_what_it_could_not_show(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, other = tmp_path / "result.json", tmp_path / "other.json"
    assert main(["identify", str(log), "--robot", "planar2", "--json", "--report", str(result)]) == 0
    saved = json.loads(capsys.readouterr().out)
    saved["this_log"]["cy2"], saved["this_log"]["Jm1"] = "weak", "not excited"
    result.write_text(json.dumps(saved), "utf-8")
    line = ["excite", "--robot", "planar2", "-o", str(tmp_path / "next.csv"), "--duration", "6", "--json", "--after"]
    assert main([*line, str(result)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["aims"]) >= {"cy2", "Jm1"}
    assert (tmp_path / "next.csv").exists()
    saved["joints"] = ["a", "b"]
    other.write_text(json.dumps(saved), "utf-8")
    assert main([*line, str(other)]) == 2
    assert "joints a, b" in capsys.readouterr().err
    assert main([*line, str(log)]) == 0
    assert json.loads(capsys.readouterr().out)["joints"] == ["joint1", "joint2"]
