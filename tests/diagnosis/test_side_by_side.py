"""Parts of a search in processes of their own give what they give here."""

from __future__ import annotations

import os

import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.state import fit, refreshed
from elid_cli.diagnosis.search.screening import REFITTED, best_of, screen
from elid_cli.diagnosis.search.side_by_side import can_fork, side_by_side
from elid_cli.model.effects import effect_classes
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import laws_of, log_of, make, recorded

forking = pytest.mark.skipif(not can_fork(), reason="this system has no safe fork")


@forking
def test_results_come_in_order_from_several_processes() -> None:
    found = side_by_side(lambda k: (k, os.getpid()), 7, 3)
    assert [k for k, _ in found] == list(range(7))
    assert len({process for _, process in found}) == 3


def test_one_job_stays_here() -> None:
    assert side_by_side(lambda k: os.getpid(), 3, 1) == [os.getpid()] * 3


@forking
def test_a_process_that_is_ended_loses_nothing() -> None:
    here = os.getpid()

    def part(k: int) -> int:
        if os.getpid() != here:
            os._exit(9)
        return k * k

    assert side_by_side(part, 5, 2) == [0, 1, 4, 9, 16]


@forking
def test_what_fails_elsewhere_fails_here() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 // (k - 3), 4, 2)


@forking
def test_a_screening_is_the_same_bytes_for_any_number_of_jobs() -> None:
    made = make(302, 2, rate=250.0)
    log = recorded(made, log_of(made, laws_of("torque_ripple", made, 1)), db=90.0, counts=0.0, torque=0.002,
                   colour=0.0, seed=1)  # fmt: skip
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(250.0))
    names = ("torque_ripple", "payload", "stribeck", "hysteresis", "encoder_offset", "contact", "load_friction")
    library = {name: effect_classes()[name] for name in names}
    found = []
    for jobs in (1, 2, 3):
        state = refreshed(fit(divided(made.robot, signals), ()))
        first = screen(state, library, jobs=jobs)
        again = screen(state, library, jobs=jobs)  # with the columns that the first one brought home
        told = [(c.key, c.effect.shape, c.net, dict(c.values), c.gain.folds.tolist()) for c in (*first, *again)]
        found.append(repr(told))
        assert len(first) > len(names)
    assert found[0] == found[1] == found[2]


def test_what_is_left_unjudged_is_not_among_the_best() -> None:
    made = make(302, 2, rate=250.0)
    log = recorded(made, log_of(made, laws_of("torque_ripple", made, 1)), db=90.0, counts=0.0, torque=0.002,
                   colour=0.0, seed=1)  # fmt: skip
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(250.0))
    library = {name: kind for name, kind in effect_classes().items() if kind.searched and kind.nuisance != "offset"}
    state = refreshed(fit(divided(made.robot, signals), ()))
    every, (best, count) = screen(state, library), best_of(state, library)
    assert count == len(every) > len(best)
    assert all(c.net <= c.most for c in every)
    known = {c.key for c in best}
    assert all(c.net <= 0.0 for c in every if c.key not in known)
    first = max(REFITTED, sum(c.net > 0.0 for c in every))
    told = [[(c.key, c.effect.shape, c.net, dict(c.values)) for c in found[:first]] for found in (best, every)]
    assert told[0] == told[1]
