"""Identification with joint torque sensors: link and motor decouple, and every parameter is known better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.validation.prediction import validate
from elid_cli.model.regressor import SENSOR_KINDS, EstimationRow, Regressor
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.estimation.sensor_logs import logged, motion, planar, shoulder, without_sensors

PLANAR = planar()


def found(log: Recording, robot: Robot = PLANAR, **options: object) -> Identification:
    return identify(robot, prepare(log, robot), EstimateOptions(**options))  # type: ignore[arg-type]


def spread(result: Identification) -> dict[str, float]:
    return dict(zip(result.base.names, result.std_error.tolist(), strict=True))


def nuisances(result: Identification) -> dict[tuple[str, str], float]:
    return {(n.effect, n.joint): next(iter(n.parameters.values())) for n in result.nuisances}


def test_a_log_without_sensors_has_the_rows_it_always_had() -> None:
    model = Regressor(PLANAR)
    signals = prepare(without_sensors(logged()), PLANAR)
    assert model.sensed(signals.sensed) is model.estimation
    assert {group.row.kind for group in observe(model, signals).groups} == {"sum", "motor"}


def test_sum_and_motor_rows_are_sums_of_the_sensors_rows() -> None:
    model = Regressor(PLANAR)
    observation = observe(model, prepare(logged(), PLANAR))
    values = np.random.default_rng(0).standard_normal(model.parameters)

    def sides(kind: str, joint: int) -> tuple[np.ndarray, np.ndarray]:
        group = observation.group(EstimationRow(kind, joint))  # type: ignore[arg-type]
        return values[group.index] @ group.columns, group.target

    for joint in range(2):
        for whole, parts in (("sum", ("load", "drive")), ("motor", ("drive", "spring"))):
            for side, *of in zip(sides(whole, joint), *(sides(part, joint) for part in parts), strict=True):
                np.testing.assert_allclose(side, sum(of), atol=1e-9 * np.abs(side).max())
    assert {g.row.kind for g in observation.independent} == set(SENSOR_KINDS)


def test_the_true_parameters_leave_nothing_in_any_row_of_an_exact_log() -> None:
    exact = replace(motion().recording, tau_link=motion().tau_link)
    judged = validate(PLANAR, prepare(exact, PLANAR))
    for row, residual in judged.residual.items():
        group = judged.observation.group(row)
        limit = 2e-2 if row.kind in ("sum", "motor", "drive") else 1e-3  # torques are held over a sample
        assert np.std(residual[group.use]) < limit * np.std(judged.observation.tau[row.joint])


def test_a_planar_arms_parameters_are_known_better() -> None:
    without, with_it = (spread(found(log)) for log in (without_sensors(logged()), logged()))
    assert max(with_it["K1"] / without["K1"], with_it["K2"] / without["K2"]) < 0.9
    assert np.median([with_it[name] / without[name] for name in without]) < 0.8
    assert max(with_it[name] / without[name] for name in without) < 1.3


def test_a_spatial_arms_bodies_are_known_several_times_better() -> None:
    arm = shoulder()
    results = [found(log, arm) for log in (without_sensors(logged("shoulder")), logged("shoulder"))]
    without, with_it = (spread(result) for result in results)
    assert np.median([with_it[name] / without[name] for name in without]) < 0.5
    assert with_it["K1"] < 0.3 * without["K1"]


def test_intervals_hold_the_truth() -> None:
    scores = []
    for seed in range(12):
        result = found(logged(seed=seed), guards=False)
        scores.append((result.estimate - result.reference) / result.std_error)
    assert 0.85 < np.mean(np.abs(np.array(scores)) < 1.96) < 0.995


def test_gain_and_offset_of_a_sensor_are_corrected_where_the_motor_torque_shows_them() -> None:
    result = found(logged(gain=(0.0, 0.05), offset=(2.0, 0.0)))
    assert nuisances(result)[("sensor_gain", "joint2")] == pytest.approx(0.05, abs=0.001)
    assert nuisances(result)[("sensor_offset", "joint1")] == pytest.approx(2.0, abs=0.1)
    assert not {("sensor_gain", "joint1"), ("sensor_offset", "joint2")} & set(nuisances(result))
    stiffness = dict(zip(result.base.names, result.estimate.tolist(), strict=True))
    assert stiffness["K2"] == pytest.approx(1800, rel=0.002)
    assert not {name for name, _ in nuisances(found(logged()))} & {"sensor_gain", "sensor_offset"}


def test_a_declared_gain_is_fitted_as_the_effect_it_is() -> None:
    spec = EffectSpec("sensor_gain", "joint2", {"gain": 0.02})
    result = found(logged(gain=(0.0, 0.05)), replace(PLANAR, effects=(spec,)))
    (effect,) = result.effects
    assert effect.parameters["gain"] == pytest.approx(0.05, abs=0.002)
    assert ("sensor_gain", "joint2") not in nuisances(result)


def test_a_joint_without_motor_torque_shows_its_bodies_and_stiffness_through_its_sensor() -> None:
    log = logged()
    tau = log.tau.copy()
    tau[:, 1] = np.nan
    blind, sensed = (found(replace(x, tau=tau)) for x in (without_sensors(log), log))
    name = "m2 - 4*Izz2"
    assert spread(sensed)[name] < 0.1 * spread(blind)[name]
    verdicts = dict(zip(sensed.base.names, sensed.verdict, strict=True))
    assert verdicts["K2"] == verdicts[name] == "supported"
    assert sensed.this_log["fs2"] == sensed.this_log["fv2"] == "not excited"


def test_a_sensor_of_one_joint_serves_that_joint() -> None:
    log = logged()
    assert log.tau_link is not None
    one = log.tau_link.copy()
    one[:, 0] = np.nan
    result = found(replace(log, tau_link=one))
    assert result.error["joint1"].sensor is None
    assert result.error["joint2"].sensor is not None
    assert max(abs(result.estimate - result.reference) / result.std_error) < 4


@pytest.mark.parametrize(
    ("reading", "why"),
    [
        (lambda log: log.tau, "copy of the motor's torque"),
        (lambda log: -log.tau_link, "sign is wrong"),
        (lambda log: np.where(np.arange(log.samples)[:, None] % 3 == 0, np.nan, log.tau_link), "is missing in 33%"),
        (lambda log: 0 * log.tau_link + 4.0, "never changes"),
    ],
    ids=["copy", "sign", "holes", "stuck"],
)
def test_a_reading_that_cannot_be_a_sensors_is_left_out_and_said(reading, why) -> None:
    log = logged()
    result, plain = found(replace(log, tau_link=reading(log))), found(without_sensors(log))
    assert np.array_equal(result.estimate, plain.estimate)
    assert all(any(f"tau_link of {joint}" in w and why in w for w in result.warnings) for joint in log.joints)


def test_the_collocation_leaves_the_sensors_answer() -> None:
    result = found(logged(), accurate=True)
    assert result.estimator == "default"
    assert any("does not use the joint torque sensors" in note for note in result.notes)


def test_friction_that_the_load_makes_is_seen_beside_a_sensor_and_the_friction_it_bends_is_marked() -> None:
    made = motion()
    log, speed = logged(), np.gradient(made.recording.theta[:, 1], made.recording.dt)
    assert log.tau_link is not None
    extra = 0.15 * np.abs(log.tau_link[:, 1]) * np.tanh(speed / 1e-3)
    log = replace(log, tau=log.tau + np.stack([np.zeros_like(extra), extra], axis=1))
    result = found(log)
    assert result.model == "insufficient"
    assert {(item.joint, item.rows) for item in result.insufficient} == {("joint2", "drive")}
    marked = {item.name for item in result.parameters if item.bias_possible}
    assert "fs2" in marked
    assert "fs1" not in marked
