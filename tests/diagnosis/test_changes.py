"""Changes at an instant: the ends of a log do not decide it, and a fold that holds all before it judges nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import DiagnoseOptions, diagnose_torque, divided
from elid_cli.diagnosis.fit.state import fit, refreshed
from elid_cli.diagnosis.search.acceptance import is_change, predicted_better
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.model.effects import effect_classes
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare

ROW = EstimationRow("sum", 0)
GRIPPED = 7.3
"""s."""


def test_wild_accelerations_at_an_end_do_not_decide_when_a_load_was_gripped() -> None:
    robot, payload = read_robot("planar2"), effect_classes()["payload"]
    gripped = replace(robot, effects=(EffectSpec("payload", None, {"m": 2.0, "cx": 0.6, "start": GRIPPED}),))
    log = simulate(gripped, SimulationOptions(duration=16.0, rate=200.0, seed=1))
    state = refreshed(fit(divided(robot, prepare(log, robot, SignalOptions.for_diagnosis(log.rate))), ()))
    tau = state.scene.tau.copy()
    tau[:2] += 1e4
    for scene in (state.scene, replace(state.scene, tau=tau, cache={})):
        assert min(abs(start - GRIPPED) for (start,) in payload.grid(scene, robot.n - 1)) < 0.1


@pytest.mark.parametrize("seed", [1, 2])
def test_a_load_gripped_where_a_held_out_stretch_begins_is_all_that_is_named(seed: int) -> None:
    """Half of the log is such a place: filters spread the change over rows on both sides of it."""
    robot = read_robot("planar2")
    gripped = replace(robot, effects=(EffectSpec("payload", None, {"m": 2.0, "cx": 0.6, "start": 8.0}),))
    log = simulate(gripped, SimulationOptions(duration=16.0, rate=200.0, seed=seed))
    signals = prepare(log, robot, SignalOptions.for_diagnosis(log.rate))
    found = diagnose_torque(robot, signals, DiagnoseOptions(only=("payload", "contact")))
    assert any(abs(first - 8.0) < 0.02 for first, _ in found.held_out)
    assert [effect.effect for effect in found.effects] == ["payload"]
    assert found.effects[0].parameters["start"] == pytest.approx(8.0, abs=0.01)
    assert found.unexplained == ()


def test_the_instant_of_a_change_is_found_to_a_sample_wherever_it_is() -> None:
    robot = read_robot("planar2")
    gripped = replace(robot, effects=(EffectSpec("payload", None, {"m": 2.0, "cx": 0.6, "start": 6.0}),))
    log = simulate(gripped, SimulationOptions(duration=16.0, rate=200.0, seed=2))
    signals = prepare(log, robot, SignalOptions.for_diagnosis(log.rate))
    found = diagnose_torque(robot, signals, DiagnoseOptions(only=("payload",)))
    assert found.effects[0].parameters["start"] == pytest.approx(6.0, abs=1.1 / log.rate)


def judged(before: list[float], after: list[float], *, change: bool) -> float | None:
    def state(left_out: list[float]) -> Any:
        rows = SimpleNamespace(rows=(ROW,))
        return SimpleNamespace(triangles=rows, left_out={ROW: np.array(left_out)}, rms=lambda row: 1.0)

    return predicted_better(state(before), state(after), [ROW], change=change)


def test_a_fold_that_cannot_be_predicted_does_not_judge_a_change() -> None:
    before, exploded = [9.0, 8.0, 7.0, 9.0, 8.0, 9.0], [900.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert judged(before, exploded, change=False) is None
    assert judged(before, exploded, change=True) == pytest.approx(1.0 - 5.0 / 41.0)
    assert judged(before, [900.0, 900.0, 1.0, 1.0, 1.0, 1.0], change=True) is None
    kinds = effect_classes()
    assert is_change(kinds["payload"](0, (1.0,)))
    others = [kinds[name](0, (1.0,) * len(kinds[name].shapes)) for name in ("contact", "stribeck")]
    assert not any(is_change(effect) for effect in others)
