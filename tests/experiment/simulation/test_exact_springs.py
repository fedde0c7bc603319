"""Steps in which springs are exact: the functions they are made of, a motion known in closed form, and stiff arms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from elid_cli.experiment.simulation import SimulationOptions, closed_loop, exponential, kernel, run
from elid_cli.experiment.simulation.integration import System
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot, robot_from_text

ENGINES = pytest.mark.parametrize("worth", [0, 10**9], ids=["compiled", "Python"])
STIFF = """
name: stiff
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {name: a, a: 0, alpha: 0, d: 0, theta: 0, gear_ratio: 100, transmission: elastic,
     parameters: {m: 1, cx: 0, cy: 0, cz: 0, Ixx: 0, Iyy: 0, Izz: 4.0e-5, Ixy: 0, Ixz: 0, Iyz: 0,
                  Jm: 2.0e-5, fs: 0, fv: 0, K: 2000}}
"""


@pytest.mark.parametrize("size", [0.0, 0.1, 30.0])
def test_functions_of_the_exponential(size: float) -> None:
    """The exponential of a block matrix holds φ1 to φ3 in its first row (Van Loan, 1978)."""
    matrix = size * np.random.default_rng(0).uniform(-1, 1, (4, 4)) / 4
    columns = slice(1, None)
    for factor, (e, phis) in zip((1.0, 2.0), exponential._phi(matrix, columns), strict=True):
        whole = np.zeros((16, 16))
        whole[:4, :4] = factor * matrix
        for k in range(3):
            whole[4 * k : 4 * k + 4, 4 * k + 4 : 4 * k + 8] = np.eye(4)
        expected = expm(whole)[:4].reshape(4, 4, 4).transpose(1, 0, 2)
        for one, other in zip([e, *phis], [expected[0], *expected[1:, :, columns]], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(expected[0]).max())


@ENGINES
def test_a_single_joint_moves_as_the_closed_form_says(worth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint of 7090 rad/s under a held torque, 200 steps of a millisecond: about 1100 radians of its mode."""
    if worth == 0:
        pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", worth)
    dynamics = Dynamics(robot_from_text(STIFF, "stiff"))
    system = System(dynamics, [], 1e-3, 1.0)
    system.prepare(1)
    system.hold(1e-3, 100, 1.0)
    link, motor, stiffness, torque = 4e-5, 0.2, 2000.0, 3.0
    x = [0.1, 0.101, 0.2, 0.3]
    for _ in range(200):
        x = system.advance(0.0, 1e-3, 1, x, [torque])
    t, total = 0.2, link + motor
    mode = math.sqrt(stiffness * (1 / link + 1 / motor))
    centre = (link * 0.1 + motor * 0.101) / total + (link * 0.2 + motor * 0.3) / total * t + 0.5 * torque / total * t**2
    rest = torque / motor / mode**2  # θ - q at which the torque accelerates both alike
    apart = rest + (0.001 - rest) * math.cos(mode * t) + 0.1 / mode * math.sin(mode * t)
    expected = [centre - motor / total * apart, centre + link / total * apart]
    np.testing.assert_allclose(x[:2], expected, rtol=0, atol=1e-9)


@ENGINES
def test_a_stiff_arm_is_no_further_from_the_truth_than_with_short_classical_steps(
    worth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if worth == 0:
        pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", worth)
    robot, options = read_robot("puma560"), SimulationOptions(duration=0.15, seed=2)
    found = run(robot, options)
    with monkeypatch.context() as patch:
        patch.setattr(System, "hold", lambda *_: None)
        classical = run(robot, options)
        patch.setattr(kernel, "WORTH", 0)
        true = run(robot, replace(options, accuracy=8.0))
    assert true.step < classical.step / 7

    def error(one: object, name: str) -> float:
        away = getattr(one.motion, name) - getattr(true.motion, name)  # type: ignore[attr-defined]
        return float(np.sqrt(np.mean(away**2, axis=0)).max())

    for name in ("q", "dq", "ddq"):
        assert error(found, name) < 0.2 * error(classical, name)
    for name in ("theta", "dtheta"):
        assert error(found, name) < 1.2 * error(classical, name)


@pytest.mark.parametrize("rate", [1000.0, 200.0], ids=["every period logged", "a third of them"])
def test_the_compiled_loop_does_the_same_as_period_by_period(rate: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, over more than one chunk of periods, and where the loop gives up on the way."""
    pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", 0)
    robot, options = robot_from_text(STIFF, "stiff"), SimulationOptions(duration=2.5, rate=rate, seed=3)
    looped = run(robot, options)
    assert looped.exact_springs
    follow = exponential.ExactSprings.follow

    def shorter(springs: exponential.ExactSprings, *given: Any) -> int:
        x, wanted, law, noted, moving, runaway = given
        return follow(springs, x, wanted, law, tuple(values[:7] for values in noted), min(moving, 7), runaway)

    for name, value in (("follow", shorter), ("looped", None)):
        with monkeypatch.context() as patch:
            patch.setattr(exponential.ExactSprings if name == "follow" else System, name, value)
            other = run(robot, options)
        for field in ("t", "q", "dq", "ddq", "theta", "dtheta", "ddtheta"):
            np.testing.assert_array_equal(getattr(looped.motion, field), getattr(other.motion, field))
        for field in ("tau", "tau_link"):
            np.testing.assert_array_equal(getattr(looped, field), getattr(other, field))


@ENGINES
def test_what_runs_away_is_told_as_before(worth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from elid_cli.errors import RobotError
    from elid_cli.experiment.simulation import ControlOptions

    if worth == 0:
        pytest.importorskip("numba")
    monkeypatch.setattr(kernel, "WORTH", worth)
    monkeypatch.setattr(closed_loop, "RUNAWAY", 1.8)  # a link passes it in motion
    with pytest.raises(RobotError, match=r"runs away at 0\.759 s"):
        run(read_robot("puma560"), SimulationOptions(duration=3.0, seed=2, control=ControlOptions(feedforward="none")))
