"""Every member of the friction family is told from the others; no prediction sees what it predicts.

The logs are made without elid's simulator: a pendulum's torque from its own formula, solved for the torque that
friction follows.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.friction_family import FrictionFamily, better, friction_family
from elid_cli.errors import DataError, UsageError
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Joint, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare

ROTOR, INERTIA, MOMENT, FS, FV, G = 0.05, 0.4, 1.5, 0.8, 0.3, 9.81
SPEED, RATE, LENGTH = 0.2, 250.0, 24.0
CASES: dict[str, dict[str, float]] = {
    "M1": {},
    "M2": {"static": 0.9},
    "M3": {"motor": 0.05, "external": 0.05},
    "M4": {"static": 0.6, "motor": 0.03, "external": 0.03, "static_motor": 0.04, "static_external": 0.04},
    "M5": {"static": 0.6, "motor": 0.16, "external": 0.02, "static_motor": 0.12, "static_external": 0.02},
    "M6": {"static": 0.6, "motor": 0.16, "external": 0.02, "static_motor": 0.12, "static_external": 0.02,
           "driving": 0.012, "driven": 0.006},
}  # fmt: skip


def pendulum(**changes: float) -> Robot:
    values = {"m": 3.0, "cx": MOMENT, "cy": 0.0, "cz": 0.0, "Izz": INERTIA, "Ja": ROTOR, "fs": FS, "fv": FV}
    joint = Joint("hinge", transmission="rigid", parameters={**values, **changes})
    return Robot("pendulum", (joint,), gravity=(0.0, -G, 0.0))


def log_of(
    values: dict[str, float], seed: int = 0, noise: float = 0.02, speed: float = SPEED, quadratic: float = 0.0
) -> Recording:
    """Return a log of the pendulum under friction of the published form, its torque solved for by repetition.

    `speed` is the Stribeck velocity; friction grows by `quadratic`, N·m·s²/rad², with the square of the speed as well.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(LENGTH * RATE)) / RATE
    q = dq = ddq = np.zeros_like(t)
    for frequency in (0.1, 0.23, 0.41, 0.67):
        w, size, phase = 2 * np.pi * frequency, 0.35 / frequency**0.7, rng.uniform(0, 2 * np.pi)
        q = q + size * 0.4 * np.sin(w * t + phase)
        dq = dq + size * 0.4 * w * np.cos(w * t + phase)
        ddq = ddq - size * 0.4 * w**2 * np.sin(w * t + phase)
    load = INERTIA * ddq + G * MOMENT * np.cos(q)
    direction, e = np.tanh(dq / 5e-3), np.exp(-np.abs(dq) / speed)
    tau = load + ROTOR * ddq
    for _ in range(60):  # friction that follows the torque is part of it
        gear = np.abs(values.get("motor", 0) * tau + values.get("external", 0) * load)
        at_rest = np.abs(values.get("static_motor", 0) * tau + values.get("static_external", 0) * load)
        square = np.where(np.abs(tau) > np.abs(load), values.get("driving", 0) * load**2,
                          values.get("driven", 0) * tau**2) * (tau * load > 0)  # fmt: skip
        friction = FS + FV * np.abs(dq) + quadratic * dq**2 + gear + e * (values.get("static", 0) + at_rest + square)
        tau = load + ROTOR * ddq + direction * friction
    tau = tau + noise * rng.normal(size=len(t))
    q = q + 1e-6 * rng.normal(size=len(t))
    whole = (Segment(0, len(t)),)
    return Recording(("hinge",), 1 / RATE, t, q[:, None], q[:, None], tau[:, None], segments=whole)


def compared(recording: Recording, robot: Robot | None = None) -> FrictionFamily:
    robot = robot or pendulum()
    return friction_family(robot, prepare(recording, robot, SignalOptions.for_diagnosis(RATE)))


@pytest.mark.parametrize("member", CASES)
def test_the_member_that_made_the_log_is_the_one_supported(member: str) -> None:
    found = compared(log_of(CASES[member]))
    assert found.supported == {"hinge": member}
    fits = found.fits["hinge"]
    assert fits[member].error.rms < 1.1 * min(fit.error.rms for fit in fits.values())
    effects = [spec for spec in found.refined.effects if spec.effect == "servo_friction"]
    assert bool(effects) == (member != "M1")


def test_parameters_are_those_of_the_log_and_their_errors_hold_them() -> None:
    found = compared(log_of(CASES["M4"]))
    (spec,) = (spec for spec in found.refined.effects if spec.effect == "servo_friction")
    truth = {**CASES["M4"], "velocity": SPEED, "exponent": 1.0, "model": 4.0}
    for name, value in truth.items():
        assert spec.parameters[name] == pytest.approx(value, rel=0.05, abs=1e-9)
    errors = found.std_error["hinge"]
    assert errors.keys() == {"static", "motor", "static_motor", "velocity"}
    for name, error in errors.items():
        assert 0 < error < 0.1
        assert abs(spec.parameters[name] - truth[name]) < 5 * error
    assert found.refined.joints[0].parameters["fs"] == pytest.approx(FS, abs=0.02)


