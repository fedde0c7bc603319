"""Stops with the drives off are left out; torque that is zero for another reason stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from elid_cli import identify, prepare
from elid_cli.logs.reading import read_recording
from elid_cli.logs.repair.drives_off import drives_off
from elid_cli.logs.repair.grid import Grid
from elid_cli.model.body_torques import gravity_torques, inertial_torques
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot

Array = NDArray[np.float64]

RATE, LENGTH, STOP, BRAKING, AGAIN = 500.0, 14.0, 6.0, 0.25, 0.6
COULOMB, VISCOUS, INERTIA = np.array([0.9, 0.5]), np.array([0.4, 0.3]), np.array([1.5, 0.7])


def arm() -> Robot:
    robot = read_robot("planar2")
    bodies = ({k: v for k, v in j.parameters.items() if k not in ("Jm", "fs", "fv", "K")} for j in robot.joints)
    joints = (replace(j, transmission="rigid", parameters=b) for j, b in zip(robot.joints, bodies, strict=True))
    return replace(robot, joints=tuple(joints), name="arm")


def motion(held: float = 0.0, length: float = LENGTH) -> tuple[Array, Array, Array, Array]:
    """Return t, q, dq, ddq of a motion that is stopped at `STOP` for `held` s; none where that is 0."""
    t = np.arange(round((length + held) * RATE)) / RATE
    pace, change = np.ones_like(t), np.zeros_like(t)
    if held:
        ends = ((STOP, STOP + BRAKING, 1.0, 0.0), (STOP + BRAKING + held, STOP + BRAKING + held + AGAIN, 0.0, 1.0))
        for start, stop, before, after in ends:
            x = np.clip((t - start) / (stop - start), 0, 1)
            pace[t > start] = (before + (after - before) * x * x * (3 - 2 * x))[t > start]
            inside = (t > start) & (t < stop)
            change[inside] = ((after - before) * 6 * x * (1 - x) / (stop - start))[inside]
    s = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2)]) / RATE
    q, first, second = (np.zeros((t.size, 2)) for _ in range(3))
    for j, phase in enumerate((0.3, 1.1)):
        for k in range(1, 5):
            w = 2 * np.pi * (0.11 * k + 0.03 * j)
            q[:, j] += 0.5 / k * np.sin(w * s + phase * k)
            first[:, j] += 0.5 / k * w * np.cos(w * s + phase * k)
            second[:, j] -= 0.5 / k * w * w * np.sin(w * s + phase * k)
    return t, q, first * pace[:, None], second * pace[:, None] ** 2 + first * change[:, None]


def torques(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    own = COULOMB * np.sign(dq) + VISCOUS * dq + INERTIA * ddq
    return gravity_torques(robot, q) + inertial_torques(robot, q, dq, ddq) + own


def saved(path: Path, t: Array, q: Array, tau: Array) -> Path:
    generator = np.random.default_rng(5)
    q = q + 1e-5 * generator.normal(size=q.shape)
    tau = tau + 0.003 * np.sqrt(np.mean(tau**2, axis=0)) * generator.normal(size=tau.shape)
    head = "t,q.joint1,q.joint2,tau.joint1,tau.joint2"
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=head, comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize("held", [0.1, 2.0])
def test_an_emergency_stop_bends_no_parameter(tmp_path: Path, held: float) -> None:
    robot = arm()
    t, q, dq, ddq = motion(held)
    tau = torques(robot, q, dq, ddq)
    off = (t > STOP) & (t < STOP + BRAKING + held)
    recording = read_recording([saved(tmp_path / "stop.csv", t, q, np.where(off[:, None], 0.0, tau))], robot)
    (said,) = [line for line in recording.repairs if "no joint has any torque" in line]
    assert f"for {BRAKING + held + 0.018:.3g} s from t = 5.992 s" in said
    assert len(recording.segments) == 2
    found = identify(robot, prepare(recording, robot))
    assert found.model == "sufficient"
    values = {item.name: item for item in found.parameters}
    for name, true in {"fs1": 0.9, "fs2": 0.5, "fv1": 0.4, "fv2": 0.3}.items():
        item = values[name]
        assert abs(item.estimate - true) < 3.5 * item.std_error
        assert item.std_error < 0.1 * true


def test_the_same_stop_with_the_drives_on_stays(tmp_path: Path) -> None:
    robot = arm()
    t, q, dq, ddq = motion(1.0)
    recording = read_recording([saved(tmp_path / "on.csv", t, q, torques(robot, q, dq, ddq))], robot)
    assert not [line for line in recording.repairs if "torque" in line]
    assert recording.t.size == t.size


def kept(tau: Array, place: Array, rate: float = RATE) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which samples stay, and what is said."""
    repairs: list[str] = []
    grid = Grid(1 / rate, (0.0,), (len(tau),))
    signals = {"tau": tau, "theta": place, "q": np.full_like(place, np.nan)}
    return drives_off(signals, grid, np.ones(len(tau), dtype=bool), grid.times(), repairs), repairs


