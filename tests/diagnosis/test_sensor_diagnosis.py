"""Diagnosis with joint torque sensors: faults of the sensor, of the motor and of the spring each have their row."""

from __future__ import annotations

from functools import cache

import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.estimation.sensor_logs import STRIBECK, logged, planar, without_sensors

PLANAR = planar()
CASES: dict[str, dict[str, object]] = {
    "gain": {"gain": (0.0, 0.05)},
    "offset": {"offset": (2.0, 0.0)},
    "stribeck": {"stribeck": STRIBECK},
    "hysteresis": {"hysteresis": 4.0},
}


def diagnosed(log: Recording) -> Diagnosis:
    return diagnose(PLANAR, prepare(log, PLANAR, SignalOptions.for_diagnosis(log.rate)))


@cache
def case(name: str) -> Diagnosis:
    return diagnosed(logged(**CASES.get(name, {})))  # type: ignore[arg-type]


def highest(found: Diagnosis) -> tuple[str, str]:
    row = max(found.rows_before, key=lambda row: row.ratio)
    return row.joint, row.rows


def test_a_clean_log_is_quiet() -> None:
    found = case("clean")
    assert found.sufficient
    assert not found.effects
    assert {row.rows for row in found.rows_before} == {"load", "drive", "spring"}
    assert all(0.8 < row.ratio < 1.3 for row in found.rows_before)


@pytest.mark.parametrize(
    ("name", "effect", "joint", "value"),
    [
        ("gain", "sensor_gain", "joint2", {"gain": 0.05}),
        ("offset", "sensor_offset", "joint1", {"offset": 2.0}),
        ("stribeck", "stribeck", "joint1", {}),
        ("hysteresis", "hysteresis", "joint1", {"torque": 4.0, "distance": 1e-3}),
    ],
)
def test_each_fault_is_named_alone_with_its_size(name, effect, joint, value) -> None:
    found = case(name)
    assert [(e.effect, e.joint) for e in found.effects] == [(effect, joint)]
    assert found.effects[0].gain > 0.5
    for key, size in value.items():
        assert found.effects[0].parameters[key] == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize(
    ("name", "rows"),
    [("stribeck", "drive"), ("hysteresis", "spring"), ("gain", "drive")],
)
def test_a_fault_lies_in_its_own_row(name, rows) -> None:
    joint = case(name).effects[0].joint
    assert highest(case(name)) == (joint, rows)
    assert all(row.ratio < 1.6 for row in case(name).rows_before if row.rows == "load" and row.joint != joint)


def test_without_its_reading_a_sensors_fault_is_no_fault() -> None:
    assert not diagnosed(without_sensors(logged(gain=(0.0, 0.05)))).effects


def test_the_refined_robot_predicts_the_sensor_on_held_out_stretches() -> None:
    found = case("gain")
    before, after = (errors["joint2"].sensor for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    # before, the zero of the motor's torque channel takes what the gain makes of the mean load
    assert after.drive_rms < 0.65 * before.drive_rms
    again = validate(found.refined, found.state_after.log.raw, found.chosen).error["joint2"].sensor
    assert again == after


def test_simulated_sensors_err_as_the_effects_say() -> None:
    robot = found_robot = case("gain").refined
    assert any(spec.effect == "sensor_gain" for spec in found_robot.effects)
    log = simulate(robot, SimulationOptions(duration=0.5, rate=250.0, sensors=SensorOptions(tau_link=True)))
    assert log.tau_link is not None
    ideal = simulate(planar(), SimulationOptions(duration=0.5, rate=250.0, sensors=SensorOptions(tau_link=True)))
    assert ideal.tau_link is not None
    ratio = (log.tau_link / ideal.tau_link)[50:]
    assert ratio[:, 1].mean() == pytest.approx(1.05, abs=0.02)
    assert ratio[:, 0].mean() == pytest.approx(1.0, abs=0.02)
