"""The equations of a rigid joint hold with what its transmission yields, as an elastic joint moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.regression.scene_with_effects import with_effects
from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, simulate
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.signals import SignalOptions, Signals, prepare
from tests.model.effects.effect_scenes import rigid, spatial

KIND = effect_classes()["transmission_compliance"]
CUTOFF = 3.0
"""Hz; the arm swings on its motors at 8 Hz and more."""


def arm(*stiffness: float) -> Robot:
    """Return two links that gravity swings, with geared motors and no friction."""
    body = {"m": 4.0, "cx": -0.6, "cy": 0.1, "cz": 0.05, "Ixx": 0.1, "Iyy": 0.3, "Izz": 0.25, "Ixy": 0.01,
            "Ixz": -0.02, "Iyz": 0.015}  # fmt: skip
    drive = {"Jm": 1e-4, "fs": 0.0, "fv": 3.0}
    joints = [
        Joint(f"j{k + 1}", a=0.3, alpha=alpha, gear_ratio=60, parameters={**body, **drive, "K": K})
        for k, (alpha, K) in enumerate(zip((1.2, 0.0), stiffness, strict=True))
    ]
    return Robot(name="arm", gravity=(0.0, -9.81, 0.0), joints=tuple(joints))


@pytest.fixture(scope="module")
def elastic() -> Robot:
    return arm(6000.0, 2500.0)


@pytest.fixture(scope="module")
def logged(elastic: Robot) -> Signals:
    """The log's motor side, as a rigid robot's."""
    held = ControlOptions(continuous=True)  # held torques are not the log's between its samples
    log = simulate(elastic, SimulationOptions(duration=8.0, rate=500.0, seed=3, control=held))
    return prepare(replace(log, q=np.full_like(log.q, np.nan)), rigid(elastic), SignalOptions(cutoff=CUTOFF))


def left(robot: Robot, signals: Signals, share: float) -> float:
    """Return the torque that is left, rms, where the links are behind by a share of what they are."""
    plain, model = rigid(robot), Regressor(rigid(robot))
    parameters = plain.reference()
    compliance = [share / robot.joints[k].parameters["K"] for k in range(robot.n)]
    pairs: list[tuple[Effect, np.ndarray]] = [(KIND(k), np.array([c])) for k, c in enumerate(compliance)]
    scene = with_effects(scene_of(model, signals, parameters), pairs if share else [])
    torque = signals.tau.T - np.stack([
        values @ parameters
        for item, values in zip(model.equations.rows, model.dense(signals.motion, model.equations), strict=True)
        if item.row.kind != "link"
    ])  # fmt: skip
    for effect, linear in pairs if share else ():
        for row, columns in effect.columns(scene).items():
            torque[row.joint] -= linear @ columns
    return float(np.sqrt(np.mean(signals.filter.apply(torque, signals.margin) ** 2)))


def test_what_an_elastic_joint_leaves_in_rigid_equations_is_the_effect(elastic: Robot, logged: Signals) -> None:
    none, half, whole, twice = (left(elastic, logged, share) for share in (0.0, 0.5, 1.0, 2.0))
    assert whole < 0.01 * none
    assert half == pytest.approx(0.5 * none, rel=0.01)
    assert twice == pytest.approx(none, rel=0.01)


def test_a_rotor_that_the_bodies_count_in_does_not_ride_on_the_link(elastic: Robot, logged: Signals) -> None:
    plain = rigid(elastic)
    lumped = plain.reference()
    names, inertia = plain.parameter_names(), 1e-4 * 60**2
    moved = lumped.copy()  # its motor counted to its body
    moved[names.index(StandardParameter("Jm", 0))] = 0.0
    scenes = [scene_of(Regressor(plain), logged, values) for values in (lumped, moved)]
    assert scenes[0].with_bodies.get(0, 0.0) == 0.0
    assert scenes[1].with_bodies[0] == pytest.approx(inertia)


def test_it_is_none_of_elastic_joints() -> None:
    assert [KIND.applies(spatial(), k) for k in range(3)] == [False, True, False]
    assert "K is a parameter" in KIND.unfit(spatial(), 0)


def test_summary_says_the_stiffness() -> None:
    told = KIND.summary_of([{"compliance": 1 / 2500}], [{"compliance": 1 / 25000}])
    assert "stiffness 2500 N·m/rad" in told
