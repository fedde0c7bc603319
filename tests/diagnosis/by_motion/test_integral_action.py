"""Drives whose position loop has an integral term, told by the motion of a plant that shares no code with elid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.robot.text import text_of
from elid_cli.signals.command_torque import error_integrals
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, KP, NAMES, OFFSET, VISCOUS, moved, robot, written

RATE = 0.8
"""Integral over proportional gain of the second drive, 1/s."""
TRIED = ("integral_action", "link_spring")
"""What imitates the term, where all else was tried by another test."""
TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)


def test_an_integral_term_is_named_and_the_written_robot_has_it(tmp_path: Path) -> None:
    arm, term = robot(tmp_path), np.array([0.0, RATE * KP[1], 0.0])
    recording = moved(6, 7.5, delay=0.002, integral=term, held=np.array([0.0, 0.4, 0.0]))
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "log.h5", recording)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("integral_action", "two")]
    (effect,) = found.effects
    assert effect.parameters["rate"] == pytest.approx(RATE, rel=0.02)
    assert abs(effect.parameters["rate"] - RATE) < 4 * effect.std_error["rate"]
    assert effect.gain > 0.9
    assert not found.unexplained
    truth = TRUTH.copy()
    # what the integrator holds when the log begins, and adds up until the first command acts
    truth[1, 3] -= 0.4 + 0.002 * RATE * KP[1] * recording.commands["q_des"][0, 1]
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - truth) / error).max() < 4
    # the torque that acts is known as well as those of the other drives
    assert found.after.error["two"].relative < 0.02

    # another log of the same machine, whose drive holds something else when it begins
    file = tmp_path / "found.yaml"
    file.write_text(text_of(found.refined))
    again, other = read_robot(file), moved(8, 9.0, delay=0.002, integral=term)
    assert replay(again, recording).mean_abs < 2e-4
    assert replay(again, other).mean_abs < 0.5 * replay(identified_robot(found.before), other).mean_abs
    signals = prepare(read_recording([written(tmp_path, "other.h5", other)], again), again)
    plain = identify(again, signals, EstimateOptions(fit="trajectory"))
    assert plain.drives["two"]["Ja"]["estimate"] == pytest.approx(ARMATURE[1], rel=0.02)
    second = diagnose_motion(again, signals, None, TRIED)
    assert not second.effects
    assert not second.unexplained


def test_a_file_that_drops_the_effect_goes_with_its_file_of_actuators(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm, term = robot(tmp_path), np.array([0.0, RATE * KP[1], 0.0])
    recording = moved(6, 6.0, delay=0.002, integral=term)
    log, file, beside = written(tmp_path, "log.h5", recording), str(tmp_path / "x.xml"), str(tmp_path / "x.json")
    line = ["diagnose", log, "--robot", arm.source, "--write-robot", file, "--write-actuators", beside]
    assert main([*line, "--only", "integral_action"]) == 2  # no MJCF holds it
    assert "cannot hold integral_action of two" in capsys.readouterr().err
    assert main([*line, "--only", "integral_action", "--drop-effects"]) == 0
    assert "integral_action of two; the parameters are those of a fit without" in capsys.readouterr().err
    told = json.loads(Path(beside).read_text())
    assert "integral_action" not in json.dumps(told["effects"])
    assert main(["replay", log, "--robot", file, "--actuators", beside, "--json"]) == 0
    both = json.loads(capsys.readouterr().out)["mean_abs"]
    assert main(["replay", log, "--robot", file, "--json"]) == 0
    assert both < json.loads(capsys.readouterr().out)["mean_abs"]
    # what the others lack is their delay alone, which the file of actuators holds
    again = read_robot(file)
    assert [again.joints[k].parameters["Ja"] for k in (0, 2)] == pytest.approx([ARMATURE[0], ARMATURE[2]], rel=0.02)


def test_drives_of_several_logs_hold_something_else_when_each_begins(tmp_path: Path) -> None:
    arm, term = robot(tmp_path), np.array([0.0, RATE * KP[1], 0.0])
    logs = [
        written(tmp_path, f"{seed}.h5", moved(seed, 7.0, integral=term, held=np.array([0.0, held, 0.0])))
        for seed, held in ((6, 0.4), (8, -0.2))
    ]
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm), None, TRIED)
    assert [(e.effect, e.joint) for e in found.effects] == [("integral_action", "two")]
    (effect,) = found.effects
    assert abs(effect.parameters["rate"] - RATE) < 4 * effect.std_error["rate"] < 0.02
    assert not found.unexplained
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - TRUTH) / error)[:, :3].max() < 4


def test_a_loop_without_an_integral_term_is_given_none(tmp_path: Path) -> None:
    arm = robot(tmp_path)
    for seed in range(2):
        log = written(tmp_path, f"{seed}.h5", moved(20 + seed, 6.0))
        found = diagnose_motion(arm, prepare(read_recording([log], arm), arm), None, TRIED)
        assert not found.effects


def test_replay_adds_up_the_simulated_error_in_all_engines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = robot(tmp_path)
    recording = moved(6, 4.0, integral=np.array([0.0, RATE * KP[1], 0.0]), noise=0.0)
    values = zip(arm.joints, ARMATURE, COULOMB, VISCOUS, strict=True)
    joints = tuple(replace(j, parameters={**j.parameters, "Ja": a, "fs": c, "fv": v}) for j, a, c, v in values)
    offsets = [EffectSpec("torque_offset", name, {"offset": value}) for name, value in zip(NAMES, OFFSET, strict=True)]
    plain = replace(arm, joints=joints, effects=tuple(offsets))
    known = replace(plain, effects=(*offsets, EffectSpec("integral_action", "two", {"rate": RATE})))
    assert replay(plain, recording).error["two"].mean_abs > 5e-3
    whole = replay(known, recording)
    assert whole.error["two"].mean_abs < 3e-5
    parts = replay(known, recording, ReplayOptions(horizon=0.7))  # each part starts with what was added up before it
    assert parts.error["two"].mean_abs < 2e-4
    with monkeypatch.context() as patched:
        patched.setattr("elid_cli.model.rollout_steps.compiled_steps", lambda: None)
        patched.setattr("elid_cli.model.rollout_steps.FEW", 0)
        assert np.abs(replay(known, recording).simulated - whole.simulated).max() < 1e-9
    pytest.importorskip("mujoco")
    other = replay(known, recording, ReplayOptions(engine="mujoco"))
    assert not other.left_out
    assert other.error["two"].mean_abs < 1e-3


def test_integrals_go_on_from_stretch_to_stretch_of_a_file_and_start_afresh_in_the_next(tmp_path: Path) -> None:
    recording = moved(1, 2.0)
    gains = {name: recording.commands[name] for name in ("kp", "q_des")}
    marked = replace(
        recording, sources={"tau": "command"}, segments=(Segment(0, 100), Segment(150, 250), Segment(250, 401, 1))
    )
    found = error_integrals(marked)
    assert found is not None
    dt, q = recording.dt, recording.theta
    held = gains["kp"] * gains["q_des"]
    moved_on = 0.5 * gains["kp"][:-1] * (q[1:] + q[:-1])
    error = dt * (held[:-1] - moved_on)
    assert found[0][99] == pytest.approx(error[:99].sum(axis=0))
    assert found[0][150] == pytest.approx(error[:99].sum(axis=0))
    assert found[0][249] == pytest.approx(error[:99].sum(axis=0) + error[150:249].sum(axis=0))
    assert found[0][250] == pytest.approx(0.0)
    assert found[1][400] == pytest.approx(dt * held[250:400].sum(axis=0))
    assert error_integrals(replace(marked, sources={})) is None


def test_an_integral_term_and_a_late_drive_of_one_joint_are_found_beside_each_other(tmp_path: Path) -> None:
    arm, late = robot(tmp_path), np.array([0.001, 0.005, 0.001])
    recording = moved(7, 6.0, sweep=0.25, delay=late, integral=np.array([0.0, RATE * KP[1], 0.0]))
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "log.h5", recording)], arm), arm))
    named = {(e.effect, e.joint): e for e in found.effects}
    assert named.keys() == {("integral_action", "two"), ("torque_delay", "two")}
    rate, delay = named["integral_action", "two"], named["torque_delay", "two"]
    assert abs(rate.parameters["rate"] - RATE) < 4 * rate.std_error["rate"] < 0.05
    assert delay.parameters["delay"] == pytest.approx(0.005, abs=1e-4)
    assert not found.unexplained


@pytest.mark.parametrize("declared", [0.0, 2.0])
def test_a_declared_integral_term_that_is_wrong_is_told_with_the_right_one(tmp_path: Path, declared: float) -> None:
    arm, rate = robot(tmp_path), 0.0 if declared else 6.0
    recording = moved(6, 6.0, integral=np.array([0.0, rate * KP[1], 0.0]))
    known = replace(arm, effects=(EffectSpec("integral_action", "two", {"rate": declared}),))
    signals = prepare(read_recording([written(tmp_path, "log.h5", recording)], known), known)
    found = diagnose_motion(known, signals, None, TRIED)
    assert [(e.effect, e.joint) for e in found.effects] == [("integral_action", "two")]
    assert found.effects[0].parameters["rate"] == pytest.approx(rate, abs=0.03)
    assert replay(found.refined, recording).mean_abs < 3e-4
