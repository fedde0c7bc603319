"""`elid excite --show-stiffness`: a log that refuses a stiffness, the motion that shows it, and a log of that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.motor_side.estimate import motor_side
from elid_cli.estimation.motor_side.result import MotorSideJoint, NextMotion
from elid_cli.experiment.reference import read_reference
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.experiment.stiffness_motion import ACCELERATION, stiffness_motion
from elid_cli.robot.robot import Limits, Robot
from elid_cli.robot.schema import robot_of_yaml

ARM = """
name: arm
gravity: [0, -9.81, 0]
dh: standard
joints:
  - name: shoulder
    a: 0.5
    alpha: 0
    d: 0
    theta: 0
    gear_ratio: 100
    limits: {position: [-2, 2], velocity: 3, acceleration: 25, torque: 300}
    parameters: {m: 12, cx: -3, cy: 0, Izz: 1.2, Jm: 1e-4, fs: 6, fv: 8, K: 9000}
"""


@pytest.fixture(scope="module")
def arm() -> Robot:
    return robot_of_yaml(ARM, "arm.yaml")


def said(arm: Robot, options: SimulationOptions) -> MotorSideJoint:
    """Return what a simulated log of motor position and torque says."""
    log = simulate(arm, replace(options, rate=1000.0, sensors=SensorOptions(noise_db=75, torque_noise_relative=0.001)))
    found = motor_side(arm, replace(log, q=np.full_like(log.q, np.nan)), np.zeros(1, dtype=bool))
    assert found is not None
    return found.joints[0]


def test_what_a_plain_log_refuses_the_motion_shows(arm: Robot) -> None:
    plain = said(arm, SimulationOptions(duration=6.0, seed=3))
    assert plain.verdict == "refused"
    assert "elid excite --robot FILE -o stiffness.csv --show-stiffness shoulder`" in plain.says
    motion = stiffness_motion(arm, ["shoulder"], 6.0)
    assert plain.motion is not None
    assert plain.motion.top == pytest.approx(motion.top)
    shown = said(arm, SimulationOptions(duration=6.0, reference=motion))
    assert shown.verdict == "supported"
    assert shown.stiffness == pytest.approx(9000, rel=0.01)


def test_it_keeps_limits_goes_past_the_antiresonance_and_rests_at_both_ends(arm: Robot) -> None:
    motion = stiffness_motion(arm, ["shoulder:12"])
    assert motion.top == pytest.approx(1.3 * 12)
    assert max(float(share.max()) for share in motion.used.values()) <= 1.0
    t, q, dq, ddq = motion.sampled(1000.0)
    assert np.abs(dq[[0, -1]]).max() < 1e-9
    assert np.abs(np.gradient(q[:, 0], t) - dq[:, 0]).max() < 1e-3 * np.abs(dq).max()
    assert np.abs(np.gradient(dq[:, 0], t) - ddq[:, 0]).max() < 5e-3 * np.abs(ddq).max()
    dither = ddq[:, 0] - motion.slow.evaluate(t)[2][:, 0]
    assert dither[1000:-1000].std() == pytest.approx(ACCELERATION[1], rel=0.1)


def test_numbers_have_no_exponent_and_the_rate_follows_the_highest_line() -> None:
    motion = NextMotion((112.0, 333.0), 141.23, False, "elbow")
    assert "multisine of 110 to 330 N·m" in motion.words
    assert "1 Hz to 141 Hz" in motion.words
    assert "logged at 2825 Hz" in motion.words
    assert motion.option == "elbow:109"
    assert "logged at 1000 Hz" in replace(motion, top=20.0).words


def test_a_fast_multisine_asks_for_one_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    robot, out = tmp_path / "arm.yaml", tmp_path / "stiffness.csv"
    robot.write_text(ARM, encoding="utf-8")
    assert main(["excite", "--robot", str(robot), "-o", str(out), "--show-stiffness", "shoulder:110"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "2860 Hz: t, q, dq, ddq" in told
    assert "motor position and torque at 2860 Hz" in told
    assert "--rate 2860" in told
    assert "1000 Hz" not in told


def test_what_it_cannot_plan_is_said(arm: Robot) -> None:
    unknown = replace(arm, joints=(replace(arm.joints[0], parameters={"m": 12.0}),))
    with pytest.raises(UsageError, match="gives no stiffness") as caught:
        stiffness_motion(unknown, ["shoulder"])
    assert "--show-stiffness shoulder:15" in str(caught.value.hint)
    for words, reason in (("elbow", "no joint 'elbow'"), ("shoulder:fast", "no frequency"), ("shoulder:0", "no freq")):
        with pytest.raises(UsageError, match=reason):
            stiffness_motion(arm, [words])
    weak = replace(arm, joints=(replace(arm.joints[0], limits=Limits((-2.0, 2.0), 3.0, 3.0, 300.0)),))
    with pytest.raises(DataError, match="leave room for a multisine of") as caught:
        stiffness_motion(weak, ["shoulder"])
    assert "default" not in str(caught.value)
    assert "change it in the robot file, such as limits: {acceleration: 6}" in str(caught.value.hint)


def test_default_limits_that_leave_no_room_are_said_to_be_elids(arm: Robot) -> None:
    """A robot file without limits cannot be checked for them: the message says which ones act, and how to set them."""
    without = replace(arm, joints=(replace(arm.joints[0], limits=Limits()),))
    with pytest.raises(DataError, match="leave room for a multisine of") as caught:
        stiffness_motion(without, ["shoulder:53.8"])
    assert "position -1.2 to 1.2 rad (default), velocity 2 rad/s (default), acceleration 8 rad/s² (default)" in str(
        caught.value.detail
    )
    assert "elid's own" in str(caught.value.detail)
    assert "say so in the robot file, such as limits: {acceleration: 16}" in str(caught.value.hint)
    raised = replace(arm, joints=(replace(arm.joints[0], limits=Limits(acceleration=16.0)),))
    assert stiffness_motion(raised, ["shoulder:53.8"]).top > 53.8


def test_the_command_writes_what_simulate_follows(
    arm: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")  # cells do not fold
    robot, out = tmp_path / "arm.yaml", tmp_path / "stiffness.csv"
    robot.write_text(ARM, encoding="utf-8")
    ask = ["excite", "--robot", str(robot), "-o", str(out), "--show-stiffness", "shoulder"]
    assert main(ask) == 0
    told = capsys.readouterr().out
    assert "K of the file" in told
    motion = stiffness_motion(arm, ["shoulder"])
    assert f"1 to {motion.top:.3g} Hz" in told
    t = np.linspace(0.0, 10.0, 500)
    assert np.abs(read_reference(str(out), arm).evaluate(t)[0] - motion.evaluate(t)[0]).max() < 1e-5
    assert main([*ask, "--for", "m1"]) == 2
    assert "--show-stiffness does not go with --for" in capsys.readouterr().err
    assert main([*ask, "--rate", "50"]) == 2
    assert "--rate" in capsys.readouterr().err
