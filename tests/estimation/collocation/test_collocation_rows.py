"""Derivatives of a collocation's equations are those of their residual, however states are taken together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from elid_cli.estimation.collocation.bordered_banded import _sandwich, covariance_at, eliminate_trajectory
from elid_cli.estimation.collocation.problem import Iterate, States, coefficients_to_states
from elid_cli.estimation.collocation.setup import Setup
from elid_cli.estimation.default_fit import fit_log
from elid_cli.estimation.identify import EstimateOptions
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.program import compile_program
from elid_cli.model.regressor import Regressor
from elid_cli.model.tracing import Graph
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import prepare
from tests.estimation.test_identify import PLANAR, noisy

Array = NDArray[np.float64]

CURVE = tuple(EffectSpec("stribeck", "joint1", {"velocity": 0.1, "exponent": e}) for e in (1.0, -1.0))
COUPLED = EffectSpec("velocity_coupling", "joint2")


def robot_of(kind: str) -> Robot:
    robot = read_robot("planar2")
    if kind == "rigid second joint":
        first, second = robot.joints
        return replace(robot, joints=(first, replace(second, transmission="rigid")))
    return replace(robot, effects=(*CURVE, COUPLED)) if kind == "effects" else robot


@pytest.fixture(scope="module", params=["plain", "rigid second joint", "effects"])
def setup(request: pytest.FixtureRequest) -> Setup:
    robot = robot_of(request.param)
    sensors = SensorOptions(position_noise=1e-6, torque_noise_relative=0.01)
    log = simulate(robot_of("plain"), SimulationOptions(duration=6.0, rate=500.0, seed=2, sensors=sensors))
    if request.param == "rigid second joint":  # no spring: one position is all there is
        theta = log.theta.copy()
        theta[:, 1] = np.nan
        log = replace(log, theta=theta)
    model = Regressor(robot)
    return Setup(fit_log(model, find_base(model), prepare(log, robot), EstimateOptions()), coarse=True)


def here(setup: Setup) -> tuple[States, Iterate]:
    values = coefficients_to_states(setup.setting, setup.start.coefficients[0][:40])
    return States(values, 0, 0), setup.start


def test_slopes_by_states(setup: Setup) -> None:
    """Every state moved alone, there and back."""
    states, now = here(setup)
    steps = np.array([1e-6, 1e-6, 1e-4])[:, None] * setup.setting.scale
    found = setup.equations.slopes(states, now.p, now.z, steps)
    assert found.shape == (3, len(setup.rows), len(setup.channels), states.values.shape[2])
    for d in range(3):
        for c in range(len(setup.channels)):
            values = states.values.copy()
            values[d, c] += steps[d, c]
            after = setup.equations.residual(replace(states, values=values), now.p, now.z)
            before = setup.equations.residual(states, now.p, now.z)
            expected = (after - before) / steps[d, c]
            rounding = 1e-15 * np.abs(before).max() / steps[d, c]
            assert np.abs(found[d, :, c] - expected).max() <= 1e-9 * np.abs(expected).max() + 20 * rounding


def test_slopes_by_shapes(setup: Setup) -> None:
    states, now = here(setup)
    assert len(now.z) == (2 if setup.fit.effects else 0)
    if setup.fit.effects is None:
        return
    found = setup.equations.shape_slopes(states, now.p, now.z)
    for k in range(len(now.z)):
        moved = np.array([now.z, now.z])
        moved[:, k] += (1e-5, -1e-5)
        high, low = (setup.equations.residual(states, now.p, z) for z in moved)
        expected = (high - low) / 2e-5
        assert np.abs(expected).max() > 0
        assert np.abs(found[:, k] - expected).max() < 1e-3 * np.abs(expected).max()  # forward, of a step of 1e-4


def test_columns_are_the_slopes_by_the_parameters(setup: Setup) -> None:
    states, now = here(setup)
    columns = setup.equations.columns(states, now.z)
    before = setup.equations.residual(states, 0.0 * now.p, now.z)
    assert np.abs(before).max() < 1e-12 * np.abs(columns).max()
    for k in range(len(now.p)):
        after = setup.equations.residual(states, np.eye(len(now.p))[k], now.z)
        assert np.abs(after - columns[:, k]).max() <= 1e-12 * np.abs(columns).max()


def test_what_is_known_beforehand_is_as_uncertain_as_it_is_assumed(setup: Setup) -> None:
    """Residuals say nothing of it: their scores alone would make it exact."""
    now = setup.start
    size = len(now.p) + len(now.z)
    plain = np.sqrt(np.diag(covariance_at(setup.problem, now, (np.zeros((size, size)), np.zeros(size)))[0]))
    for k in range(0, size, 3):
        known = np.zeros((size, size))
        known[k, k] = (1e6 / plain[k]) ** 2
        told = np.sqrt(covariance_at(setup.problem, now, (known, np.zeros(size)))[0][k, k])
        assert told == pytest.approx(1e-6 * plain[k], rel=1e-3)


def test_what_an_output_reads() -> None:
    graph = Graph(4)
    a, b, c, d = (graph.input(k) for k in range(4))
    shared = a * b
    program = compile_program(graph, [shared + c, -shared, d, 3.0, c, (shared + c) * (a + 1.0)])
    assert program.reads == (0b0111, 0b0011, 0b1000, 0, 0b0100, 0b0111)


def test_scores_of_the_noise_that_is_assumed_are_as_large_as_the_normal_matrix() -> None:
    # then the inverse of the normal matrix is the covariance; what knots are assumed to follow of torques is no noise
    model = Regressor(PLANAR)
    fit = fit_log(model, find_base(model), prepare(noisy(1, 90.0, 0.01), PLANAR), EstimateOptions())
    for setup, least in ((Setup(fit, coarse=True), 1.0), (Setup(fit, coarse=True, followed=1.4), 1.0 / 1.4**2)):
        nothing = np.zeros((len(setup.start.p),) * 2)
        system = eliminate_trajectory(setup.problem, setup.start, (nothing, nothing[0]))
        size = len(system.gradient)
        inverse = np.linalg.inv(system.matrix)
        white = _sandwich(setup.problem, setup.start, [part[:, :size] for part in system.solved], inverse)[2]
        share = np.diag(inverse @ white @ inverse) / np.diag(inverse)
        assert share.max() == pytest.approx(1.0, abs=1e-4 if least == 1.0 else 0.1)
        assert share.min() == pytest.approx(least, rel=1e-4 if least == 1.0 else 0.1)
