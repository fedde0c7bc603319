"""What the logger adds: sizes of noise, steps of encoders, streams that do not depend on each other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.experiment.simulation import SimulationOptions, run
from elid_cli.experiment.simulation.sensors import SensorOptions, accelerometers, gyroscopes, measured
from elid_cli.robot.robot import EffectSpec, Joint, Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import ACCEL, GYRO

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


ARM = Robot(
    "arm",
    (
        Joint("base", a=0.4, alpha=0.7, d=0.3, theta=0.2),
        Joint("elbow", a=0.2, alpha=0.4, d=-0.1),
        Joint("slide", type="prismatic", a=0.1, alpha=-1.1, theta=0.5),
    ),
    gravity=(1.0, -2.0, -9.4),
)


def positions(t: Array) -> Array:
    """Return positions of three joints, (N, 3), at times (N,), s."""
    return np.stack([np.sin(3 * t), 1 + np.sin(2 * t) + 0.5 * np.sin(5 * t), 0.2 * np.cos(4 * t)], axis=1)


def motion_of(t: Array) -> Motion:
    """Return the same with exact rates and accelerations."""
    q = positions(t)
    dq = np.stack([3 * np.cos(3 * t), 2 * np.cos(2 * t) + 2.5 * np.cos(5 * t), -0.8 * np.sin(4 * t)], axis=1)
    ddq = np.stack([-9 * np.sin(3 * t), -4 * np.sin(2 * t) - 12.5 * np.sin(5 * t), -3.2 * np.cos(4 * t)], axis=1)
    return Motion(t, q, dq, ddq, q, dq, ddq)


def frames(q: Array, link: int) -> Array:
    """Return the placements of a link's frame in the base, (N, 4, 4)."""
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k, (before, after) in enumerate(ARM.placements()[: link + 1]):
        moved = np.zeros((len(q), 4, 4)) + np.eye(4)
        if ARM.joints[k].revolute:
            moved[:, 0, 0] = moved[:, 1, 1] = np.cos(q[:, k])
            moved[:, 1, 0], moved[:, 0, 1] = np.sin(q[:, k]), -np.sin(q[:, k])
        else:
            moved[:, 2, 3] = q[:, k]
        pose = pose @ before @ moved @ after
    return pose


def forces(link: int, t: Array, point: Array) -> Array:
    """Return the specific forces, (N, 3), at a point of a link, in its frame, from the point's places in the base."""
    step = 1e-3
    places = [(frames(positions(t + s), link) @ np.append(point, 1.0))[:, :3] for s in (-step, 0.0, step)]
    bent = (places[0] - 2 * places[1] + places[2]) / step**2 - np.array(ARM.gravity)
    return np.einsum("nij,ni->nj", frames(positions(t), link)[:, :3, :3], bent)


@pytest.mark.parametrize("link", [1, 2])
def test_accelerometers_feel_how_a_point_of_their_link_moves_and_gravity(link: int) -> None:
    """What they log is the specific force somewhere near the link's origin, turned, and a bias: found by a fit."""
    t = np.linspace(0.0, 4.0, 400)
    name = ARM.joint_names[link]
    for seed in range(3):
        seen = accelerometers(ARM, motion_of(t), SensorOptions(accel=(name,)), seed)
        assert set(seen) == set(ACCEL)
        assert all(np.isnan(np.delete(seen[axis], link, axis=1)).all() for axis in ACCEL)
        origin = forces(link, t, np.zeros(3))
        arms = [forces(link, t, point) - origin for point in np.eye(3)]
        columns = np.hstack([origin, *arms, np.ones((len(t), 1))])
        logged = np.stack([seen[axis][:, link] for axis in ACCEL], axis=1)
        found = np.linalg.lstsq(columns, logged, rcond=None)[0]
        np.testing.assert_allclose(columns @ found, logged, atol=2e-4)
        turn, bias = found[:3].T, found[-1]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-3)
        assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-3)
        place = [float(np.trace(turn.T @ found[3 * k : 3 * k + 3].T)) / 3 for k in (1, 2, 3)]
        np.testing.assert_allclose(found[3:12].T, np.hstack([r * turn for r in place]), atol=2e-3)
        assert 0.01 < np.linalg.norm(place) < 0.1
        assert 0 < np.abs(bias).max() < 4 * 0.05


def test_at_rest_an_accelerometer_feels_what_holds_it_up() -> None:
    """With noise as asked for, and a mounting that is the seed's, whatever is logged after it."""
    still = np.zeros((N, 3))
    motion = Motion(T, *[still] * 6)
    seen = accelerometers(ARM, motion, SensorOptions(accel=("slide",), accel_noise=0.02), 4)
    felt = np.stack([seen[axis][:, 2] for axis in ACCEL], axis=1)
    assert np.linalg.norm(felt.mean(axis=0)) == pytest.approx(np.linalg.norm(ARM.gravity), abs=0.2)
    np.testing.assert_allclose(felt.std(axis=0), 0.02, rtol=0.05)
    more = accelerometers(ARM, motion, SensorOptions(accel=("slide", "base"), gyro=("slide",), accel_noise=0.02), 4)
    other = accelerometers(ARM, motion, SensorOptions(accel=("slide",)), 5)
    for axis in ACCEL:
        np.testing.assert_array_equal(more[axis][:, 2], seen[axis][:, 2])
        assert np.abs(other[axis][:, 2] - seen[axis][:, 2]).max() > 0.1
    assert accelerometers(ARM, motion, SensorOptions(), 4) == {}
    with pytest.raises(UsageError, match="no joint 'sldie' for an accelerometer") as caught:
        accelerometers(ARM, motion, SensorOptions(accel=("sldie",)), 4)
    assert "slide" in caught.value.hint


def test_a_simulated_accelerometer_feels_the_gravity_that_acts(planar: Robot) -> None:
    tilted = replace(planar, effects=(EffectSpec("gravity_direction", None, {"roll": 0.0, "pitch": 0.1}),))
    sensors = SensorOptions(accel=("joint2",))
    done = run(tilted, SimulationOptions(duration=0.05, rate=500.0, sensors=sensors))
    turned = replace(planar, gravity=(9.81 * math.sin(0.1), -9.81 * math.cos(0.1), 0.0))
    for axis, values in accelerometers(turned, done.motion, sensors, 0).items():
        np.testing.assert_allclose(done.recording.accel[axis], values, atol=1e-9)
    upright = accelerometers(planar, done.motion, sensors, 0)
    assert max(np.nanmax(np.abs(upright[axis] - done.recording.accel[axis])) for axis in ACCEL) > 0.5


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


def test_sensors_on_links_have_biases_of_the_size_that_is_said() -> None:
    """Of 100 sensors each at rest where nothing weighs."""
    weightless, still = replace(ARM, gravity=(0.0, 0.0, 0.0)), np.zeros((3, 3))
    motion, options = Motion(T[:3], *[still] * 6), SensorOptions(accel=("slide",), gyro=("slide",))
    felt = [accelerometers(weightless, motion, options, seed)[axis][0, 2] for seed in range(100) for axis in ACCEL]
    turned = [gyroscopes(weightless, still, still, options, seed)[axis][0, 2] for seed in range(100) for axis in GYRO]
    assert np.std(felt) == pytest.approx(0.05, rel=0.08)
    assert np.std(turned) == pytest.approx(0.01, rel=0.08)
