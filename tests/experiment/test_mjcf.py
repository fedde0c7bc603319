"""The exported MJCF loads in MuJoCo and accelerates as the equations of the elastic robot say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.experiment.real_bodies import known_parameters
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Limits, Robot
from elid_cli.robot.urdf.write import with_parameters
from tests.robot.elastic_lagrange import accelerations
from tests.robot.random_robots import random_robot

mujoco = pytest.importorskip("mujoco")


def free(robot: Robot, *, smooth: bool) -> Robot:
    """Return the robot without limits and, where `smooth`, without Coulomb friction."""
    joints = []
    for joint in robot.joints:
        parameters = dict(joint.parameters)
        if smooth:
            parameters["fs"] = 0.0
        joints.append(replace(joint, limits=Limits(), parameters=parameters))
    return replace(robot, joints=tuple(joints))


def compare(
    robot: Robot, *, states: int = 20, deflection: float = 0.01, speeds: tuple[float, float] = (0.2, 3)
) -> float:
    """Return the largest relative difference of accelerations over random states; links and motors apart."""
    values = known_parameters(robot)
    model = mujoco.MjModel.from_xml_string(mjcf_text(with_parameters(robot, values)))
    data = mujoco.MjData(model)
    dynamics = Dynamics(robot, values)
    rng = np.random.default_rng(5)
    n, worst = robot.n, 0.0
    links = [model.joint(name).id for name in robot.joint_names]
    motors = [model.joint(f"{name}_rotor").id for name in robot.joint_names]
    for _ in range(states):
        q, dq, tau = rng.uniform(-1, 1, n), rng.uniform(-2, 2, n), rng.uniform(-20, 20, n)
        theta = np.where(robot.elastic, q + deflection * rng.normal(size=n), q)
        dtheta = np.where(robot.elastic, rng.choice([-1, 1], n) * rng.uniform(*speeds, n), dq)
        data.qpos[model.jnt_qposadr[links]], data.qvel[model.jnt_dofadr[links]] = q, dq
        data.qpos[model.jnt_qposadr[motors]] = theta * robot.gear_ratios
        data.qvel[model.jnt_dofadr[motors]] = dtheta * robot.gear_ratios
        data.ctrl[:] = tau
        mujoco.mj_forward(model, data)
        found = data.qacc[model.jnt_dofadr[links]], data.qacc[model.jnt_dofadr[motors]] / robot.gear_ratios
        reference = accelerations(robot, values, (q, dq, theta, dtheta), tau)
        elids = dynamics.acceleration(q.tolist(), dq.tolist(), theta.tolist(), dtheta.tolist(), tau.tolist())
        for ours, theirs, energies in zip(elids, found, reference, strict=True):
            scale = np.abs(energies).max()
            assert np.abs(ours - energies).max() < 1e-9 * scale  # elid's own forward dynamics
            worst = max(worst, float(np.abs(ours - theirs).max() / scale))
        for k, name in enumerate(robot.joint_names):
            assert data.sensor(f"{name}_q").data[0] == pytest.approx(q[k], abs=1e-12)
            assert data.sensor(f"{name}_theta").data[0] == pytest.approx(theta[k], abs=1e-12)
            assert data.sensor(f"{name}_dtheta").data[0] == pytest.approx(dtheta[k], abs=1e-12)
    return worst


@pytest.mark.parametrize("name", ["planar2", "puma560"])
def test_the_papers_robots_accelerate_alike(name):
    # their published inertias are not those of real bodies: an equal-moving real twin is exported
    assert compare(free(read_robot(name), smooth=True)) < 1e-9


@pytest.mark.parametrize(
    ("dh", "kinds", "own_axes"),
    [("standard", "r", False), ("standard", "rrp", True), ("modified", "rp", True), ("urdf", "rpr", True)],
)
def test_random_robots_accelerate_alike(dh, kinds, own_axes):
    robot = random_robot(3, 5, dh, kinds=kinds, own_axes=own_axes)
    assert compare(free(robot, smooth=True)) < 1e-9


def test_coulomb_friction_is_alike_where_motors_turn_fast_enough_to_be_off_mujocos_stiction():
    robot = free(read_robot("planar2"), smooth=False)
    assert compare(robot, deflection=1e-3, speeds=(1, 3)) < 1e-9
    assert compare(free(robot, smooth=True), deflection=1e-3) < 1e-9


def test_rigid_transmissions_are_kept_to_the_accuracy_of_mujocos_constraints():
    robot = random_robot(4, 4, "standard", rigid=(1, 3))
    assert compare(free(robot, smooth=True)) < 1e-3


def test_a_swing_of_a_second_is_alike():
    robot = free(read_robot("planar2"), smooth=True)
    values = known_parameters(robot)
    model = mujoco.MjModel.from_xml_string(mjcf_text(with_parameters(robot, values)))
    model.opt.timestep = 1e-3
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    links = [model.joint(name).qposadr[0] for name in robot.joint_names]
    motors = [model.joint(f"{name}_rotor").qposadr[0] for name in robot.joint_names]

    def slope(state: np.ndarray) -> np.ndarray:
        q, theta, dq, dtheta = state.reshape(4, 2)
        return np.concatenate(
            [dq, dtheta, *accelerations(robot, values, (q, dq, theta, dtheta), np.array([30.0, 5.0]))]
        )

    state = np.zeros(8)
    data.ctrl[:] = (30, 5)
    for _ in range(500):
        h = 1e-3
        k1 = slope(state)
        k2 = slope(state + h / 2 * k1)
        k3 = slope(state + h / 2 * k2)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(state + h * k3))
        mujoco.mj_step(model, data)
    assert abs(state[0]) > 0.3  # it did swing
    found = np.concatenate([data.qpos[links], data.qpos[motors] / robot.gear_ratios])
    np.testing.assert_allclose(found, state[:4], atol=1e-9)


def test_what_matters_must_be_known_and_positive():
    with pytest.raises(RobotError, match="unknown parameters"):
        mjcf_text(read_robot("kr300"))
    robot = read_robot("planar2")
    values = robot.reference()
    values[robot.parameter_names().index("K1")] = -1
    with pytest.raises(RobotError, match="K1 is -1"):
        mjcf_text(with_parameters(robot, values))
    values = robot.reference()
    values[robot.parameter_names().index("m2")] = -10
    with pytest.raises(RobotError, match="no real bodies"):
        mjcf_text(with_parameters(robot, values))


def test_limits_names_and_undeclared_effects_are_in_the_file(tmp_path):
    robot = read_robot("puma560")
    odd = replace(robot.joints[0], name='a "<b>" & c')
    robot = replace(robot, joints=(odd, *robot.joints[1:]))
    (tmp_path / "r.xml").write_text(mjcf_text(robot), "utf-8")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "r.xml"))
    assert model.joint('a "<b>" & c').range == pytest.approx(robot.joints[0].limits.position)
    assert model.actuator("joint2_motor").ctrlrange == pytest.approx([-186.4, 186.4])
    assert (model.nv, model.nu, model.ntendon) == (12, 6, 6)


@pytest.mark.parametrize("name", ["planar2", "puma560", "random"])
@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
def test_ten_seconds_at_the_files_own_step_keep_the_energy(name, integrator):
    """Without friction and torque, by the file's integrator and, closer, by one of higher order.

    PUMA's wrist rings at 1.1 kHz: half a millisecond made it explode whatever the integrator.
    """
    robot = random_robot(3, 4, "standard") if name == "random" else read_robot(name)
    text = mjcf_text(free(robot, smooth=True))
    assert 'integrator="implicitfast"' in text
    model = mujoco.MjModel.from_xml_string(text.replace("implicitfast", integrator))
    model.dof_damping[:] = 0.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    for joint in robot.joints:
        data.qvel[model.joint(joint.name).dofadr[0]] = 0.3
        data.qvel[model.joint(f"{joint.name}_rotor").dofadr[0]] = 0.3 * joint.gear_ratio
    kinetic, energy = [], []
    while data.time < 10.0:
        mujoco.mj_step(model, data)
        kinetic.append(data.energy[1])
        energy.append(data.energy.sum())
    assert not any(warning.number for warning in data.warning)
    change = (np.array(energy) - energy[0]) / np.max(kinetic)
    least, most = change.min(), change.max()
    assert -(0.01 if integrator == "RK4" else 0.05) < least
    assert most < (0.01 if integrator == "RK4" else 0.05), (least, most)


def test_the_step_follows_the_fastest_mode():
    steps = [float(mjcf_text(read_robot(name)).split('timestep="')[1].split('"')[0]) for name in ("planar2", "puma560")]
    assert steps == [5e-4, 1.25e-4]
