"""The dynamics written out as one function are those of the steps, in plain Python and compiled."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.experiment.simulation import SimulationOptions, kernel, run
from elid_cli.experiment.simulation.integration import System
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Joint, Robot
from tests.model.effects.effect_scenes import spatial

ROBOTS: dict[str, Callable[[], Robot]] = {
    "puma560": lambda: read_robot("puma560"),
    "rigid and sliding": spatial,
}
ENGINES = pytest.mark.parametrize("worth", [0, 10**9], ids=["compiled", "Python"])


@ENGINES
@pytest.mark.parametrize("name", ROBOTS)
def test_the_kernel_is_the_steps(name: str, worth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if worth == 0:
        pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", worth)
    system = System(Dynamics(ROBOTS[name]()), [], 1e-3, 1.0)
    generator = np.random.default_rng(0)
    x = generator.uniform(-0.5, 0.5, system.size).tolist()
    tau = generator.uniform(-5, 5, system.dynamics.robot.n).tolist()
    plain, plain_rates = system.advance(0.0, 1e-4, 5, x, tau), system.accelerations(0.0, x, tau)
    system.prepare(1)
    assert system._kernel is not None
    assert system._kernel.compiled == (worth == 0)
    # the same robot in fewer parameters: the same numbers but for rounding
    close = {"rtol": 1e-11, "atol": 1e-11}
    assert np.allclose(system.advance(0.0, 1e-4, 5, x, tau), plain, **close)
    for found, expected in zip(system.accelerations(0.0, x, tau), plain_rates, strict=True):
        assert np.allclose(found, expected, **close)


@ENGINES
def test_a_mass_matrix_that_is_not_positive_is_named_as_by_the_steps(
    worth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if worth == 0:
        pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", worth)
    robot = read_robot("planar2")
    parameters = robot.reference()
    parameters[robot.parameter_names().index("Izz2")] = -50.0
    system = System(Dynamics(robot, parameters), [], 1e-3, 1.0)
    system.prepare(1)
    with pytest.raises(RobotError, match="not positive definite"):
        system.advance(0.0, 1e-4, 3, [0.1] * system.size, [0.0] * 2)


def rounded() -> Robot:
    """Return four joints whose right angles a file gives in few digits, as exporters write them."""
    values = dict(m=2.0, cx=0.1, cy=0.06, cz=-0.05, Ixx=0.06, Iyy=0.07, Izz=0.08, Ixy=0.01, Ixz=0.01, Iyz=-0.01)
    drive = {"Ja": 0.02, "fs": 0.0, "fv": 0.1}
    spots = [{"alpha": np.pi / 2 * (-1) ** k + 1e-5 * (k + 1), "d": 0.0 if k % 2 else 0.2} for k in range(4)]
    joints = [Joint(f"j{k}", **at, transmission="rigid", parameters=values | drive) for k, at in enumerate(spots)]
    return Robot("rounded", tuple(joints))


def test_right_angles_that_are_rounded_move_as_described() -> None:
    dynamics = Dynamics(rounded())
    q, dq, tau = np.random.default_rng(3).uniform(-1, 1, (3, 4)).tolist()
    found = kernel.Kernel(dynamics, 1).accelerations([*q, *dq], tau)
    wanted = dynamics.solve(q, dq, dq, [0.0] * 4, [0.0] * 4, tau)[0]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_a_joint_that_moves_nothing_is_one_error() -> None:
    nothing = dict.fromkeys(("m", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "Ja", "fs", "fv"), 0.0)
    robot = Robot("empty", (Joint("j1", transmission="rigid", parameters=nothing),))
    with pytest.raises(RobotError, match="mass matrix is singular"):
        run(robot, SimulationOptions(duration=1.0))
