"""`elid simulate` as a process: files, bytes, JSON, errors."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot

SHORT = ("--robot", "planar2", "--duration", "0.5")


def elid(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "elid_cli", "simulate", *arguments], cwd=cwd, capture_output=True, text=True, timeout=300
    )


@pytest.mark.parametrize("suffix", ["csv.gz", "h5", "mcap"])
def test_same_seed_same_bytes(tmp_path: Path, suffix: str) -> None:
    noisy = (*SHORT, "--noise-db", "70", "--torque-noise", "1%", "--counts", "65536", "--velocities")
    hashes = []
    for folder, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        (tmp_path / folder).mkdir()
        done = elid(*noisy, "--seed", seed, "-o", f"log.{suffix}", "--json", cwd=tmp_path / folder)
        assert done.returncode == 0, done.stderr
        data = (tmp_path / folder / f"log.{suffix}").read_bytes()
        hashes.append(hashlib.sha256(data).hexdigest())
        assert json.loads(done.stdout)["log"]["sha256"] == [hashes[-1]]
    assert hashes[0] == hashes[1] != hashes[2]


def test_log_reads_back_as_simulated(tmp_path: Path) -> None:
    robot = read_robot("planar2")
    direct = simulate(robot, SimulationOptions(duration=0.5, sensors=SensorOptions(velocities=True)))
    for suffix in ("csv", "h5", "mcap"):
        done = elid(*SHORT, "--velocities", "-o", f"log.{suffix}", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        log = read_recording([str(tmp_path / f"log.{suffix}")], robot)
        for name in ("q", "theta", "tau", "dq", "dtheta"):
            np.testing.assert_allclose(getattr(log, name), getattr(direct, name), rtol=1e-9, atol=1e-12)


def test_report_says_what_acted(tmp_path: Path) -> None:
    effect = "stribeck@joint2:amplitude=-0.2,velocity=0.05"
    done = elid(*SHORT, "-o", "log.csv", "--effect", effect, "--truth", "truth.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "stribeck joint2 amplitude -0.2, velocity 0.05" in done.stdout
    assert done.stdout.rstrip().endswith("elid identify log.csv --robot planar2")
    truth = read_recording([str(tmp_path / "truth.h5")], read_robot("planar2"))
    assert truth.dq is not None
    assert truth.tau_link is not None


def test_gains_of_every_joint_and_of_none(tmp_path: Path) -> None:
    done = elid(*SHORT, "-o", "log.csv", "--kp", "2000,500", "--kd", "60", "--json", cwd=tmp_path)
    motion = json.loads(done.stdout)["simulation"]["motion"]
    assert [motion[j]["kp"] for j in ("joint1", "joint2")] == [2000, 500]
    assert [motion[j]["kd"] for j in ("joint1", "joint2")] == [60, 60]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--robot", "kr300", "-o", "log.csv"), "parameters that its motion depends on are unknown"),
        ((*SHORT, "-o", "log.txt"), "cannot tell the log format"),
        ((*SHORT, "-o", "nowhere/log.csv"), "no folder"),
        ((*SHORT, "-o", "log.csv", "--effect", "stribek@joint1:amplitude=1"), "did you mean 'stribeck'?"),
        (
            (*SHORT, "-o", "log.csv", "--effect", "stribeck@joint1:amplitude=1,velocity=0.1,width=3"),
            "unknown parameter 'width'",
        ),
        ((*SHORT, "-o", "log.csv", "--effect", "stribeck@joint1:amplitude=x"), "amplitude"),
        ((*SHORT, "-o", "log.csv", "--kp", "1,2,3"), "3 values for 2 joints"),
        ((*SHORT, "-o", "log.csv", "--effect", "link_spring@joint1:stiffness=-9e4,preload=0"), "runs away"),
        (("--robot", "planar2", "--duration", "0.0001", "-o", "log.csv"), "two samples"),
        ((*SHORT, "-o", "log.csv", "--reference", "none.csv"), "none.csv: no such file"),
    ],
)
def test_errors_are_three_lines_and_leave_no_file(tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    done = elid(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) <= 3
    assert list(tmp_path.iterdir()) == []
