"""`--physical`: feasible whatever the noise, faithful to the data, the reference where the data say nothing."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.estimation.identify import Identification, identify
from elid_cli.estimation.physical.nearest import PhysicalParameters, make_physical
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.consistency import consistency
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.inertia import pseudo_inertia
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Array, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

POSES = 200


@pytest.fixture(scope="module")
def physical(found: Identification) -> PhysicalParameters:
    return make_physical(found)


def test_every_link_without_its_rotor_is_a_real_body(physical: PhysicalParameters) -> None:
    assert_real(physical.robot, physical.values)


def test_rotors_and_springs_are_positive_and_friction_is_not_negative(physical: PhysicalParameters) -> None:
    for name, value in zip(physical.robot.parameter_names(), physical.values, strict=True):
        if name.startswith(("Jm", "K", "m")):
            assert value > 0, name
        if name.startswith("f"):
            assert value >= 0, name


def test_the_mass_matrix_is_positive_definite_at_random_poses(physical: PhysicalParameters) -> None:
    assert least_eigenvalue(physical, POSES) > 0


def test_prediction_is_hardly_given_up(physical: PhysicalParameters) -> None:
    assert physical.loss < 0.02
    assert physical.chi2_before <= physical.chi2_after < 1.02 * physical.chi2_before
    assert not physical.contradiction


def test_a_negative_friction_is_named_and_mended(found: Identification, physical: PhysicalParameters) -> None:
    negative = [found.base.names[k] for k in np.flatnonzero(found.estimate < 0) if found.base.names[k][0] in "fKJ"]
    assert set(negative) <= {item.name for item in physical.impossible}
    assert all(item.estimate < 0 <= item.value for item in physical.impossible)


def test_base_parameters_that_are_possible_are_reproduced(planar: Robot, clean: Recording) -> None:
    found = identify(planar, prepare(clean, planar))
    physical = make_physical(found)
    possible = found.reference > 0
    assert np.allclose(physical.base[possible], found.estimate[possible], rtol=0.05)
    assert physical.loss < 0.01


def test_what_the_data_leave_open_keeps_the_reference(planar: Robot, clean: Recording) -> None:
    real = make_physical(identify(planar, prepare(clean, planar))).refined_robot()
    log = simulate(real, SimulationOptions(duration=6.0, rate=500.0, seed=5))
    again = make_physical(identify(real, prepare(log, real)))
    open_ = [k for k, origin in enumerate(again.origin) if origin == "reference"]
    assert open_
    scale = consistency(real, real.reference()).scales.sizes
    assert np.max(np.abs(again.values - real.reference())[open_] / scale[open_]) < 1e-4
    assert again.margin > 0


def test_without_references_a_robot_is_found_and_said_to_be_assumed(planar: Robot, noisy: Recording) -> None:
    bare = replace(planar, joints=tuple(replace(joint, parameters={}) for joint in planar.joints))
    physical = make_physical(identify(bare, prepare(noisy, bare)))
    assert_real(bare, physical.values)
    assert "assumed" in physical.origin
    assert "reference" not in physical.origin
    assert physical.loss < 0.02


def test_a_log_with_the_wrong_sign_contradicts_a_physical_robot(planar: Robot, noisy: Recording) -> None:
    physical = make_physical(identify(planar, prepare(replace(noisy, tau=-noisy.tau), planar)))
    assert physical.contradiction
    assert {"Jm1", "Jm2"} <= {item.name for item in physical.impossible}
    assert_real(planar, physical.values)


def test_the_covariance_alone_serves_where_no_data_are_kept(found: Identification) -> None:
    physical = make_physical(replace(found, triangles=None))
    assert_real(found.robot, physical.values)
    assert np.nanmax(np.abs(physical.moved)) < 3
    assert physical.error_after == {}


def test_a_combination_is_positive_exactly_where_bodies_make_it_so() -> None:
    robot = read_robot("planar2")
    cones = consistency(robot, robot.reference())
    names = robot.parameter_names()

    def combination(**terms: float) -> Array:
        return np.array([terms.get(name, 0.0) for name in names])

    assert cones.positive_only(combination(K1=1))
    assert cones.positive_only(combination(Ixx2=1, Iyy2=1, Izz2=-1))  # the triangle inequality
    assert not cones.positive_only(combination(Ixx2=1, Iyy2=0.9, Izz2=-1))
    assert not cones.positive_only(combination(cx1=1))
    assert cones.positive_only(combination(m2=1, Izz2=1, cx2=2))  # m + Izz >= 2 |cx| by the parallel axis
    assert not cones.positive_only(combination(m2=1, Izz2=1, cx2=2.1))
    assert cones.positive_only(combination(Izz1=1, Jm2=-1))  # body 1 contains rotor 2
    assert not cones.positive_only(combination(Izz1=1, Jm2=-1.01))


@pytest.mark.parametrize("name", ["planar2", "puma560", "kr300", "emps"])
def test_the_start_that_rescues_rounding_is_inside_for_every_robot(name: str) -> None:
    robot = read_robot(name)
    cones = consistency(robot, robot.reference())
    generator = np.random.default_rng(0)
    for _ in range(20):
        assert cones.slack(cones.interior(generator.standard_normal(len(cones.scales.sizes)))) > 0


def test_a_missing_solver_names_the_extra(found: Identification, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(UsageError) as caught:
        make_physical(found)
    assert "elid[physical]" in caught.value.hint


def assert_real(robot: Robot, values: Array) -> None:
    """Check by hand, without the code under test, that links without the rotors they carry are real bodies."""
    known = dict(zip(robot.parameter_names(), values, strict=True))
    for i in range(1, robot.n + 1):
        matrix = pseudo_inertia(np.array([known[f"{kind}{i}"] for kind in LINK_PARAMETERS]))
        if i < robot.n:
            z = np.asarray(robot.joints[i].motor_axis)
            matrix[:3, :3] -= known[f"Jm{i + 1}"] / 2 * (np.eye(3) - np.outer(z, z))
        assert np.linalg.eigvalsh(matrix)[0] > 0, f"body {i}"


def least_eigenvalue(physical: PhysicalParameters, poses: int) -> float:
    """Return the smallest eigenvalue of the mass matrix, scaled to a unit diagonal, over random poses."""
    dynamics = Dynamics(physical.robot, physical.values)
    generator = np.random.default_rng(7)
    least = np.inf
    for q in generator.uniform(-np.pi, np.pi, (poses, physical.robot.n)):
        matrix = dynamics.mass_matrix(q.tolist())
        size = np.sqrt(np.diag(matrix))
        least = min(least, float(np.linalg.eigvalsh(matrix / np.outer(size, size))[0]))
    return least


def test_no_joint_gives_up_two_percent_where_stiffnesses_drown_in_encoder_noise() -> None:
    """The worst of fifty logs of `tests/system/reproduce/physical.py`: encoders of 1e-4 rad, wrist springs refused."""
    robot = read_robot("puma560")
    sensors = SensorOptions(position_noise=1e-4, torque_noise_relative=0.005)
    log = simulate(robot, SimulationOptions(duration=12.0, rate=250.0, seed=21, sensors=sensors))
    found = identify(robot, prepare(log, robot))
    assert "refused" in found.verdict
    physical = make_physical(found)
    assert max(physical.rises.values()) < 0.02
    assert physical.margin > 0
