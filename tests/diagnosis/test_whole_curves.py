"""Friction curves of two terms: the term that hides under the noise is told by collocation, and only where it is."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.diagnosis.search import friction_curves as whole_curves
from elid_cli.diagnosis.search.by_collocation import Collocated, collocated
from elid_cli.estimation.validation.prediction import validate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects.scene import DIRECTION_WIDTH
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.estimation.test_curve_valleys import logged
from tests.system.reproduce import inverse_logs
from tests.system.reproduce.inverse_logs import Laws, World
from tests.system.reproduce.own_case import error
from tests.system.reproduce.paper_logs import FRICTION, log_of, motion_of, with_friction

NOISE = 80.0


def bare() -> Robot:
    return replace(read_robot("planar2"), effects=())


def diagnosed(friction: Robot, seed: int, *only: str, rates: bool = False) -> Diagnosis:
    recording, accelerations = log_of(motion_of(friction, seed), NOISE, seed, rates=rates)
    return diagnose(
        bare(),
        prepare(recording, bare(), SignalOptions.for_diagnosis(1 / recording.dt), accelerations),
        DiagnoseOptions(only=only),
    )


@pytest.fixture(scope="module")
def papers() -> Diagnosis:
    """Eq. (43)'s friction at both joints, 8.9 s, positions only."""
    return diagnosed(with_friction(read_robot("planar2"), known=True), 6)


def test_the_papers_own_case(papers: Diagnosis) -> None:
    base = find_base(Regressor(bare()))
    truth = base.values(bare().reference())
    before, after = (
        error(base.transform @ state.standard, truth) for state in (papers.state_before, papers.state_after)
    )
    assert before > 0.1
    assert after < 0.015
    assert {(e.effect, e.joint) for e in papers.effects} == {("stribeck", "joint1"), ("stribeck", "joint2")}
    assert len(papers.effects) == 4


def test_its_terms_are_those_of_eq_43(papers: Diagnosis) -> None:
    for effect in papers.effects:
        _, _, f3, f4, f5, f6 = FRICTION[("joint1", "joint2").index(effect.joint or "")]
        amplitude, velocity = (-f3, f4) if effect.parameters["exponent"] > 0 else (-f5, 1 / f6)
        assert effect.parameters["amplitude"] == pytest.approx(amplitude, abs=0.06)
        assert effect.parameters["velocity"] == pytest.approx(velocity, rel=0.25)


def test_the_refined_robot_holds_the_collocations_values(papers: Diagnosis) -> None:
    again = validate(papers.refined, papers.state_after.log.raw, papers.chosen)
    for name, item in papers.validation_after.error.items():
        assert again.error[name].rms == item.rms
    base = find_base(Regressor(bare()))
    held = base.values(papers.refined.reference())
    assert held == pytest.approx(base.transform @ papers.state_after.standard, rel=1e-6, abs=1e-9)


def test_shifts_are_counted_in_the_collocations_errors(papers: Diagnosis) -> None:
    friction = {m.name: m for m in papers.moved}
    for name in ("fs1", "fs2"):
        assert abs(friction[name].deviations) > 3
        assert np.isfinite(friction[name].deviations)


def test_a_joint_without_the_curve_gets_none() -> None:
    made, _, signals = logged(1, 90.0)
    found = diagnose(made.robot, signals, DiagnoseOptions(only=("stribeck",)))
    assert {e.joint for e in found.effects} == {"j1"}


@pytest.mark.parametrize("looked_at", [False, True], ids=["the model is obeyed", "completed all the same"])
def test_a_curve_of_one_term_stays_one(looked_at: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that term alone obeys the model no other is tried; and were it tried, the log would not show it."""
    made = inverse_logs.make(6, 1, rate=500.0, duration=8.0)
    friction, velocity = made.truth.joints[0].parameters["fs"], 0.1 * made.sizes[0].speed

    def curve(world: World) -> np.ndarray:
        direction = np.tanh(world.dtheta / DIRECTION_WIDTH)
        fading = 0.8 * np.exp(-np.abs(world.dtheta) / velocity)
        return friction * (direction * (1.0 + fading) - np.sign(world.dtheta))

    signals = inverse_logs.log_of(made, Laws(motor=[curve]))
    log = inverse_logs.recorded(made, signals, db=NOISE, counts=0.0, torque=0.0, colour=0.0, seed=6)
    tried: list[int] = []

    def counted(*arguments: Any) -> Collocated | None:
        tried.append(len(arguments[1]))
        return collocated(*arguments)

    monkeypatch.setattr(whole_curves, "collocated", counted)
    if looked_at:
        monkeypatch.setattr(whole_curves, "_obeyed", lambda alone: False)
    found = diagnose(
        made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(500.0)), DiagnoseOptions(only=("stribeck",))
    )
    assert tried[0] == 1
    assert (len(tried) > 1) == looked_at
    (effect,) = found.effects
    assert (effect.effect, effect.joint, effect.collocated) == ("stribeck", "j1", False)
    assert effect.parameters["exponent"] == 1.0
    assert effect.parameters["velocity"] == pytest.approx(velocity, rel=0.05)
    assert effect.parameters["amplitude"] == pytest.approx(0.8 * friction, rel=0.05)


@pytest.mark.parametrize(("left", "tried"), [(0.66, 1), (0.4, 3)])
def test_other_curves_are_tried_where_the_usual_ones_take_a_good_part(
    left: float, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What curves at every joint leave as it was is no friction, and every further trial takes long."""
    asked: list[dict[int, Any]] = []

    def found(state: object, curves: dict[int, Any], *rest: object) -> Any:
        asked.append(curves)
        return SimpleNamespace(excess=left, training=1.0)

    monkeypatch.setattr(whole_curves, "_completed", lambda state, curves: (curves,))
    monkeypatch.setattr(whole_curves, "collocated", found)
    alone: Any = SimpleNamespace(excess=0.67)
    curves: Any = {0: ("exponential", "Gaussian"), -2: ("exponential", "Gaussian")}
    state: Any = None
    whole_curves._best(state, alone, curves, lambda part: None)
    assert len(asked) == tried
