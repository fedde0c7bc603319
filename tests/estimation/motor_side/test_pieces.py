"""The motor side's rows piece by piece, and the motion that a climb starts them from."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.motor_side.climb import Climb
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.search import Setting
from elid_cli.estimation.motor_side.stretch import stretch_of
from elid_cli.estimation.motor_side.unknowns import RotorPrior
from tests.system.motor_arms import Case, inertias, motor_log, random_motor_arm, told_robot
from tests.system.plain_arms import Arm


@pytest.fixture(scope="module")
def arm() -> Arm:
    return random_motor_arm(np.random.default_rng([47, 77]), 3)


@pytest.fixture(scope="module")
def setting(arm: Arm) -> Setting:
    samples = stretch_of(motor_log(arm, 47, Case(duration=4.0)), np.arange(3))
    assert not isinstance(samples, str)
    rotor = inertias(arm)[1]
    return Setting(samples, LinkSide(told_robot(arm, 47)), RotorPrior(rotor, 0.2 * rotor))


def test_pieces_give_the_derivatives_of_differences(arm: Arm, setting: Setting) -> None:
    """Low-pass, spring, damper, lost motion and coupled rotors, near both ends and within."""
    problem = setting.problem(("load", "bumps", "lost"), np.full(3, 3.0))
    problem.filter_torque(setting.cutoff, 0.003)
    generator = np.random.default_rng(9)
    x, at, pieces = np.zeros(setting.unknowns.size), setting.unknowns, problem.pieces
    x[at["p"]], x[at["J"]] = generator.uniform(0.1, 1.0, len(at["p"])), setting.rotors.value
    x[at["fv"]], x[at["fs"]], x[at["load"]], x[at["bumps"]] = 1.0, 0.5, 0.05, 0.2
    x[at["c"]], x[at["damping"]], x[at["lost"]] = 1 / arm.stiffness, 1e-3, 1e-4
    coefficients = problem.spline.fit(setting.log.theta)
    _, _, now = problem.residual(coefficients, x)
    whole = problem.by_motion(now, x, problem.linearised(now, x), slice(None))
    for knot in (1, 40, problem.spline.count - 2):
        for joint in range(3):
            step = np.zeros_like(coefficients)
            step[knot, joint] = 1e-6
            (ahead, torque_ahead, _), (back, torque_back, _) = (
                problem.residual(coefficients + sign * step, x) for sign in (1, -1)
            )
            by_theta = (back - ahead) * problem.log.theta_noise / 2e-6
            by_tau = (torque_back - torque_ahead) * problem.tau_noise / 2e-6
            wanted = pieces.rows_of(by_theta, by_tau, slice(None))
            place = (knot - pieces.first_knot) * 3 + joint
            inside = (knot >= pieces.first_knot) & (knot < pieces.first_knot + pieces.knots)
            assert not wanted[~inside].any()
            found = whole[np.flatnonzero(inside), :, place[inside]]
            assert np.abs(found - wanted[inside]).max() < 1e-5 * np.abs(wanted).max()


def test_the_motion_of_a_start_stays_near_the_motors_at_both_ends(setting: Setting) -> None:
    """Differences of high order throw it off there by many turns, from where no fit comes back."""
    climb = Climb(setting.log, setting.unknowns, setting.rotors, setting.band)
    start = climb.ascend()
    deflection = np.abs(climb.motion(start, setting.log.t) - setting.log.theta)
    inner = deflection[50:-50].max(axis=0)
    assert np.all(deflection[:50].max(axis=0) < 2 * inner)
    assert np.all(deflection[-50:].max(axis=0) < 2 * inner)
