"""Changes at an instant: the ends of a log do not decide it, and a fold that holds all before it judges nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
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
