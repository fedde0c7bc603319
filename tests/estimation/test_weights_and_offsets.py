"""Joints that lift: no offset stands for a weight, and what noise leaves of a spring not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.regression.nuisances import beyond_doubt
from elid_cli.estimation.result import Identification
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import robot_from_text
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare

CART = """
name: cartswing
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {name: cart, type: prismatic, a: 0, alpha: pi/2, d: 0, theta: 0, gear_ratio: 62.8, motor_axis: [1, 0, 0],
     transmission: rigid, limits: {position: [-0.6, 0.6], velocity: 1.2, acceleration: 5, torque: 250},
     parameters: {m: 9, Jm: 1.5e-3, fs: 12, fv: 30}}
  - {name: swing, a: 0.55, alpha: 0, d: 0, theta: 0, gear_ratio: 37.5,
     limits: {position: [-2.2, 2.2], velocity: 4, acceleration: 20, torque: 80},
     parameters: {m: 3.3, cx: -0.8, cy: 0.06, Izz: 0.28, Jm: 2.5e-4, fs: 0.8, fv: 0.9, K: 350}}
"""
SCARA = """
name: scara
gravity: [0, 0, -9.81]
dh: modified
joints:
  - {name: turn, d: 0.35, gear_ratio: 101, a: 0, alpha: 0, theta: 0,
     limits: {position: [-2.0, 2.0], velocity: 2.5, acceleration: 8, torque: 150},
     parameters: {m: 6, cx: 1.1, cy: 0.05, cz: -0.4, Ixx: 0.11, Iyy: 0.38, Izz: 0.36, Ixy: 0.01, Ixz: 0.03, Iyz: 0,
                  Jm: 0.9e-4, fs: 3.1, fv: 5.5, K: 7200}}
  - {name: lift, type: prismatic, a: 0.31, alpha: 0, d: 0.05, theta: 0.2, gear_ratio: 314.159,
     limits: {position: [0.0, 0.45], velocity: 0.8, acceleration: 4, torque: 400},
     parameters: {m: 4.2, cx: 0.2, cy: 0.02, cz: 0.35, Ixx: 0.07, Iyy: 0.08, Izz: 0.03, Ixy: 0, Ixz: 0.01, Iyz: 0,
                  Jm: 2.1e-5, fs: 14, fv: 45, K: 90000}}
  - {name: wrist, a: 0.22, alpha: 1.1, d: 0.04, theta: 0, gear_ratio: 51,
     limits: {position: [-2.4, 2.4], velocity: 4, acceleration: 18, torque: 40},
     parameters: {m: 2.4, cx: 0.36, cy: -0.03, cz: 0.12, Ixx: 0.02, Iyy: 0.075, Izz: 0.071, Ixy: 0.004, Ixz: -0.01,
                  Iyz: 0.002, Jm: 0.3e-4, fs: 0.9, fv: 0.7, K: 900}}
"""


def logged(robot: Robot, seed: int, noise_db: float | None, *, without_motor: str = "") -> Identification:
    """Return the identification of a simulated log, of which a rigid joint may lack one encoder."""
    sensors = SensorOptions(noise_db=noise_db, torque_noise_relative=0.005)
    log = simulate(robot, SimulationOptions(duration=10.0, rate=500.0, seed=seed, sensors=sensors))
    if without_motor:
        theta = log.theta.copy()
        theta[:, robot.joint_names.index(without_motor)] = np.nan
        log = replace(log, theta=theta, dtheta=None)
    return identify(robot, prepare(log, robot))


def score(found: Identification, name: str) -> float:
    """Return a parameter's distance from the truth in standard errors."""
    k = [found.base.parameters[leader] for leader in found.base.leaders].index(name)
    return float((found.estimate[k] - found.reference[k]) / found.std_error[k])


def test_a_cart_that_lifts_has_a_mass_and_no_offset() -> None:
    found = logged(robot_from_text(CART, "cart"), 1, None, without_motor="cart")
    assert {"m1", "Jm1"} <= {found.base.parameters[k] for k in found.base.leaders}
    assert [n.effect for n in found.nuisances if n.effect == "torque_offset"] == []
    assert abs(score(found, "m1")) < 3
    assert abs(score(found, "Jm1")) < 3


def test_noise_of_the_positions_makes_no_offset_of_a_weight() -> None:
    """The offset took up 64 N of weight, and the rotor's inertia was four times the truth at 34 standard errors."""
    found = logged(robot_from_text(SCARA, "scara"), 31, 45.0)
    assert [n.joint for n in found.nuisances if n.effect == "torque_offset"] == []
    assert abs(score(found, "Jm2")) < 3
    verdict = {found.base.parameters[leader]: v for leader, v in zip(found.base.leaders, found.verdict, strict=True)}
    assert verdict["Jm1"] == "refused"  # nothing but noise is left of the first joint's deflection
    assert "the motor equation takes the link's inertia for the rotor's" in found.reasons["Jm1"]


