"""No effect is named that makes a quarter of the log, predicted from the other three, worse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.evidence import quarters
from elid_cli.diagnosis.evidence.quarters import judged, left_out, survival
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.screening import score
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.diagnosis.stiffness_by_load import stiffness_by_load
from elid_cli.estimation.stretches import QUARTERS
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.diagnosis_logs import EFFECTS, Diagnosed, Logs


def with_torque(recording: Recording, robot: Robot, sign: np.ndarray, effect: Effect) -> tuple[State, Found]:
    """Return a fit without and a search's outcome with an effect, in a log with `sign` N·m more on joint 1."""
    tau = recording.tau.copy()
    tau[:, 0] += sign
    log = divided(
        robot, prepare(dataclasses.replace(recording, tau=tau), robot, SignalOptions.for_diagnosis(recording.rate))
    )
    before = refreshed(fit(log, ()))
    candidate = score(before, effect, 1, 1)
    assert candidate is not None
    after = refreshed(fit(log, (candidate.effect,), before.scene))
    return before, Found(before, after, (Step(candidate, ()),), (), 1)


def part(recording: Recording, *parts: float) -> np.ndarray:
    """Return one value (N·m) for each of equally long parts of a log, (N,)."""
    samples = len(recording.t)
    return np.array(parts)[np.minimum(np.arange(samples) * len(parts) // samples, len(parts) - 1)]


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_true_effect_helps_on_every_quarter(diagnosed: Diagnosed, effect: str) -> None:
    found = diagnosed(effect)
    assert found.refuted == ()
    assert len(found.effects[0].quarters) == QUARTERS
    assert min(found.effects[0].quarters) > 0.5


def ripple(recording: Recording, *parts: float) -> np.ndarray:
    """Return a torque that waves with joint 1's angle, by one amplitude (N·m) for each part of a log."""
    return part(recording, *parts) * np.sin(3.0 * recording.theta[:, 0])


def test_a_ripple_that_turns_in_the_last_quarter_is_not_named(log: Logs, robot: Robot) -> None:
    effect = effect_classes()["torque_ripple"](0, (3.0,))
    recording = log()
    _, found = with_torque(recording, robot, ripple(recording, 1.0, 1.0, 1.0, -0.3), effect)
    left, failed = judged(found, 0)
    assert failed is not None
    assert (failed.effect, failed.joint) == ("torque_ripple", "joint1")
    assert failed.lost[3]
    assert failed.gains[3] < -0.05
    assert (left.steps, left.after.effects) == ((), ())


def test_the_same_ripple_all_along_survives_and_says_by_how_much(log: Logs, robot: Robot) -> None:
    effect = effect_classes()["torque_ripple"](0, (3.0,))
    recording = log()
    _, found = with_torque(recording, robot, ripple(recording, 1.0), effect)
    left, failed = judged(found, 0)
    assert failed is None
    assert min(left.steps[0].quarters) > 0.9


def test_a_quarter_in_which_an_effect_does_nothing_cannot_tell(log: Logs, robot: Robot) -> None:
    contact = effect_classes()["contact"](0, (3.0, 0.5))
    recording = log()
    seconds = np.arange(len(recording.t)) * recording.dt
    bump = 2.0 * np.exp(-0.5 * ((seconds - 3.0) / 0.25) ** 2)
    _, found = with_torque(recording, robot, bump, contact)
    state = found.after
    told = survival(state, 0, left_out(state))
    assert told.survives  # judged by the quarters of the time at which it acts: all four of them
    assert np.isfinite(told.gains).sum() >= 3
    assert np.nanmin(told.gains) > 0.3


def test_an_encoder_offset_that_fails_is_still_fitted_but_not_named(
    log: Logs, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = log()
    shifted = dataclasses.replace(recording, theta=recording.theta + np.array([0.001, 0.0]))
    offset = effect_classes()["encoder_offset"](0)
    _, found = with_torque(shifted, robot, np.zeros(len(recording.t)), offset)
    told = survival(found.after, 0, left_out(found.after))
    assert min(told.gains) > 0.5
    failing = dataclasses.replace(told, lost=(True, False, False, False))
    monkeypatch.setattr(quarters, "survival", lambda *_: failing)
    left, failed = judged(found, 0)
    assert failed is not None
    assert failed.kept
    assert (left.steps, left.kept) == ((), 1)
    assert [e.name for e in left.after.effects] == ["encoder_offset"]
    assert left.after.named(0)["offset"] == pytest.approx(0.001, rel=0.05)


def test_the_stiffness_by_the_load_is_the_true_one_whatever_the_motor_does(log: Logs, robot: Robot) -> None:
    recording = log("stribeck")
    state = refreshed(fit(divided(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate))), ()))
    for joint, item in enumerate(robot.joints):
        found = stiffness_by_load(state, joint)
        assert found is not None
        assert abs(found.value - item.parameters["K"]) < 3 * found.deviation + 0.02 * item.parameters["K"]
