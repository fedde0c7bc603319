"""Drives whose loops run at the log's rate, told by the motion of a plant that shares no code with elid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.logs.reading import read_recording
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.drives import Drives, Joints
from elid_cli.model.linearised import Linearised
from elid_cli.model.rollout_steps import advance, advance_arrays
from elid_cli.model.runs import Run, runs_of
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, KD, KP, VISCOUS, moved, robot, written

NOISE = 3e-5
"""rad."""
TRUTH = {"Ja": ARMATURE, "fs": COULOMB, "fv": VISCOUS}


def told(folder: Path, capsys: pytest.CaptureFixture[str], **how: object) -> dict[str, object]:
    log = written(folder, "log.h5", moved(6, 7.5, noise=NOISE, **how))  # type: ignore[arg-type]
    line = ["identify", log, "--robot", str(robot(folder).source), "--fit", "trajectory", "--json"]
    assert main([*line, "--write-robot", str(folder / "found.yaml")]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def scores(found: dict[str, object]) -> np.ndarray:
    values = found["settings"]["trajectory"]["joint_parameters"].values()  # type: ignore[index]
    return np.array([
        [(own[name]["estimate"] - truth[k]) / own[name]["std_error"] for name, truth in TRUTH.items()]
        for k, own in enumerate(values)
    ])  # fmt: skip


@pytest.mark.parametrize("delay", [0.0, DT])
def test_loops_that_hold_are_found_and_the_written_robot_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], delay: float
) -> None:
    found = told(tmp_path, capsys, once=True, delay=delay)
    held = [item for item in found["nuisances"] if item["effect"] == "held_loop"]  # type: ignore[attr-defined]
    assert [item["joint"] for item in held] == ["one", "two", "three"]
    assert all(item["parameters"]["period"] == pytest.approx(DT) for item in held)
    assert any("loops are simulated at the log's rate" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(scores(found)).max() < 4
    # without, friction and inertia would be too small by this
    assert np.all(0.5 * DT * KP > 0.2 * VISCOUS)
    assert np.all(0.5 * DT * KD > 0.1 * ARMATURE)

    again, other = read_robot(tmp_path / "found.yaml"), moved(8, 6.0, noise=NOISE, once=True, delay=delay)
    assert replay(again, other).mean_abs < 1.1 * NOISE
    assert replay(again, other, ReplayOptions(engine="mujoco")).mean_abs < 10 * NOISE  # its steps of 1 ms
    bare = replace(again, effects=tuple(spec for spec in again.effects if spec.effect != "held_loop"))
    assert replay(bare, other).mean_abs > 5 * NOISE
    slower = tuple(
        replace(spec, parameters={"period": DT / 50}) if spec.effect == "held_loop" else spec for spec in again.effects
    )
    assert not replay(again, other).left_out
    assert replay(replace(again, effects=slower), other).left_out  # no loop that short is simulated
    signals = prepare(read_recording([written(tmp_path, "other.h5", other)], again), again)
    for joint in again.joint_names:
        assert validate(again, signals).error[joint].relative < 0.5 * validate(bare, signals).error[joint].relative


def test_loops_that_act_all_the_time_are_not_called_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(tmp_path, capsys)
    assert not [item for item in found["nuisances"] if item["effect"] == "held_loop"]  # type: ignore[attr-defined]
    assert np.abs(scores(found)).max() < 4
    # the motion is clear about it: no word of what another loop would change
    assert not any("held for a sample" in note for note in found["notes"])  # type: ignore[attr-defined]
    noisy = moved(6, 7.5, noise=3e-3)
    log = written(tmp_path, "noisy.h5", noisy)
    line = ["identify", log, "--robot", str(robot(tmp_path).source), "--fit", "trajectory", "--json"]
    assert main(line) == 0
    warnings = json.loads(capsys.readouterr().out)["warnings"]
    assert any("which this motion does not tell apart" in line for line in warnings)


def test_a_search_has_the_loops_that_the_motion_shows(tmp_path: Path) -> None:
    arm, log = robot(tmp_path), moved(6, 7.5, noise=NOISE, once=True)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("stribeck", "velocity_filter"))
    assert not found.effects
    assert [spec.joint for spec in found.refined.effects if spec.effect == "held_loop"] == list(arm.joint_names)
    np.testing.assert_allclose(found.fit_after.values[:, [0, 2]], np.stack([ARMATURE, VISCOUS], axis=1), rtol=0.01)


@pytest.mark.parametrize("lag", [0.0, 1.3e-3, -2e-4])
def test_loops_and_arrays_step_alike(tmp_path: Path, lag: float) -> None:
    arm, log = robot(tmp_path), moved(1, 1.0, noise=0.0)
    (run,) = runs_of(log, arm, None, np.zeros(3), commanded=True)
    held = _motions(arm, run.holding(np.array([True, False, True]), lag))
    np.testing.assert_allclose(held[0], held[1], atol=1e-12)
    plain = _motions(arm, run.delayed(np.full(3, lag)))
    assert np.abs(held[0] - plain[0])[..., [0, 2]].max() > 1e-4
    np.testing.assert_allclose(held[0][..., 1], plain[0][..., 1], atol=1e-12)


def _motions(arm: Robot, run: Run) -> list[np.ndarray]:
    """Return the motion by loops in plain Python, and by arrays."""
    equations = Linearised(arm, without=("Ja", "fs", "fv"))
    local = equations.about(run.near[:, None], np.gradient(run.near, run.dt, axis=0)[:, None])
    assert coordinates_of(arm).count == 3
    drives = run.drives
    more = (
        None if part is None else part[None, None] for part in (drives.ki, drives.smoothing, drives.held, drives.lag)
    )
    alone = Drives(drives.told[:, None, None], drives.kp[None, None], drives.kd[None, None], drives.limit, *more)
    values = (np.array(part)[None, None, None] for part in (ARMATURE, COULOMB, VISCOUS, np.zeros(3)))
    joints = Joints(*values)
    start = tuple(part[None, None] for part in run.start)
    parts = (local.mass, local.force, local.slope, local.swerve, local.place, local.speed)
    shaped = type(local)(*(part[:, :, None] for part in parts))
    return [step(shaped, start, alone, joints, run.dt)[0] for step in (advance, advance_arrays)]
