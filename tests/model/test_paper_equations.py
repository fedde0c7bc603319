"""The batched, traced regressor against the paper's equations as printed (paper_equations.py)."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.motion import random_motion
from tests.model import paper_equations as paper
from tests.robot.random_robots import random_robot

ROBOTS = {
    "planar2": read_robot("planar2"),
    "puma560": read_robot("puma560"),
    "standard": random_robot(21, 5, "standard", own_axes=True),
    "modified": random_robot(22, 4, "modified", own_axes=True),
    "sliding": random_robot(23, 5, "standard", kinds="rpr", own_axes=True),
    "urdf": random_robot(24, 4, "urdf", kinds="rrp", own_axes=True),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_regressor_is_equation_13(name: str) -> None:
    robot = ROBOTS[name]
    model = Regressor(robot)
    motion = random_motion(robot.n, robot.elastic, 8, seed=31)
    found = model.dense(motion, model.equations)
    expected = np.stack(
        [
            paper.regressor(
                robot, motion.q[k], motion.dq[k], motion.ddq[k], motion.theta[k], motion.dtheta[k], motion.ddtheta[k]
            )
            for k in range(motion.samples)
        ],
        axis=1,
    )
    assert found.shape == expected.shape == (2 * robot.n, 8, 14 * robot.n)
    size = np.abs(expected).max(axis=(0, 1)).clip(min=1e-3)  # column by column: 1e-9 of what the column reaches
    np.testing.assert_array_less(np.abs(found - expected).max(axis=(0, 1)) / size, 1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrix_is_equation_8(name: str) -> None:
    robot = ROBOTS[name]
    dynamics = Dynamics(robot)
    values = dict(zip(dynamics.model.names, dynamics.parameters.tolist(), strict=True))
    for q in np.random.default_rng(32).uniform(-3, 3, (5, robot.n)):
        expected = paper.inertia(robot, paper.Kinematics(robot, q), values)
        np.testing.assert_allclose(dynamics.mass_matrix(q.tolist()), expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", ["puma560", "sliding", "urdf"])
def test_the_papers_own_regressors_belong_to_its_matrices(name: str) -> None:
    """Y_H^(k) Π = H^(k) dq̄ (eqs. 9-11 against 23-28): guards the reference against its own misprints."""
    robot = ROBOTS[name]
    n = robot.n
    generator = np.random.default_rng(33)
    q, dq, dtheta = generator.uniform(-2, 2, (3, n))
    values = generator.normal(size=14 * n)
    p = dict(zip(robot.parameter_names(), values.tolist(), strict=True))
    at = paper.Kinematics(robot, q)
    for k in range(n):
        ahead, behind = (paper.inertia(robot, paper.Kinematics(robot, q + h * np.eye(n)[k]), p) for h in (1e-5, -1e-5))
        H = paper.inertia_derivative(robot, at, p, k)
        np.testing.assert_allclose(H, (ahead - behind) / 2e-5, atol=1e-5 * np.abs(H).max() + 1e-7)
        product = paper.derivative_regressor(robot, at, dq, dtheta, k) @ values
        np.testing.assert_allclose(product, H @ np.concatenate([dq, dtheta]), rtol=1e-9, atol=1e-9)
