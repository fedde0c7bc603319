"""An effect that makes identification's own prediction worse is dropped at its cut-off; one that helps there stays."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.evidence import usual_cutoff
from elid_cli.diagnosis.evidence.quarters import Survival
from elid_cli.diagnosis.evidence.usual_cutoff import helpful_there
from elid_cli.diagnosis.fit.state import fit, refreshed
from elid_cli.diagnosis.search.screening import score
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.model.effects import effect_classes
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.inverse_logs import Laws, World, log_of, make, recorded

RATE, LASTS = 500.0, 12.0


def drag(sizes: tuple[float, float, float, float]) -> Laws:
    """Return friction at joint 1 that grows with the square of the speed, a factor for each quarter of the log."""

    def torque(world: World) -> np.ndarray:
        quarter = np.minimum((4.0 * world.t / LASTS).astype(int), 3)
        acting = np.zeros_like(world.dtheta)
        acting[:, 0] = -np.array(sizes)[quarter] * world.dtheta[:, 0] * np.abs(world.dtheta[:, 0])
        return acting

    return Laws(motor=[torque])


def named(arm: int, laws: Laws) -> tuple[Found, Signals]:
    """Return an outcome that names this friction, at the search's cut-off, and the log as identification takes it."""
    made = make(arm, 2, rate=RATE, duration=LASTS)
    log = recorded(made, log_of(made, laws), db=85.0, counts=0.0, torque=0.01, colour=0.0, seed=arm)
    before = fit(divided(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE))), ())
    effect = effect_classes()["quadratic_viscous"](0, (2.0,))
    candidate = score(before, effect, 1, 1)
    assert candidate is not None
    after = refreshed(fit(before.log, (effect,), before.scene))
    return Found(before, after, (Step(candidate, ()),), (), 1), prepare(log, made.robot)


@pytest.mark.parametrize("arm", range(1, 7))
def test_what_helps_everywhere_stays(arm: int) -> None:
    found, usual = named(arm, drag((1.0, 1.0, 1.0, 1.0)))
    kept, gone = helpful_there(found, 0, lambda: usual)
    assert kept is found
    assert gone == ()


@pytest.mark.parametrize("arm", range(1, 7))
def test_what_acts_in_the_last_quarter_alone_is_dropped_and_told_with_the_cutoff(arm: int) -> None:
    found, usual = named(arm, drag((0.0, 0.0, 0.0, 10.0)))
    kept, (gone,) = helpful_there(found, 0, lambda: usual)
    assert (kept.steps, kept.after.effects) == ((), ())
    assert (gone.effect, gone.joint) == ("quadratic_viscous", "j1")
    assert gone.cutoff is not None
    assert gone.cutoff < found.after.log.signals.filter.cutoff


def test_nothing_is_judged_twice_at_the_search_s_own_cutoff() -> None:
    found, _ = named(1, drag((0.0, 0.0, 0.0, 10.0)))
    assert helpful_there(found, 0, lambda: found.after.log.raw) == (found, ())


@pytest.mark.parametrize(
    ("whole", "worse", "stays"), [(0.1, 1, True), (0.1, 2, False), (0.02, 1, False), (-0.1, 1, False)]
)
def test_one_worse_quarter_does_not_refute_what_helps_on_the_whole(
    whole: float, worse: int, monkeypatch: pytest.MonkeyPatch, *, stays: bool
) -> None:
    """The largest of three such frictions was not named for one quarter at this cut-off, where little of it shows."""
    found, usual = named(1, drag((1.0, 1.0, 1.0, 1.0)))
    told = Survival("quadratic_viscous", "j1", (0.33, 0.1, -0.17, 0.04), whole, (False, worse > 1, True, False))
    monkeypatch.setattr(usual_cutoff, "survival", lambda *_: told)
    kept, gone = helpful_there(found, 0, lambda: usual)
    assert (kept is found, gone == ()) == (stays, stays)
