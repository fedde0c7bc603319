"""Joints that lift: no offset stands for a weight, and what noise leaves of a spring not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimate import identify
from elid_cli.identification import Identification
from elid_cli.robot import Robot
from elid_cli.robot_file import robot_from_text
from elid_cli.signals import prepare
from elid_cli.simulation import SimulationOptions, simulate
from elid_cli.simulation.sensors import SensorOptions

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
    assert "the motor row takes the link's inertia for the rotor's" in found.reasons["Jm1"]
