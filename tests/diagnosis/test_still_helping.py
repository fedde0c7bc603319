"""Effects of which nothing is left on held-out stretches beside what was found after them."""

from __future__ import annotations

from types import SimpleNamespace

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.evidence.held_out import held_out_gain, still_helping
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.search.steps import Found
from elid_cli.model.effects import effect_classes
from elid_cli.signals.signals import prepare
from tests.estimation.regression.test_rotor_shares import BARE, logged


def outcome(before: State, after: State) -> Found:
    """Return an outcome whose steps are the effects of a model."""
    steps = [SimpleNamespace(candidate=SimpleNamespace(effect=effect), absorbed=False) for effect in after.effects]
    return Found(before=before, after=after, steps=tuple(steps), remaining=(), tried=len(steps))  # type: ignore[arg-type]


def test_an_effect_that_held_out_stretches_are_no_worse_without_is_not_named() -> None:
    arm, recording = logged(4)
    robot = arm.described()
    log = divided(robot, prepare(recording, robot))
    true = effect_classes()[BARE.effect](0)
    plain = fit(log, ())
    others = [kind(0) for kind in effect_classes().values() if kind.searched and not (kind.shapes or kind.local)]
    useless = next(
        state
        for state in (fit(log, (true, e), fit(log, (true,)).scene) for e in others if e.applies(robot, 0))
        if type(state.effects[1]) is not type(true) and held_out_gain(state, 1) <= 0
    )
    found = outcome(plain, useless)
    assert still_helping(found, 0, useless) is found  # judged as it stands
    left = still_helping(found, 0, plain)
    assert [type(effect) for effect in left.after.effects] == [type(true)]
    assert len(left.steps) == 1
    assert left.remaining[0].effect is useless.effects[1]
    assert held_out_gain(left.after, 0) > 0.9
