"""Logs without commanded velocities: drives that are told the rate of their positions, or that are told none."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.estimation import commanded_rates
from elid_cli.estimation.commanded_rates import NONE, TOLD, UNSURE, rated
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.trajectory.nearer import Nearer
from elid_cli.logs.checks.commanded import UNTOLD
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare
from tests.diagnosis.by_motion import plant

TRUTH = {"Ja": plant.ARMATURE, "fs": plant.COULOMB, "fv": plant.VISCOUS}


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


@cache
def moved(seed: int, push: plant.Extra | None, *, rates: bool) -> Recording:
    return plant.moved(seed, 5.5, push=push, rates=rates, sweep=0.33)


def written(folder: Path, name: str, *, rates: bool, seed: int = 3, push: plant.Extra | None = None) -> str:
    """Write a log of drives that are told rates or none, without these."""
    log = moved(seed, push, rates=rates)
    commands = {name: values for name, values in log.commands.items() if name != "dq_des"}
    return plant.written(folder, name, replace(log, tau=np.full_like(log.tau, np.nan), dq=None, commands=commands))


@pytest.mark.parametrize("rates", [True, False])
def test_what_drives_are_told_is_what_the_motion_shows(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str], rates: bool
) -> None:
    log, robot, out = (
        written(tmp_path, "bare.h5", rates=rates),
        str(tmp_path / "arm.yaml"),
        str(tmp_path / "found.yaml"),
    )
    write_robot(pendulums, robot)
    assert main(["identify", log, "--robot", robot, "--json", "--write-robot", out]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["log"]["sources"].get("dq_des") == "rate") == rates
    (note,) = (note for note in told["log"]["notes"] if "no dq_des is logged" in note)
    assert note == (TOLD if rates else NONE)
    assert told["settings"].get("dq_des") == ("rate" if rates else None)
    assert any(("kd (dq_des - dq)" if rates else "- kd dq") in note for note in told["log"]["notes"])
    for kind, values in TRUTH.items():
        for name, value in zip(pendulums.joint_names, values, strict=True):
            own = told["settings"]["trajectory"]["joint_parameters"][name][kind]
            assert abs(own["estimate"] - value) < 4 * own["std_error"] < 0.1 * value, (name, kind)

    # also of a robot that declares an effect which no fit of the motion holds in its shape
    written_robot = read_robot(out)
    more = EffectSpec("stribeck", "two", {"amplitude": 1e-3, "velocity": 0.1, "exponent": 2.0})
    write_robot(
        replace(written_robot, effects=(*written_robot.effects, more)), robot_with := str(tmp_path / "more.yaml")
    )
    for described in (out, robot_with):
        assert main(["replay", log, "--robot", described, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["mean_abs"] < 3e-4
    said = ["--map", "dq_des=rate"] if rates else []
    assert main(["identify", log, "--robot", robot, "--write-robot", out, *said]) == 0
    assert (" --map dq_des=rate" in capsys.readouterr().out.splitlines()[-1]) == rates


def test_several_logs_and_two_robots_have_the_rate(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [written(tmp_path, f"{seed}.h5", rates=True, seed=seed) for seed in (3, 4)]
    robot, out = str(tmp_path / "arm.yaml"), str(tmp_path / "found.yaml")
    write_robot(pendulums, robot)
    assert main(["identify", *logs, "--robot", robot, "--json", "--write-robot", out]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["log"]["sources"]["dq_des"] == "rate"
    for name, value in zip(pendulums.joint_names, plant.VISCOUS, strict=True):
        own = told["settings"]["trajectory"]["joint_parameters"][name]["fv"]
        assert abs(own["estimate"] - value) < 5e-3 * value  # the drives' own differences are coarser

    for how in ([], ["--commands", "held"]):
        assert main(["replay", *logs, "--robot", out, "--against", out, "--json", *how]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["before"] == told["after"]
        assert told["after"]["mean_abs"] < 1.5e-4


def test_a_limit_cuts_the_torque_with_the_rate(pendulums: Robot, tmp_path: Path) -> None:
    from elid_cli.logs import read_recording

    joints = (replace(joint, limits=replace(joint.limits, torque=0.5)) for joint in pendulums.joints)
    limited = replace(pendulums, joints=tuple(joints))
    log = [written(tmp_path, "cut.h5", rates=True)]
    asked = read_recording(log, limited, {"dq_des": {"from": "rate"}})
    found = rated(limited, read_recording(log, limited))
    assert np.array_equal(found.tau, asked.tau)
    assert np.mean(np.abs(found.tau) == 0.5) > 0.05


@pytest.mark.parametrize(("by", "at_noise", "note"), [
    (1.0, False, UNSURE), (1.0, True, TOLD), (9.0, False, TOLD), (-1.0, False, NONE), (0.0, True, UNTOLD),
])  # fmt: skip
def test_a_note_says_what_is_taken(
    pendulums: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: float, at_noise: bool, note: str
) -> None:
    from elid_cli.logs import read_recording

    monkeypatch.setattr(commanded_rates, "nearer_by_motion", lambda *logs, **how: Nearer(by, at_noise, (0.0, 0.0)))
    read = read_recording([written(tmp_path, "bare.h5", rates=False)], pendulums)
    told = commanded_rates.with_rates(pendulums, prepare(read, pendulums)).recording
    assert told is not None
    assert [line for line in told.notes if "no dq_des" in line] == [note]
    assert (told.sources.get("dq_des") == "rate") == (note == TOLD)


@pytest.mark.parametrize("near", ["smooth", "loops", "neither"])
def test_rates_are_taken_only_where_nothing_else_comes_as_near(
    pendulums: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, near: str
) -> None:
    """Stairs that no drive was given, or a torque that is held, looked like rates with a delay of many samples."""
    from elid_cli.logs import read_recording

    def nearer(robot: Robot, one: Signals, other: Signals, *, loops: bool = False, known: object) -> Nearer:
        assert one.recording is not None
        asked = "loops" if loops else "smooth" if one.recording.smooth else "held"
        return Nearer(0.0 if asked == near else 9.0, True, (0.0, 0.015))

    monkeypatch.setattr(commanded_rates, "nearer_by_motion", nearer)
    read = read_recording([written(tmp_path, "bare.h5", rates=False)], pendulums)
    told = commanded_rates.with_rates(pendulums, prepare(read, pendulums)).recording
    assert told is not None
    assert (told.sources.get("dq_des") == "rate") == (near == "neither")


def test_what_else_is_missing_is_not_the_rate(pendulums: Robot, tmp_path: Path) -> None:
    from elid_cli.logs import read_recording

    log = written(tmp_path, "sprung.h5", rates=False, push=lambda q, dq, bodies: 2.0 * q)
    told = as_told(pendulums, prepare(read_recording([log], pendulums), pendulums)).recording
    assert told is not None
    assert "dq_des" not in told.sources
    assert not told.commands["dq_des"].any()
    assert TOLD not in told.notes


def test_the_rate_is_taken_where_the_user_says_so(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, robot = written(tmp_path, "none.h5", rates=False), str(tmp_path / "arm.yaml")
    write_robot(pendulums, robot)
    assert main(["identify", log, "--robot", robot, "--map", "dq_des=rate", "--fit", "trajectory", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["log"]["sources"]["dq_des"] == "rate"
    assert any("kd (dq_des - dq)" in note for note in told["log"]["notes"])
    own = told["settings"]["trajectory"]["joint_parameters"]["one"]["fv"]
    assert abs(own["estimate"] - plant.VISCOUS[0]) > 10 * own["std_error"]  # the log is of drives that are told none
