"""The motor side's rows piece by piece, and the motion that a climb starts them from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.estimation.motor_side.banded import BandedFactor
from elid_cli.estimation.motor_side.by_motion import ByMotion
from elid_cli.estimation.motor_side.climb import Climb
from elid_cli.estimation.motor_side.latent import Latent
from elid_cli.estimation.motor_side.link_sensors import sensors_of
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.pieces import Pieces
from elid_cli.estimation.motor_side.setting import Setting
from elid_cli.estimation.motor_side.stretch import stretch_of
from elid_cli.estimation.motor_side.unknowns import RotorPrior
from tests.system.motor_arms import Case, inertias, motor_log, random_motor_arm, told_robot
from tests.system.plain_arms import Arm


@pytest.fixture(scope="module")
def arm() -> Arm:
    return random_motor_arm(np.random.default_rng([47, 77]), 3)


@pytest.fixture(scope="module")
def setting(arm: Arm) -> Setting:
    return setting_of(arm)


def setting_of(arm: Arm) -> Setting:
    log, robot = motor_log(arm, 47, Case(duration=4.0, gyros=(0, 2), accelerometers=(1, 2))), told_robot(arm, 47)
    samples = stretch_of(log, np.arange(3), sensors_of(robot, log, range(3)))
    assert not isinstance(samples, str)
    rotor = inertias(arm)[1]
    return Setting(samples, LinkSide(robot, [own.joints for own in samples.sensors]), RotorPrior(rotor, 0.2 * rotor))


def problem_of(setting: Setting) -> tuple[Latent, Array, Array]:
    """Return the problem with all columns, some unknowns that are not zero, and coefficients."""
    problem = setting.problem(("load", "bumps", "lost"), np.full(3, 3.0))
    problem.filter_torque(setting.cutoff, 0.003)
    x, at = np.zeros(setting.unknowns.size), setting.unknowns
    x[at["p"]], x[at["J"]] = np.random.default_rng(9).uniform(0.1, 1.0, len(at["p"])), setting.rotors.value
    x[at["fv"]], x[at["fs"]], x[at["load"]], x[at["bumps"]] = 1.0, 0.5, 0.05, 0.2
    x[at["c"]], x[at["damping"]], x[at["lost"]] = 1e-4, 1e-3, 1e-4
    sensors = at.of_sensors
    x[sensors] = np.random.default_rng(3).uniform(-1e-3, 2e-3, len(sensors)) + problem.prior_mean[sensors]
    return problem, x, problem.spline.fit(setting.log.theta)


def differences(problem: Latent, x: Array, coefficients: Array, step: Array) -> list[tuple[Pieces, Array]]:
    """Return what a step of the coefficients moves the rows by, group by group."""
    (ahead, torque_ahead, _), (back, torque_back, _) = (
        problem.residual(coefficients + sign * step, x) for sign in (1, -1)
    )
    rows = (back - ahead) * problem.log.theta_noise / 2, (torque_back - torque_ahead) * problem.tau_noise / 2
    kinds = problem.positions, problem.torques
    return [(pieces, pieces.of(moved, slice(None))) for pieces, moved in zip(kinds, rows, strict=True)]


@pytest.mark.parametrize("less", [1.0, 15.0])
def test_pieces_give_the_derivatives_of_differences(arm: Arm, less: float) -> None:
    """Low-pass, spring, damper, lost motion and coupled rotors, near both ends and within."""
    setting = setting_of(replace(arm, gear=arm.gear / less, rotor=arm.rotor * less**2))
    problem, x, coefficients = problem_of(setting)
    assert problem.levels == 2
    now = problem.model(coefficients, x)
    by_motion = ByMotion(problem, now, x, problem.friction_slopes(now, x))
    for knot in (1, 40, problem.spline.count - 2):
        for joint in range(3):
            step = np.zeros_like(coefficients)
            step[knot, joint] = 1e-7
            for pieces, moved in differences(problem, x, coefficients, step):
                place = (knot - pieces.first_knot) * 3 + joint
                inside = (knot >= pieces.first_knot) & (knot < pieces.first_knot + pieces.knots)
                assert not moved[~inside].any()
                found = 1e-7 * by_motion.rows(pieces, slice(None))[np.flatnonzero(inside), :, place[inside]]
                assert np.abs(found - moved[inside]).max() < 5e-5 * np.abs(moved).max() + 1e-10  # rounding


def test_a_banded_factor_solves() -> None:
    generator = np.random.default_rng(1)
    lower = np.tril(np.triu(generator.normal(size=(23, 23)), -5)) + 4 * np.eye(23)
    matrix, sides = lower @ lower.T, generator.normal(size=(23, 2))
    band = np.stack([np.r_[np.zeros(5 - k), np.diag(matrix, 5 - k)] for k in range(6)])
    factor = BandedFactor(band)
    half = factor.forward(sides)
    assert half.T @ half == pytest.approx(sides.T @ np.linalg.solve(matrix, sides), rel=1e-10)
    assert factor.back(half) == pytest.approx(np.linalg.solve(matrix, sides), rel=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        BandedFactor(-band)


def test_the_motion_of_a_start_stays_near_the_motors_at_both_ends(setting: Setting) -> None:
    """Differences of high order throw it off there by many turns, from where no fit comes back."""
    climb = Climb(setting.log, setting.unknowns, setting.rotors, setting.band)
    start, _ = climb.ascend()
    deflection = np.abs(climb.motion(start, setting.log.t) - setting.log.theta)
    inner = deflection[50:-50].max(axis=0)
    assert np.all(deflection[:50].max(axis=0) < 2 * inner)
    assert np.all(deflection[-50:].max(axis=0) < 2 * inner)
