"""What the diagnosis finds in short logs of planar2: nothing in a clean one, the effect by name and joint elsewhere."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.diagnosis.refit import contributions, identified
from elid_cli.diagnosis.search.smooth_curves import residual_rows
from elid_cli.estimation.validation.prediction import validate
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals, prepare
from tests.diagnosis.diagnosis_logs import EFFECTS, Diagnosed, Logs


def test_a_clean_log_gives_no_effect(diagnosed: Diagnosed) -> None:
    found = diagnosed()
    assert (found.effects, found.unexplained, found.also_possible) == ((), (), ())
    assert found.sufficient
    assert all(row.ratio < 1.3 for row in found.rows_before)
    assert not found.triage


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_is_named_on_its_joint(diagnosed: Diagnosed, effect: str) -> None:
    joint, values = EFFECTS[effect]
    found = diagnosed(effect)
    assert [(e.effect, e.joint) for e in found.effects] == [(effect, joint)]
    assert found.effects[0].gain > 0.5
    for name, value in values.items():
        assert found.effects[0].parameters[name] == pytest.approx(value, rel=0.05)
    assert all(row.ratio < 1.3 for row in found.rows_after)
    (part,) = contributions(found)
    assert part.joint == joint
    assert part.with_it < 0.6 * part.without


def test_shape_and_amplitude_have_a_joint_standard_error(diagnosed: Diagnosed) -> None:
    found = diagnosed("stribeck")
    (effect,), state = found.effects, found.state_after
    for name, value in EFFECTS["stribeck"][1].items():
        assert 0 < effect.std_error[name] < 0.05 * value
        assert abs(effect.parameters[name] - value) < 4 * effect.std_error[name]
    (own,) = np.flatnonzero(state.solution.basis == state.place(0).start)
    alone = float(np.sqrt(state.covariance[own, own]))  # at a shape that is taken for known
    assert effect.std_error["amplitude"] > 1.05 * alone


def test_two_effects_are_found_together(diagnosed: Diagnosed) -> None:
    found = diagnosed("stribeck", "load_friction")
    named = {(e.effect, e.joint) for e in found.effects}
    assert named == {("stribeck", "joint1"), ("load_friction", "joint2")}
    assert all(part.with_it < 0.6 * part.without for part in contributions(found))


def test_a_missing_effect_had_moved_the_parameters(diagnosed: Diagnosed, robot: Robot) -> None:
    found = diagnosed("stribeck")
    shifts = {m.name: m for m in found.moved}
    assert abs(shifts["fs1"].deviations) > 5
    assert abs(shifts["fs1"].after - 6.0) < abs(shifts["fs1"].before - 6.0)
    before, after = identified(found.state_before, found.before), identified(found.state_after, found.after)
    assert after.normalised_mean_error() < before.normalised_mean_error()
    fs1 = after.base.names.index("fs1")
    assert after.estimate[fs1] == shifts["fs1"].after
    assert after.verdict[fs1] == "supported"


def test_the_refined_robot_predicts_the_held_out_stretches_exactly_as_reported(
    diagnosed: Diagnosed, log: Logs, robot: Robot, tmp_path
) -> None:
    found = diagnosed("stribeck", "load_friction")
    write_robot(found.refined, tmp_path / "refined.yaml")
    recording = log("stribeck", "load_friction")
    judged = validate(
        read_robot(str(tmp_path / "refined.yaml")),
        prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)),
        found.chosen,
    )
    for joint, error in found.after.items():
        assert judged.error[joint].rms == pytest.approx(error.rms, rel=1e-12)
        assert judged.error[joint].spring_rms == pytest.approx(error.spring_rms, rel=1e-12)


def bumped(log: Logs, robot: Robot) -> Signals:
    """Return a log with a bump of friction at 0.8 rad/s of joint2, which is no effect of the library."""
    recording = log()
    signals = prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate))
    speed = signals.motion.dtheta[:, 1]
    tau = recording.tau.copy()
    tau[:, 1] += np.exp(-(((speed - 0.8) / 0.25) ** 2)) - np.exp(-(((speed + 0.8) / 0.25) ** 2))
    return dataclasses.replace(signals, tau=tau, recording=dataclasses.replace(recording, tau=tau))


def test_a_curve_takes_up_what_no_effect_explains_and_stays_unexplained(log: Logs, robot: Robot) -> None:
    signals = bumped(log, robot)
    only = ("torque_offset",)
    plain = diagnose(robot, signals, DiagnoseOptions(only=only))
    assert (plain.effects, plain.curves) == ((), ())
    assert {(u.joint, u.variable) for u in plain.unexplained} == {("joint2", "dtheta")}
    assert residual_rows(plain.state_after, 1) == "motor"
    found = diagnose(robot, signals, DiagnoseOptions(only=only, lookup=True))
    assert [(e.effect, e.joint) for e in found.curves] == [("lookup", "joint2")]
    assert found.curves[0].parameters["variable"] == 1  # velocity
    assert found.after["joint2"].spring_rms < 0.4 * plain.after["joint2"].spring_rms
    assert found.unexplained == plain.unexplained
    # the straight line stays with friction and stiffness, which keep their values
    values = dict(zip(robot.parameter_names(), found.state_after.standard, strict=True))
    assert values["K2"] == pytest.approx(1800, rel=0.01)
    assert values["fv2"] == pytest.approx(1.0, abs=0.5)


def test_no_curve_where_every_row_is_at_its_floor(diagnosed: Diagnosed, log: Logs, robot: Robot) -> None:
    assert [residual_rows(diagnosed().state_after, k) for k in range(2)] == [None, None]
    signals = prepare(log(), robot, SignalOptions.for_diagnosis(log().rate))
    found = diagnose(robot, signals, DiagnoseOptions(only=("torque_offset",), lookup=True))
    assert found.curves == ()