def pulses(t: Array) -> Array:
    return np.where(np.floor(t / 1.5) % 2 == 0, 4.0, 0.0) * np.sign(np.sin(2 * np.pi * t / 6))


def wave(t: Array) -> Array:
    return 3.0 * np.sin(1.3 * t)


@pytest.mark.parametrize(
    ("torque", "place"),
    [
        (pulses, lambda t: np.sin(1.1 * t)),  # swings on without torque
        (wave, lambda t: np.sin(1.1 * t)),  # passes through zero
        (lambda t: np.where(t < 7, wave(t), 0.0), lambda t: np.sin(1.1 * t)),  # swings to the end of the log
        (lambda t: 0.0 * t, lambda t: np.sin(1.1 * t)),
        # coasts to rest after each of many pulses
        (pulses, lambda t: np.cumsum(np.maximum(np.where(pulses(t) != 0, 1, 1 - t % 1.5 / 0.8), 0)) / RATE),
    ],
)
def test_torque_that_is_zero_by_the_motions_own_making_stays(
    torque: Callable[[Array], Array], place: Callable[[Array], Array]
) -> None:
    t = np.arange(6000) / RATE
    noise = 0.01 * np.random.default_rng(1).normal(size=(t.size, 1))
    stay, said = kept(torque(t)[:, None] + noise, place(t)[:, None])
    assert stay.all()
    assert said == []


def test_a_start_and_pauses_with_brakes_are_left_out() -> None:
    t = np.arange(8000) / RATE
    still = (t < 1.0) | (np.abs(t - 7.0) < 0.4) | (t > 15.0)
    held = (t < 1.2) | (np.abs(t - 7.0) < 0.6) | (t > 14.8)  # the drives hold the robot before and after
    moved = np.cumsum(~held) / RATE
    tau = np.stack([np.where(still, 0.0, 6 + wave(moved)), np.where(still, 0.0, 2 + np.cos(2 * moved))], axis=1)
    place = np.stack([np.sin(1.1 * moved), np.cos(0.9 * moved)], axis=1)
    stay, (said,) = kept(tau, place)
    margin = np.convolve(still, np.ones(13), "same") > 0  # 10 ms on either side, and a sample
    assert not stay[still].any()
    assert stay[~margin].all()
    assert "1.01 s from t = " in said
    assert "and" not in said.split("where")[0]


def test_one_joint_without_torque_is_no_stop() -> None:
    t = np.arange(6000) / RATE
    off = np.abs(t - 6) < 0.5
    tau = np.stack([np.where(off, 0.0, 6 + wave(t)), 5 + wave(t)], axis=1)
    place = np.stack([np.sin(np.cumsum(~off) / RATE), np.cos(0.9 * t)], axis=1)
    stay, said = kept(tau, place)
    assert stay.all()
    assert said == []


def test_rests_that_need_no_torque_stay() -> None:
    """Point to point in a horizontal plane: torque comes with the motion, and nothing holds the robot between."""
    t = np.arange(8000) / RATE
    inside = t % 1.3
    pace = np.interp(inside, [0, 0.25, 0.75, 1.0], [0, 1, 1, 0]) * np.where(t % 2.6 < 1.3, 1, -1)
    tau = np.gradient(pace, t) * 1.5 + 0.9 * np.sign(pace) * (np.abs(pace) > 0)
    stay, said = kept(tau[:, None], (np.cumsum(pace) / RATE)[:, None])
    assert stay.all()
    assert said == []


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-4])
def test_a_joint_that_stands_all_the_time_does_not_hide_a_stop(noise: float) -> None:
    robot = arm()
    t, q, dq, ddq = motion(1.0)
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.3, 0.0, 0.0
    tau = torques(robot, q, dq, ddq)
    off = (t > STOP) & (t < STOP + BRAKING + 1.0)
    shaken = q + noise * np.random.default_rng(3).normal(size=q.shape)
    stay, said = kept(np.where(off[:, None], 0.0, tau), shaken)
    assert not stay[off].any()
    assert len(said) == 1


