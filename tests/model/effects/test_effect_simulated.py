"""Every effect in a simulated log: the equations with its columns hold, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from elid_cli.estimation.regression.scene_with_effects import with_found
from elid_cli.experiment.simulation import SimulationOptions
from elid_cli.experiment.simulation.control import ControlOptions
from elid_cli.experiment.simulation.run import Simulation, run
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.posed import as_posed
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion
from tests.model.effects.effect_scenes import DT, planar, scene_of, torque_of

LIBRARY = effect_classes()
SIMULATED = [
    n for n, kind in LIBRARY.items()
    if not n.startswith("sensor") and kind.simulated != "loop" and kind.applies(planar(), 0)
]  # fmt: skip
LENGTH = 1.2
CHANGES = {
    "saturation": {"limit": 130.0},
    "contact": {"time": 0.5},
    "payload": {"start": 0.55},
    "gravity_direction": {"roll": 0.01, "pitch": -0.004},
    "encoder_zero": {"offset": 0.01},
}
LEFT = {
    "encoder_scale": 0.01,
    "encoder_eccentricity": 0.05,
    "hysteresis": 2e-2,
    "flexible_mode": 1e-3,
    "gravity_direction": 0.2,
    "encoder_zero": 0.1,
}
"""Share of the effect that may remain: states between samples, the second order of what turns the model."""


def values_of(name: str, robot: Robot) -> dict[str, float]:
    return {**LIBRARY[name].example, **CHANGES.get(name, {})}


def logged_motion(result: Simulation, name: str, values: Mapping[str, float]) -> Motion:
    """Return the motion as the log shows it: positions of the log, rates of the exact motion (as late as these)."""
    exact, log = result.motion, result.recording
    late = {"encoder_skew": ("dq", "ddq"), "position_delay": ("dq", "ddq", "dtheta", "ddtheta")}.get(name, ())
    rates = {rate: getattr(exact, rate).copy() for rate in ("dq", "ddq", "dtheta", "ddtheta")}
    for rate in late:
        earlier = np.clip(log.t - next(iter(values.values())), 0, None)
        rates[rate][:, 0] = CubicSpline(log.t, rates[rate][:, 0])(earlier)
    return Motion(log.t, log.q, rates["dq"], rates["ddq"], log.theta, rates["dtheta"], rates["ddtheta"])


@pytest.mark.parametrize("name", SIMULATED)
def test_the_equations_hold_with_the_effect_and_fail_without(name: str) -> None:
    plain = planar()
    spec = EffectSpec(name, None if LIBRARY[name].whole_robot else "joint1", values_of(name, plain))
    # held torques would make accelerations jump at every sample, which a log shows on one side only
    options = SimulationOptions(duration=LENGTH, rate=1 / DT, control=ControlOptions(continuous=True))
    result = run(replace(plain, effects=(spec,)), options)
    motion = logged_motion(result, name, spec.parameters)
    # the log's torque where it holds the effect, else what the motors delivered
    tau = result.recording.tau
    scene = scene_of(plain, motion=motion)
    # what the whole model predicts is the torque that acts
    predicted = tau if LIBRARY[name].from_torque else scene.predicted
    scene = replace(scene, tau=tau, predicted=predicted, duration=LENGTH, cache={})
    number = LIBRARY[name].number(plain, spec.joint)
    linear, shape = LIBRARY[name].coefficients(scene, number, spec.parameters)
    scene = with_found(scene, [(LIBRARY[name](number, shape), linear)])
    without = torque_of(plain, motion, scene.parameters)
    without[1] -= tau
    effect = np.zeros_like(without)
    for row, columns in LIBRARY[name](number, shape).columns(scene).items():
        effect[0 if row.side == "link" else 1, :, row.joint] = linear @ columns
    inner = slice(25, -25)  # shifted channels are held at the ends
    rest, size = np.abs(without + effect)[:, inner], np.abs(effect)[:, inner]
    assert size.max() > 0.01
    if LIBRARY[name].corrects:  # a kink of the motion at a reversal has no derivative to shift it by
        acting = size > 0.1 * size.max(axis=(0, 1))
        assert np.median(rest[acting] / size[acting]) < 0.05
    else:
        assert np.sqrt(np.mean(rest**2)) <= LEFT.get(name, 1e-6) * np.sqrt(np.mean(size**2)) + 1e-6
    # the other sign would be twice as wrong
    assert np.sqrt(np.mean((without - effect)[:, inner] ** 2)) > 1.5 * np.sqrt(np.mean(size**2))


@pytest.mark.parametrize(("name", "values"), [
    ("gravity_direction", {"roll": 0.1, "pitch": -0.3}), ("encoder_zero", {"offset": 0.9}),
])  # fmt: skip
def test_the_equations_hold_in_a_model_that_is_turned(name: str, values: Mapping[str, float]) -> None:
    plain = planar()
    robot = replace(plain, effects=(EffectSpec(name, None if LIBRARY[name].whole_robot else "joint1", values),))
    options = SimulationOptions(duration=LENGTH, rate=1 / DT, control=ControlOptions(continuous=True))
    result = run(robot, options)
    motion = logged_motion(result, name, values)
    turned = as_posed(robot)
    assert [dict(spec.parameters) for spec in turned.effects] == [{}]
    parameters = scene_of(plain, motion=motion).parameters
    scale = np.sqrt(np.mean(result.recording.tau**2))
    rest = [torque_of(model, motion, parameters) for model in (plain, turned)]
    for torque in rest:
        torque[1] -= result.recording.tau
    off, exact = (float(np.sqrt(np.mean(torque[:, 25:-25] ** 2))) for torque in rest)
    assert exact < 1e-6 * scale < 0.01 * scale < off


@pytest.mark.parametrize("name", ["sensor_gain", "sensor_offset"])
def test_torque_sensors_read_what_their_effect_says(name: str) -> None:
    from elid_cli.experiment.simulation.sensors import SensorOptions

    plain = planar()
    robot = replace(plain, effects=(EffectSpec(name, "joint1", LIBRARY[name].example),))
    result = run(robot, SimulationOptions(duration=0.3, rate=1 / DT, sensors=SensorOptions(tau_link=True)))
    scene = scene_of(plain, motion=result.motion)
    linear, shape = LIBRARY[name].coefficients(scene, 0, LIBRARY[name].example)
    column = next(v for row, v in LIBRARY[name](0, shape).columns(scene).items() if row.side == "link")
    truth = 3000 * (result.motion.theta - result.motion.q)[:, 0]
    assert result.recording.tau_link is not None
    np.testing.assert_allclose(result.recording.tau_link[:, 0], truth + linear @ column, atol=1e-8)


@pytest.mark.parametrize("name", ["torque_delay", "encoder_skew", "torque_gain", "encoder_offset", "encoder_scale"])
def test_an_effect_of_the_log_is_taken_back_with_its_sign_turned(name: str) -> None:
    t = DT * np.arange(1000)
    wave = np.stack([np.sin(5 * t), np.cos(3 * t)], axis=1)
    signals = {key: (k + 1) * wave for k, key in enumerate(("q", "theta", "tau", "dq", "dtheta", "tau_link"))}
    effect = LIBRARY[name](0)
    values = LIBRARY[name].example
    changed = signals | effect.logged(signals, DT, values)
    factor = name in ("torque_gain", "encoder_scale")
    back = {k: 1 / (1 + v) - 1 if factor else -v for k, v in values.items()}
    again = changed | effect.logged(changed, DT, back)
    for key, original in signals.items():
        np.testing.assert_allclose(again[key][20:-20], original[20:-20], atol=1e-6)
    assert any(not np.array_equal(changed[key], signals[key]) for key in signals)
    assert all(np.array_equal(changed[key][:, 1], signals[key][:, 1]) for key in signals)