def test_friction_that_fades_within_a_hundredth_of_the_top_speed_is_found_with_its_form() -> None:
    slow = 0.02
    found = compared(log_of(CASES["M4"], speed=slow, noise=0.005))
    assert found.supported == {"hinge": "M4"}
    (spec,) = (spec for spec in found.refined.effects if spec.effect == "servo_friction")
    errors, truth = found.std_error["hinge"], {**CASES["M4"], "velocity": slow}
    assert spec.parameters["exponent"] == 1.0
    for name, error in errors.items():
        assert abs(spec.parameters[name] - truth[name]) < 4 * error
        assert error < 0.2 * truth[name]
    assert not found.poor


def test_a_rotor_that_the_file_does_not_know_is_written_as_the_friction_under_load_tells_it() -> None:
    known = pendulum()
    joint = known.joints[0]
    parameters = {name: value for name, value in joint.parameters.items() if name not in ("Ja", "Izz")}
    robot = replace(known, joints=(replace(joint, parameters={**parameters, "Izz": 0.7 * INERTIA}),))
    found = compared(log_of(CASES["M3"]), robot)
    assert found.supported == {"hinge": "M3"}
    assert found.refined.joints[0].parameters["Ja"] == pytest.approx(ROTOR, rel=0.1)
    assert found.refined.joints[0].parameters["Izz"] == pytest.approx(INERTIA, rel=0.02)


def test_what_no_member_is_is_said_and_not_made_of_negative_friction() -> None:
    found = compared(log_of(CASES["M1"], quadratic=0.5))
    assert found.fits["hinge"][found.supported["hinge"]].possible
    assert found.poor["hinge"] > 2
    value, error = found.plain["hinge"]["fs"]
    assert value > -2 * error
    assert not compared(log_of(CASES["M1"])).poor


@pytest.mark.parametrize("member", ["M1", "M2", "M3"])
def test_an_offset_of_the_torque_takes_no_member_away(member: str) -> None:
    recording = log_of(CASES[member])
    level, moved = (compared(replace(recording, tau=recording.tau + offset)) for offset in (0.0, 0.4))
    assert moved.supported == {"hinge": member}
    left = [found.fits["hinge"][member].error.rms for found in (level, moved)]
    assert left[1] == pytest.approx(left[0], rel=0.02)


def test_no_prediction_sees_the_torque_that_it_predicts() -> None:
    """Torque of the held-out stretches changes their errors, and no fold, value or member."""
    recording = log_of(CASES["M4"])
    before = compared(recording)
    tau = recording.tau.copy()
    for first, last in before.held_out:
        inside = (recording.t > first + 0.5) & (recording.t < last - 0.5)
        tau[inside] += 3.0 * np.sin(40.0 * recording.t[inside, None])
    after = compared(replace(recording, tau=tau))
    for name, fit in before.fits["hinge"].items():
        other = after.fits["hinge"][name]
        np.testing.assert_allclose(other.folds, fit.folds, rtol=0.02)
        assert other.parameters == pytest.approx(fit.parameters, rel=0.02, abs=1e-3)
        assert other.error.rms > fit.error.rms + 0.2


def test_folds_decide_by_their_ratios_and_scatter() -> None:
    ones = np.ones(6)
    assert better(ones, 0.5 * ones)
    assert not better(ones, 0.98 * ones)  # too little
    assert not better(ones, np.array([0.2, 0.3, 1.9, 2.2, 0.4, 1.5]))  # by chance
    assert not better(ones, ones * np.nan)


def test_a_joint_that_rests_and_a_declared_family_are_refused() -> None:
    recording = log_of(CASES["M1"])
    still = replace(recording, q=0 * recording.q + 0.3, theta=0 * recording.q + 0.3)
    with pytest.raises(DataError):
        compared(still)
    declared = replace(pendulum(), effects=(EffectSpec("servo_friction", "hinge", {"model": 2, "velocity": 0.1}),))
    with pytest.raises(UsageError, match="declares servo_friction itself"):
        compared(recording, declared)


def test_the_command_writes_a_robot_that_predicts_as_the_table_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, robot, out = tmp_path / "log.h5", tmp_path / "robot.yaml", tmp_path / "out.yaml"
    write_recording(log_of(CASES["M5"]), log)
    write_robot(pendulum(), robot)
    words = ["friction", str(log), "--robot", str(robot), "--write-robot", str(out)]
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["friction"]["hinge"]
    assert told["supported"] == "M5"
    assert set(told["members"]) == set(CASES)
    assert main([*words, "--quiet"]) == 0
    assert "Directional friction (M5) at hinge." in capsys.readouterr().out
    found = read_robot(out)
    (spec,) = (spec for spec in found.effects if spec.effect == "servo_friction")
    assert dict(spec.parameters) == pytest.approx(told["parameters"])
    assert main(["validate", str(log), "--robot", str(out), "--json"]) == 0
    error = json.loads(capsys.readouterr().out)["error"]["hinge"]["rms"]
    assert error == pytest.approx(told["members"]["M5"]["error"]["rms"], rel=0.2)
    assert main([*words[:-1], str(tmp_path / "out.xml")]) == 2
