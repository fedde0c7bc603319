"""Drives that damp by a filtered velocity, told by the motion of a plant that shares no code with elid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.logs.reading import read_recording
from elid_cli.model.drives import filter_weights
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.robot.text import text_of
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, KD, OFFSET, VISCOUS, moved, robot, written

TIME = 5e-3
"""s."""
TRIED = ("velocity_filter", "torque_delay", "integral_action")


def _filtered(speed: np.ndarray) -> np.ndarray:
    part = 1.0 - np.exp(-DT / TIME)
    return lfilter([part], [1.0, part - 1.0], speed, axis=0)  # type: ignore[no-any-return]


def _without(arm: Robot) -> tuple[EffectSpec, ...]:
    return tuple(spec for spec in arm.effects if spec.effect != "velocity_filter")


TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)


def test_filters_come_along_as_their_equation_says() -> None:
    step, times = 1e-3, np.array([0.0, 2e-4, 5e-3])
    half, ramp, whole, rise = filter_weights(times, step)
    seen, v, gain, fine = np.full(3, 0.3), 1.0, 0.4, 20000
    expected = []
    for k in range(fine):  # by small steps
        now = v + gain * (k + 0.5) / fine
        seen = np.where(times > 0, seen + (now - seen) * -np.expm1(-step / fine / np.maximum(times, 1e-9)), now)
        if k in (fine // 2 - 1, fine - 1):
            expected.append(seen)
    for (at_start, change), found in zip(((half, ramp), (whole, rise)), expected, strict=True):
        np.testing.assert_allclose((1 - at_start) * 0.3 + at_start * v + change * gain, found, rtol=1e-4)


def test_filters_of_velocity_are_named_and_the_written_robot_has_them(tmp_path: Path) -> None:
    arm, recording = robot(tmp_path), moved(6, 7.5, delay=0.002, smoothing=TIME)
    found = diagnose_motion(
        arm, prepare(read_recording([written(tmp_path, "log.h5", recording)], arm), arm), None, TRIED
    )
    assert [(e.effect, e.joint) for e in found.effects] == [("velocity_filter", name) for name in arm.joint_names]
    for effect in found.effects:
        assert abs(effect.parameters["time"] - TIME) < 4 * effect.std_error["time"] + 1e-4
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    z = (found.fit_after.values - TRUTH) / error
    assert np.abs(z[:, 1:]).max() < 5
    np.testing.assert_allclose(found.fit_after.values[:, 0], ARMATURE, rtol=0.06)
    # without them the inertias are too small by kd times the time
    np.testing.assert_allclose(found.fit_before.values[:, 0] - ARMATURE, -KD * TIME, rtol=0.25)

    file, other = tmp_path / "found.yaml", moved(8, 6.0, delay=0.002, smoothing=TIME)
    file.write_text(text_of(found.refined))
    again = read_robot(file)
    assert replay(again, other).mean_abs < 1.3e-4
    # a torque that is computed from the log holds the filter as well, once and not twice
    told = {}
    for name, log in (("exact", other), ("late", replace(other, dq=_filtered(other.dq)))):
        signals = prepare(read_recording([written(tmp_path, f"{name}.h5", log)], again), again)
        told[name] = [validate(one, signals).error for one in (again, replace(again, effects=_without(again)))]
        for joint in again.joint_names:
            assert told[name][0][joint].relative < 0.05
    assert all(told["exact"][1][joint].relative > 2 * told["exact"][0][joint].relative for joint in again.joint_names)
    assert {e.relative < 0.05 for e in found.after.error.values()} == {True}

    in_mujoco, without = (
        replay(one, other, ReplayOptions(engine="mujoco")).mean_abs for one in (again, replace(again, effects=()))
    )
    assert in_mujoco < 0.2 * without  # its steps leave as much as the noise


def test_identify_counts_filters_that_it_does_not_hold(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = robot(tmp_path)
    told = {}
    for name, smoothing in (("plain", 0.0), ("slow", TIME)):
        log = written(tmp_path, f"{name}.h5", moved(6, 7.5, delay=0.002, smoothing=smoothing))
        assert main(["identify", log, "--robot", str(arm.source), "--fit", "trajectory", "--json"]) == 0
        told[name] = json.loads(capsys.readouterr().out)
    assert told["plain"]["settings"]["trajectory"]["velocity_filters"] == {}
    assert told["plain"]["model"] == "sufficient"
    slow = told["slow"]
    assert list(slow["settings"]["trajectory"]["velocity_filters"]) == list(arm.joint_names)
    assert slow["model"] == "insufficient"
    assert any("nearer with a filter of the velocity" in warning for warning in slow["warnings"])
    for name, armature in zip(arm.joint_names, ARMATURE, strict=True):
        value = slow["settings"]["trajectory"]["joint_parameters"][name]["Ja"]
        assert value["estimate"] < 0.9 * armature
        assert abs(value["estimate"] - armature) < 2 * value["std_error"]
        assert told["plain"]["settings"]["trajectory"]["joint_parameters"][name]["Ja"]["std_error"] < 0.02 * armature


@pytest.mark.parametrize(("seed", "time"), [(6, 0.006), (3, 0.004)])
def test_a_filter_of_one_drive_is_its_own_and_the_rest_stays(tmp_path: Path, seed: int, time: float) -> None:
    """Commands were read as smooth beside it, and it was a drive that acts late; or all drives had filters."""
    arm, recording = (
        robot(tmp_path),
        moved(seed, 7.0, delay=0.001, smoothing=np.array([0.0, time, 0.0]), noise=2e-5, sweep=0.3),
    )
    found = diagnose_motion(
        arm, prepare(read_recording([written(tmp_path, "log.h5", recording)], arm), arm), None, TRIED
    )
    assert [(e.effect, e.joint) for e in found.effects] == [("velocity_filter", "two")]
    assert found.effects[0].parameters["time"] == pytest.approx(time, abs=1e-4)  # a step of the plant is 0.25 ms
    np.testing.assert_allclose(found.fit_after.delays, 0.001, atol=2e-5)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - TRUTH) / error).max() < 5
