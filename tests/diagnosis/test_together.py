"""Effects of one joint that are worth it together only; sizes beside a factor on the torque; curves that do harm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search import friction_curves
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import screen
from elid_cli.diagnosis.search.steps import Step
from elid_cli.diagnosis.search.together import worth_together
from elid_cli.model.effects import effect_classes
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals, prepare
from tests.estimation.test_unsaid_causes import made_rigid, scaled
from tests.system.reproduce.inverse_logs import Laws, Made, World, laws_of, log_of, make, recorded

JOINT, RATE = 1, 250.0


def signals_with(made: Made, laws: Laws, torque: float = 0.004) -> Signals:
    log = recorded(made, log_of(made, laws), db=0.0, counts=2.0**18, torque=torque, colour=0.0, seed=1)
    return prepare(log, made.robot, SignalOptions.for_diagnosis(RATE))


@pytest.fixture(scope="module")
def lacking() -> tuple[State, dict[str, Candidate]]:
    """The model without two effects of one joint, and the candidates for that joint."""
    made = make(3, 2, rate=RATE, duration=12.0)
    one, other = (laws_of(name, made, JOINT) for name in ("cubic_stiffness", "stribeck"))
    log = divided(made.robot, signals_with(made, replace(one, motor=other.motor)))
    state = refreshed(fit(log, ()))
    names = ("cubic_stiffness", "stribeck", "torque_ripple", "asymmetric_coulomb")
    found = screen(state, {name: effect_classes()[name] for name in names})
    return state, {c.effect.name: c for c in found if c.effect.joint == JOINT}


def steps_to(at_joint: dict[str, Candidate], *names: str) -> list[Step]:
    return [Step(at_joint[name], ()) for name in names]


def test_two_effects_of_a_joint_are_accepted_together(lacking: tuple[State, dict[str, Candidate]]) -> None:
    state, at_joint = lacking
    friction = 0.5 * make(3, 2, rate=RATE, duration=12.0).truth.joints[JOINT].parameters["fs"]
    found = worth_together(state, steps_to(at_joint, "asymmetric_coulomb", "stribeck", "cubic_stiffness"))
    assert found is not None
    grown, steps = found
    assert {step.candidate.effect.name for step in steps} == {"cubic_stiffness", "stribeck"}
    values = {effect.name: grown.named(k) for k, effect in enumerate(grown.effects)}
    assert values["cubic_stiffness"]["cubic"] > 0
    assert values["stribeck"]["amplitude"] == pytest.approx(friction, rel=0.2)


def test_an_effect_that_is_not_needed_comes_with_no_other(lacking: tuple[State, dict[str, Candidate]]) -> None:
    state, at_joint = lacking
    assert worth_together(state, steps_to(at_joint, "asymmetric_coulomb", "cubic_stiffness")) is None
    assert worth_together(state, steps_to(at_joint, "cubic_stiffness")) is None


def test_a_factor_on_a_torque_is_on_the_effects_beside_it() -> None:
    """The spring came out in the units of the log, by the factor too small."""
    made, gain = made_rigid(2), -0.15
    stiffness = 2.0 * made.sizes[JOINT].torque

    def spring(world: World) -> np.ndarray:
        torque = np.zeros_like(world.q)
        torque[:, JOINT] = stiffness * world.q[:, JOINT]
        return torque

    laws = replace(scaled(JOINT, 1 + gain), link=[spring])
    signals = signals_with(made, laws)
    found = diagnose(made.robot, signals, DiagnoseOptions(only=("link_spring", "torque_gain")))
    assert isinstance(found, Diagnosis)
    told = {effect.effect: effect for effect in found.effects}
    for name, value, effect in (("stiffness", stiffness, "link_spring"), ("gain", gain, "torque_gain")):
        assert told[effect].std_error[name] < 0.05 * abs(value)
        assert abs(told[effect].parameters[name] - value) < 3 * told[effect].std_error[name]


@pytest.mark.parametrize(("share", "harm"), [(-1.0, True), (-0.1, False), (0.5, False)])
def test_curves_that_predict_some_joint_worse_are_none(
    share: float, monkeypatch: pytest.MonkeyPatch, *, harm: bool
) -> None:
    rows = (EstimationRow("sum", 0), EstimationRow("sum", 1))

    def shares(_: Any, __: Any, own: list[EstimationRow]) -> float:
        return share if own[0].joint == 0 else 0.9

    monkeypatch.setattr(friction_curves, "held_out_share", shares)
    before = cast("State", SimpleNamespace(triangles=SimpleNamespace(rows=rows)))
    assert friction_curves._harms(before, before) is harm
