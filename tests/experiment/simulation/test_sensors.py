"""What the logger adds: sizes of noise, steps of encoders, streams that do not depend on each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.experiment.simulation.sensors import SensorOptions, gyroscopes, measured
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import GYRO

ROBOT = Robot(
    "three",
    (
        Joint("turn", gear_ratio=100.0),
        Joint("slide", type="prismatic", gear_ratio=-500.0),
        Joint("stiff", gear_ratio=50.0, transmission="rigid"),
    ),
)
N = 20000
T = 1e-3 * np.arange(N)
WAVE = np.stack([np.sin(T), 0.3 * np.cos(2 * T), 1 + np.sin(3 * T)], axis=1)
SIGNALS = {
    "q": WAVE, "theta": WAVE + 0.01, "tau": 10 * WAVE, "dq": 2 * WAVE, "dtheta": 2 * WAVE,
    "tau_link": np.where(ROBOT.elastic, 5 * WAVE, np.nan), "temperature": 20 + 0 * WAVE,
}  # fmt: skip


def logged(seed: int = 1, **options: object) -> dict[str, np.ndarray]:
    return measured(ROBOT, SIGNALS, 1e-3, SensorOptions(**options), seed)  # type: ignore[arg-type]


def test_perfect_sensors_by_default() -> None:
    log = logged()
    assert set(log) == {"q", "theta", "tau"}
    for name in ("q", "tau", "theta"):
        np.testing.assert_array_equal(log[name][:, :2], SIGNALS[name][:, :2])


def test_decibels_are_of_each_channels_rms() -> None:
    log = logged(noise_db=40, velocities=True)
    for name in ("q", "theta", "dq", "dtheta"):
        noise = (log[name] - SIGNALS[name])[:, :2]
        np.testing.assert_allclose(
            noise.std(axis=0), 0.01 * np.sqrt(np.mean(SIGNALS[name] ** 2, axis=0))[:2], rtol=0.03
        )


def test_noise_in_units() -> None:
    log = logged(position_noise=1e-4, velocity_noise=1e-2, torque_noise=0.5, velocities=True)
    for name, size in (("q", 1e-4), ("theta", 1e-4), ("dq", 1e-2), ("tau", 0.5)):
        np.testing.assert_allclose((log[name] - SIGNALS[name])[:, :2].std(axis=0), size, rtol=0.03)


def test_coloured_torque_noise_has_its_size_and_its_correlation_time() -> None:
    noise = logged(torque_noise_relative=0.01, torque_correlation=0.01)["tau"] - SIGNALS["tau"]
    np.testing.assert_allclose(noise.std(axis=0), 0.01 * np.sqrt(np.mean(SIGNALS["tau"] ** 2, axis=0)), rtol=0.12)
    for channel in noise.T:
        correlation = np.mean(channel[1:] * channel[:-1]) / np.mean(channel**2)
        assert correlation == pytest.approx(math.exp(-0.1), abs=0.02)


def test_encoder_steps() -> None:
    log = logged(counts=4096, motor_counts=1024, motor_side=True)
    steps = {
        "q": (2 * math.pi / 4096, 1 / 4096),
        "theta": (2 * math.pi / (1024 * 100), 2 * math.pi / (1024 * 500)),
    }
    for name, wanted in steps.items():
        for k, step in enumerate(wanted):
            counted = log[name][:, k] / step
            np.testing.assert_allclose(counted, np.round(counted), atol=1e-6)
            assert np.abs(log[name][:, k] - SIGNALS[name][:, k]).max() <= 0.5 * step * (1 + 1e-9)


def test_a_rigid_joint_has_one_encoder() -> None:
    log = logged(noise_db=60, counts=4096, motor_counts=1024, velocities=True)
    np.testing.assert_array_equal(log["q"][:, 2], log["theta"][:, 2])
    np.testing.assert_array_equal(log["dq"][:, 2], log["dtheta"][:, 2])


def test_noise_of_a_channel_does_not_depend_on_what_else_is_logged() -> None:
    alone, more = logged(noise_db=60), logged(noise_db=60, velocities=True, tau_link=True, temperature=True)
    for name in ("q", "theta", "tau"):
        np.testing.assert_array_equal(alone[name], more[name])
    assert np.isnan(more["tau_link"][:, 2]).all()
    other = logged(seed=2, noise_db=60)
    assert np.abs(other["q"] - alone["q"]).max() > 0


def test_an_encoder_without_counts_is_refused() -> None:
    with pytest.raises(UsageError):
        logged(counts=0.0)


def test_gyroscopes_turn_with_their_links_in_axes_of_their_own() -> None:
    """Of a wheel about z: one axis of the sensor's carries all of it, whichever way it is mounted."""
    q, dq = WAVE, 3 * np.cos(T)[:, None] * np.ones(3)
    seen = gyroscopes(ROBOT, q, dq, SensorOptions(gyro=("turn",), gyro_noise=1e-3), 4)
    assert set(seen) == set(GYRO)
    rates = np.stack([seen[axis][:, 0] for axis in GYRO], axis=1)
    assert all(np.isnan(seen[axis][:, 1:]).all() for axis in GYRO)
    slope = np.linalg.lstsq(np.stack([dq[:, 0], np.ones(N)], axis=1), rates, rcond=None)[0]
    assert np.linalg.norm(slope[0]) == pytest.approx(1.0, abs=1e-4)
    noise = rates - np.stack([dq[:, 0], np.ones(N)], axis=1) @ slope
    np.testing.assert_allclose(noise.std(axis=0), 1e-3, rtol=0.05)
    other = gyroscopes(ROBOT, q, dq, SensorOptions(gyro=("turn",)), 5)
    assert np.abs(other["gyro_x"][:, 0] - seen["gyro_x"][:, 0]).max() > 0.1
    assert gyroscopes(ROBOT, q, dq, SensorOptions(), 4) == {}
    with pytest.raises(UsageError, match="no joint 'trun'"):
        gyroscopes(ROBOT, q, dq, SensorOptions(gyro=("trun",)), 4)