def test_a_torque_that_is_zero_while_the_robot_moves_on_stays() -> None:
    robot = arm()
    t, q, dq, ddq = motion()
    tau = torques(robot, q, dq, ddq)
    off = (t > 5.0) & (t < 5.4)
    stay, said = kept(np.where(off[:, None], 0.0, tau), q)
    assert stay.all()
    assert said == []


@pytest.mark.parametrize(("noise", "offset"), [(0.0, 0.01), (0.03, 0.0), (0.0, 0.0)])
def test_current_sensors_with_noise_or_an_offset_show_a_stop(noise: float, offset: float) -> None:
    robot = arm()
    t, q, dq, ddq = motion(1.0)
    tau = torques(robot, q, dq, ddq)
    off = (t > STOP) & (t < STOP + BRAKING + 1.0)
    size = np.sqrt(np.mean(tau**2, axis=0))
    read = np.where(off[:, None], 0.0, tau) + size * (offset + noise * np.random.default_rng(4).normal(size=tau.shape))
    read[np.argmax(off) + 40] += 0.3 * size  # a sample of its own
    stay, said = kept(read, q)
    assert not stay[off].any()
    assert len(said) == 1


def test_a_torque_that_fades_to_nothing_is_no_stop() -> None:
    t = np.arange(6000) / RATE
    fades = np.clip((6.0 - t) / 2.0, 0, 1)
    tau = 5.0 * fades + 0.2 * fades * np.sin(9 * t)
    stay, said = kept(tau[:, None], np.cumsum(fades * np.sin(1.1 * t))[:, None] / RATE)
    assert stay.all()
    assert said == []


def test_a_side_with_a_hole_in_the_middle_is_no_standing_robot() -> None:
    t = np.arange(6000) / RATE
    off = np.abs(t - 6) < 0.3
    place = np.sin(1.1 * t)
    place[2990:3010] = np.nan
    tau = np.where(off, 0.0, 6 + wave(t))
    stay, _ = kept(tau[:, None], place[:, None])
    assert stay.all()


def test_every_stop_of_a_log_is_left_out() -> None:
    t = np.arange(round(30 * RATE)) / RATE
    pace = np.ones_like(t)
    for at in (4, 9, 14, 19, 24):
        pace = np.minimum(pace, np.interp(t, [at, at + 0.25, at + 1.0, at + 1.6], [1, 0, 0, 1], left=1, right=1))
    off = np.any([(t > at) & (t < at + 1.0) for at in (4, 9, 14, 19, 24)], axis=0)
    s = np.cumsum(pace) / RATE
    tau = np.stack([6 + wave(s) + pace, 3 + np.cos(2 * s)], axis=1)
    place = np.stack([np.sin(1.1 * s), np.cos(0.9 * s)], axis=1)
    stay, (said,) = kept(np.where(off[:, None], 0.0, tau), place)
    assert not stay[off].any()
    assert np.count_nonzero(~stay) < 1.1 * np.count_nonzero(off)
    assert "and 2 more times" in said


def test_three_pulses_after_which_an_axis_coasts_to_rest_stay() -> None:
    t = np.arange(round(10 * RATE)) / RATE
    tau, speed = np.zeros_like(t), np.zeros_like(t)
    for at in (1.0, 4.0, 7.0):
        tau[(t > at) & (t < at + 0.6)] = 6.0
        speed += np.interp(t, [at, at + 0.6, at + 1.5], [0, 1.2, 0], left=0, right=0)
    stay, said = kept(tau[:, None], (np.cumsum(speed) / RATE)[:, None])
    assert stay.all()
    assert said == []


def test_a_robot_that_sways_a_little_after_a_stop_has_come_to_rest() -> None:
    robot = arm()
    t, q, dq, ddq = motion(1.0)
    tau = torques(robot, q, dq, ddq)
    off = (t > STOP) & (t < STOP + BRAKING + 1.0)
    sways = q + 5e-5 * np.sin(40 * t)[:, None]
    stay, said = kept(np.where(off[:, None], 0.0, tau), sways)
    assert not stay[off].any()
    assert len(said) == 1


def test_a_long_swing_to_rest_stays_where_it_is_a_small_part_of_the_motion() -> None:
    t = np.arange(round(60 * RATE)) / RATE
    pace = np.interp(t, [30.0, 32.0, 33.0, 33.5], [1, 0, 0, 1], left=1, right=1)
    s = np.cumsum(pace) / RATE
    off = (t > 30.0) & (t < 33.0)
    stay, said = kept(np.where(off, 0.0, 6 + wave(s))[:, None], np.sin(1.1 * s)[:, None])
    assert stay.all()
    assert said == []
