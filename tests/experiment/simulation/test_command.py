"""`elid simulate` as a process: files, bytes, JSON, errors."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.ideal import with_ideal_drives
from tests import forked

SHORT = ("--robot", "planar2", "--duration", "0.5")


def elid(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return forked.run(["simulate", *arguments], cwd=cwd)


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


@pytest.mark.parametrize(
    ("told", "sensors"),
    [("2%", SensorOptions(torque_noise_relative=0.02)), ("0.3", SensorOptions(torque_noise=0.3))],
)
def test_torque_noise_is_a_share_or_a_size(tmp_path: Path, told: str, sensors: SensorOptions) -> None:
    robot = read_robot("planar2")
    direct = simulate(robot, SimulationOptions(duration=0.5, sensors=sensors))
    assert elid(*SHORT, "--torque-noise", told, "-o", "log.h5", cwd=tmp_path).returncode == 0
    np.testing.assert_allclose(read_recording([str(tmp_path / "log.h5")], robot).tau, direct.tau, rtol=1e-9, atol=1e-12)
    refused = elid(*SHORT, "--torque-noise", "much", "-o", "log.h5", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--torque-noise: 'much' is not a number" in refused.stderr


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


BARE = """<robot name="bare"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.25 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="50"/></joint></robot>"""


def test_a_bare_urdf_moves_by_its_bodies_alone_where_that_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "bare.urdf").write_text(BARE)
    words = ("--robot", "bare.urdf", "-o", "log.csv", "--duration", "1", "--json")
    refused = elid(*words, cwd=tmp_path)
    assert refused.returncode == 2
    assert "j1 Ja fs fv" in refused.stderr
    assert "bare.elid.yaml (elid init writes it), joints: {j1: {parameters: {Ja: …}}}" in refused.stderr
    assert "--ideal-drives" in refused.stderr
    done = elid(*words, "--ideal-drives", cwd=tmp_path)
    said = "taken as 0, as the description does not give them: j1 Ja fs fv"
    assert done.returncode == 0
    assert said in done.stderr
    assert said in json.loads(done.stdout)["robot_notes"]
    log = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True, deletechars="")
    q, ddq = log["q.j1"], np.gradient(np.gradient(log["q.j1"], log["t"]), log["t"])
    # 0.25 m from the axis: its torque is that of inertia 0.05 + 2·0.25² and of its weight, and nothing else
    expected = (0.05 + 2 * 0.25**2) * ddq - 2 * 9.81 * 0.25 * np.cos(q)
    inner = slice(20, -20)
    assert np.sqrt(np.mean((log["tau.j1"] - expected)[inner] ** 2)) < 0.01 * np.sqrt(np.mean(log["tau.j1"] ** 2))


def test_ideal_drives_leave_what_is_given_and_bodies_that_are_unknown(tmp_path: Path) -> None:
    (tmp_path / "bare.urdf").write_text(BARE.replace('effort="50"/>', 'effort="50"/><dynamics damping="0.7"/>'))
    robot = with_ideal_drives(read_robot(tmp_path / "bare.urdf"))
    assert robot.joints[0].parameters["fv"] == 0.7
    assert "fv" not in robot.notes[-1]
    (tmp_path / "empty.urdf").write_text(re.sub("<inertial>.*</inertial>", "", BARE, flags=re.DOTALL))
    done = elid("--robot", "empty.urdf", "-o", "log.csv", "--ideal-drives", cwd=tmp_path)
    assert done.returncode == 2
    assert "j1 cx cz Iyy\n" in done.stderr
    assert not (tmp_path / "log.csv").exists()