def test_delays_stay_where_they_agree_with_one_beyond_doubt_or_with_the_mean() -> None:
    delay = np.array([True, True, True, True, True, False, False])
    values = np.array([5e-4, 5e-3, 1e-4, -5e-4, 5e-2, 4.0, 5.0])
    deviations = np.array([5e-5, 1.5e-4, 3e-4, 1.5e-4, 1e-4, 1.5, 1.0])
    kept = beyond_doubt(values, deviations, delay, 1e-3)
    # beyond doubt; stands far out; agrees; the other sign; longer than any delay; offsets stand alone
    assert kept.tolist() == [True, True, True, False, False, False, True]
    assert not beyond_doubt(np.array([-5e-3]), np.array([1e-4]), np.ones(1, dtype=bool), 1e-3)[0]
    none = np.array([1e-4, -1e-4, 5e-5])
    assert not beyond_doubt(none, np.full(3, 1e-4), np.ones(3, dtype=bool), 1e-3).any()
    # none by itself, all together; and all that torques have been moved for
    assert beyond_doubt(np.full(4, 3e-4), np.full(4, 1e-4), np.ones(4, dtype=bool), 1e-3).all()
    assert beyond_doubt(none, np.full(3, 1e-4), np.ones(3, dtype=bool), 1e-3, late=True).all()
    assert not beyond_doubt(np.full(2, np.nan), np.full(2, np.nan), np.ones(2, dtype=bool), 1e-3).any()


def test_a_delay_that_stands_far_out_is_none_where_another_one_cannot_be() -> None:
    delay, deviations = np.ones(2, dtype=bool), np.array([0.7e-3, 1e-3])
    # a spring that the model lacks: the torque of one joint would act 4 ms before it was logged
    assert not beyond_doubt(np.array([-4.3e-3, 10.3e-3]), deviations, delay, 1e-3).any()
    assert beyond_doubt(np.array([-0.9e-3, 10.3e-3]), deviations, delay, 1e-3).tolist() == [False, True]
    # a clock of their own is another matter: all are logged late alike
    assert beyond_doubt(np.array([-9.8e-3, -10.3e-3]), deviations, delay, 1e-3).all()


THREE = """
name: three
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {name: base, a: 0, d: 0.38, alpha: pi/2, theta: 0, gear_ratio: 121, transmission: elastic,
     parameters: {m: 9, cx: 0.09, cy: -1.08, cz: 0.18, Ixx: 0.241, Iyy: 0.0407, Izz: 0.238, Ixy: 0.0194, Ixz: -0.003,
                  Iyz: 0.0317, Jm: 1.1e-4, fs: 3.1, fv: 4.2, K: 11000}}
  - {name: shoulder, a: 0.36, d: 0.04, alpha: 0, theta: 0, gear_ratio: 101, transmission: elastic,
     parameters: {m: 6.5, cx: -1.17, cy: 0.0975, cz: 0.195, Ixx: 0.0271, Iyy: 0.307, Izz: 0.301, Ixy: 0.028,
                  Ixz: 0.0546, Iyz: -0.0057, Jm: 9e-5, fs: 2.4, fv: 3.3, K: 8000}}
  - {name: elbow, a: 0.27, alpha: -pi/2, d: 0.02, theta: -pi/2, gear_ratio: 80, transmission: rigid,
     parameters: {m: 3.2, cx: -0.352, cy: -0.032, cz: 0.08, Ixx: 0.00624, Iyy: 0.0627, Izz: 0.0619, Ixy: -0.0058,
                  Ixz: 0.007, Iyz: 4.4e-4, Jm: 6e-5, fs: 1.1, fv: 1.4}}
"""


def test_delays_of_a_log_do_not_hide_in_its_noise() -> None:
    # a torque that is held acts half a sample late: left alone in the noise, fv1 and Jm1 went 2.7 deviations astray
    robot = robot_from_text(THREE, "three")
    scores = []
    for seed in range(4):
        log = simulate(robot, SimulationOptions(duration=12.0, seed=seed))
        noise = 0.01 * log.tau.std(axis=0) * np.random.default_rng(seed).standard_normal(log.tau.shape)
        result = identify(robot, prepare(replace(log, tau=log.tau + noise), robot), EstimateOptions(guards=False))
        scores.append((result.estimate - result.reference) / result.std_error)
    rms = dict(zip(result.base.names, np.sqrt(np.mean(np.square(scores), axis=0)), strict=True))
    assert rms["fv1"] < 1.8
    assert rms["Jm1"] < 1.8
    assert np.sqrt(np.mean(np.square(scores))) < 1.3
