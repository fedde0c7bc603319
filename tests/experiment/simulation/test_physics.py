"""What physics demands of the simulator: energy, rest, convergence, effects that do what they say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, run
from elid_cli.experiment.simulation.effects_at_work import active_effects
from elid_cli.experiment.simulation.integration import System, reference_scene
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Joint, Robot
from tests.robot.random_robots import random_robot

PLANAR = read_robot("planar2")


def without_friction(robot: Robot) -> Robot:
    joints = (replace(j, parameters={**j.parameters, "fs": 0.0, "fv": 0.0}) for j in robot.joints)
    return replace(robot, joints=tuple(joints))


def free_motion(robot: Robot, x: list[float], h: float, steps: int) -> tuple[System, list[list[float]]]:
    dynamics = Dynamics(robot)
    effects = active_effects(robot, reference_scene(dynamics, h, h * steps))
    system = System(dynamics, effects, h, h * steps)
    x = [*x, *([0.0] * (system.size - len(x)))]
    none = [0.0] * robot.n
    states = [x]
    for k in range(steps):
        x = system.step(k * h, h, x, (lambda a, b: none,) * 3)
        states.append(x)
    return system, states


def energy(system: System, x: list[float]) -> float:
    """Return kinetic, elastic and gravitational energy, J; heights are summed here from the frames."""
    dynamics, robot = system.dynamics, system.dynamics.robot
    q, dq, theta, dtheta = system.split(x)
    velocity = np.array([*dq, *(dtheta[k] for k in dynamics.elastic)])
    total = 0.5 * velocity @ dynamics.mass_matrix(q) @ velocity
    total += sum(0.5 * dynamics.stiffness[k] * (q[k] - theta[k]) ** 2 for k in dynamics.elastic)
    pose = np.eye(4)
    for i, (joint, (before, after)) in enumerate(zip(robot.joints, robot.placements(), strict=True), start=1):
        motion = np.eye(4)
        if joint.revolute:
            motion[:2, :2] = [[math.cos(q[i - 1]), -math.sin(q[i - 1])], [math.sin(q[i - 1]), math.cos(q[i - 1])]]
        else:
            motion[2, 3] = q[i - 1]
        pose = pose @ before @ motion @ after
        p = dict(zip(dynamics.model.names, dynamics.parameters.tolist(), strict=True))
        first = pose[:3, :3] @ np.array([p[f"c{a}{i}"] for a in "xyz"])
        total -= np.array(robot.gravity) @ (p[f"m{i}"] * pose[:3, 3] + first)
    return float(total)


@pytest.mark.parametrize(
    "robot",
    [
        PLANAR,
        random_robot(61, 3, "standard", kinds="rrp", own_axes=True),
        random_robot(62, 3, "modified", rigid=(1,), own_axes=True),
    ],
    ids=["planar2", "sliding", "mixed"],
)
def test_energy_is_kept_without_friction_and_torque(robot: Robot) -> None:
    robot = without_friction(robot)
    motors = sum(joint.elastic for joint in robot.joints)
    start = [0.3] * robot.n + [0.31] * motors + [0.0] * (robot.n + motors)
    system, states = free_motion(robot, start, 1e-4, 1500)
    energies = np.array([energy(system, x) for x in states[::50]])
    moved = max(abs(v) for v in system.split(states[-1])[1])
    assert moved > 0.1, "the robot has to move for this to mean anything"
    exchanged = max(abs(energies[0]), 1.0)
    np.testing.assert_allclose(energies, energies[0], rtol=0, atol=1e-9 * exchanged)


def test_friction_takes_exactly_the_energy_that_it_dissipates() -> None:
    start = [0.3, 0.2, 0.31, 0.21, 0.0, 0.0, 0.0, 0.0]
    h = 1e-4
    system, states = free_motion(PLANAR, start, h, 3000)
    loss = []
    for x in states:
        w = np.array(system.split(x)[3])
        force = [
            j.parameters["fv"] * v + j.parameters["fs"] * math.tanh(v / 5e-3)
            for j, v in zip(PLANAR.joints, w, strict=True)
        ]
        loss.append(float(np.dot(force, w)))
    dissipated = h * (np.sum(loss) - 0.5 * (loss[0] + loss[-1]))
    change = energy(system, states[0]) - energy(system, states[-1])
    assert dissipated > 0.1
    assert change == pytest.approx(dissipated, rel=1e-5)


def test_steps_are_fine_enough() -> None:
    coarse = run(PLANAR, SimulationOptions(duration=1.0))
    fine = run(PLANAR, SimulationOptions(duration=1.0, accuracy=4.0))
    assert fine.step < coarse.step / 3
    for name in ("q", "theta"):
        difference = getattr(coarse.recording, name) - getattr(fine.recording, name)
        assert np.abs(difference).max() < 2e-7
    assert np.abs(coarse.recording.tau - fine.recording.tau).max() < 2e-4


def test_log_obeys_the_model() -> None:
    """Regressor times parameters gives the logged torque at every instant, with the exact accelerations."""
    result = run(PLANAR, SimulationOptions(duration=2.0))
    dynamics = Dynamics(PLANAR)
    motion = result.motion
    rows = dynamics.model.dense(motion, dynamics.model.estimation) @ dynamics.parameters
    for plan, predicted in zip(dynamics.model.estimation.rows, rows, strict=True):
        moving = np.abs(motion.dtheta[:, plan.row.joint]) > 0.05  # elsewhere sign(v) is rounded
        np.testing.assert_allclose(predicted[moving], result.tau[moving, plan.row.joint], atol=1e-6)


def test_arm_starts_at_rest_and_follows() -> None:
    result = run(read_robot("puma560"), SimulationOptions(duration=0.4))
    assert np.abs(result.motion.ddq[:2]).max() < 0.05
    assert np.abs(result.motion.q - result.reference).max() < 0.01


def test_mixed_robot_with_random_numbers_follows() -> None:
    robot = random_robot(63, 4, "standard", kinds="rrp", rigid=(1,), own_axes=True)
    result = run(robot, SimulationOptions(duration=2.0))
    assert np.abs(result.motion.q - result.reference).max() < 0.05
    rigid = result.motion
    np.testing.assert_array_equal(rigid.q[:, 1], rigid.theta[:, 1])


def test_stiff_heavy_axis_is_stable() -> None:
    parameters = {"m": 2000.0, "cx": -900.0, "cy": 0.0, "Izz": 900.0, "Jm": 0.0118, "fs": 400.0, "fv": 900.0, "K": 7e6}
    heavy = Robot("axis", (Joint("a2", a=1.15, gear_ratio=267.429, parameters=parameters),), gravity=(0, -9.81, 0))
    result = run(heavy, SimulationOptions(duration=1.0, rate=250.0))
    assert np.abs(result.motion.q - result.reference).max() < 0.01
    assert np.abs(result.motion.q - result.motion.theta).max() < 5e-3


def test_held_torque_is_half_a_sample_late_and_continuous_is_not() -> None:
    """Through the spring: K (θ - q) + motor inertia and friction explain the torque at the logged instant, or later."""
    for continuous, expected in ((False, 0.5e-3), (True, 0.0)):
        control = ControlOptions(continuous=continuous)
        result = run(PLANAR, SimulationOptions(duration=2.0, control=control))
        t, theta, q = result.motion.t, result.motion.theta[:, 1], result.motion.q[:, 1]
        # torque averaged over what the motion can show: second differences of the logged motor position
        acceleration = (theta[2:] - 2 * theta[1:-1] + theta[:-2]) / 1e-6
        link = (q[2:] - 2 * q[1:-1] + q[:-2]) / 1e-6
        assert len(t) == len(theta)
        first = (result.motion.q[2:, 0] - 2 * result.motion.q[1:-1, 0] + result.motion.q[:-2, 0]) / 1e-6
        assert link.shape == first.shape
        motor = 0.1**2 * 12.1 * acceleration + 0.1 * 12.1 * first - 1800 * (q - theta)[1:-1]
        motor += 0.1391 * (theta[2:] - theta[:-2]) / 2e-3
        slow = np.abs(theta[2:] - theta[:-2]) / 2e-3 < 0.05
        motor += 0.3576 * np.sign(theta[2:] - theta[:-2])
        tau = result.recording.tau[1:-1, 1]
        rate = np.gradient(result.recording.tau[:, 1], 1e-3)[1:-1]
        keep = ~slow
        delay = -np.sum((motor - tau)[keep] * rate[keep]) / np.sum(rate[keep] ** 2)
        assert delay == pytest.approx(expected, abs=1e-4)


def test_effects_need_a_joint_and_their_parameters() -> None:
    from elid_cli.errors import RobotError

    robot = replace(PLANAR, effects=(EffectSpec("stribeck", "joint2", {"amplitude": 1.0}),))
    with pytest.raises(RobotError, match="needs 'velocity'"):
        run(robot, SimulationOptions(duration=0.01))
    robot = replace(PLANAR, effects=(EffectSpec("stribeck", "joint9", {"amplitude": 1.0, "velocity": 0.1}),))
    with pytest.raises(RobotError, match="no joint named 'joint9'"):
        run(robot, SimulationOptions(duration=0.01))
