"""A rival explains what the named effect explains, in its place and beside all others; else it is none."""

from __future__ import annotations

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.diagnosis.rivals import rivals_of
from elid_cli.diagnosis.search.screening import screen
from elid_cli.diagnosis.search.steps import Step
from elid_cli.model.effects import effect_classes
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, laws_of, log_of, make, recorded

ARM, RATE = 2, 250.0
NAMED = [("link_spring", "j3"), ("link_viscous", "j1")]


def test_what_came_near_by_explaining_another_effect_is_no_rival_of_it() -> None:
    """A skew of j1 and a spring at j3 may gain as much, while neither is known: of friction at j1 it is a rival."""
    made = make(ARM, 3, rate=RATE, duration=12.0)
    laws = Laws(link=[*laws_of("link_viscous", made, 0).link, *laws_of("link_spring", made, 2).link])
    log = recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=0.002, colour=0.0, seed=ARM)
    only = ("link_spring", "link_viscous", "encoder_skew")
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(RATE))
    found = diagnose(made.robot, signals, DiagnoseOptions(only=only))
    assert [(e.effect, e.joint) for e in found.effects] == NAMED
    near = {c.key: c for c in screen(found.state_before, {name: effect_classes()[name] for name in only})}
    skew = near["encoder_skew", 0]
    steps = [Step(near[e.name, e.joint], (skew,)) for e in found.state_after.effects]
    (rival,) = rivals_of(found.state_after, 0, steps, found.effects)
    assert (rival.effect, rival.joint, rival.instead_of, rival.at) == ("encoder_skew", "j1", "link_viscous", "j1")
    assert rival.gain > 0.9
    assert abs(rival.parameters["skew"]) > 5.0 * rival.std_error["skew"]
    assert 0 < rival.behind < 100
