"""Two effects that one explains as well give way to it; two that are both there stay."""

from __future__ import annotations

import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.state import fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import left_out_error
from elid_cli.diagnosis.search.one_for_two import AS_WELL, with_one_for_two
from elid_cli.diagnosis.search.screening import score
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.diagnosis.diagnosis_logs import STRIBECK_SPEED, Logs

KINDS = effect_classes()
LIBRARY = {name: KINDS[name] for name in ("stribeck", "load_friction", "quadratic_viscous", "asymmetric_coulomb")}


def found_with(log: Logs, robot: Robot, there: tuple[str, ...], effects: list[Effect]) -> Found:
    """Return the outcome of a search that named some effects in a log that holds others."""
    recording = log(*there)
    divided_log = divided(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))
    before = refreshed(fit(divided_log, ()))
    after = refreshed(fit(divided_log, effects))
    steps = []
    for number, effect in enumerate(effects):
        candidate = score(without(after, number), effect, 1, 1)
        assert candidate is not None
        steps.append(Step(candidate, ()))
    return Found(before, after, tuple(steps), (), len(effects))


@pytest.fixture(scope="module")
def imitated(log: Logs, robot: Robot) -> Found:
    stribeck = KINDS["stribeck"]
    pair = [stribeck(0, (0.5 * STRIBECK_SPEED, 1.0)), stribeck(0, (2.0 * STRIBECK_SPEED, 1.0))]
    return found_with(log, robot, ("stribeck",), pair)


def test_one_effect_takes_the_place_of_two_that_imitate_it(imitated: Found) -> None:
    one = with_one_for_two(imitated, 0, LIBRARY)
    (effect,), (step,) = one.after.effects, one.steps
    assert (effect.name, effect.joint) == (step.candidate.effect.name, 0) == ("stribeck", 0)
    assert effect.shape[0] == pytest.approx(STRIBECK_SPEED, rel=0.05)
    rows = list(imitated.after.columns[0].rows)
    both = left_out_error(imitated.after, imitated.after, rows)
    assert left_out_error(one.after, imitated.after, rows) <= (1 + AS_WELL) * both


def test_two_effects_that_are_both_there_stay(log: Logs, robot: Robot) -> None:
    pair = [KINDS["stribeck"](0, (STRIBECK_SPEED, 1.0)), KINDS["load_friction"](1)]
    found = found_with(log, robot, ("stribeck", "load_friction"), pair)
    assert with_one_for_two(found, 0, LIBRARY) is found
