"""What a search by motion takes up, tries for less, and gives up, on a plant that shares no code with elid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion import search
from elid_cli.diagnosis.by_motion.candidates import Candidate
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.refits import grown, hardened
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.library.link_spring import LinkSpring
from elid_cli.model.effects.library.stribeck import Stribeck
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, OFFSET, VISCOUS, moved, robot, written


def fitted(folder: Path, recording: Recording) -> TrajectoryFit:
    """Return the fit that a search begins with."""
    arm = robot(folder)
    signals = prepare(read_recording([written(folder, "log.h5", recording)], arm), arm)
    assert signals.recording is not None
    return fit_trajectory(arm, commanded_runs(signals.recording, arm), started_from(arm, signals))


def test_friction_that_fades_in_is_given_up_for_the_curve_that_it_imitated(tmp_path: Path) -> None:
    arm, rise, velocity = robot(tmp_path), 0.15, 0.15
    recording = moved(
        6, 8.0, sweep=0.15, grip=lambda x, v, load: rise * (1 - np.exp(-np.abs(v) / velocity)) * [0, 1, 0]
    )
    signals = prepare(read_recording([written(tmp_path, "rising.h5", recording)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("stribeck",))
    assert [(e.effect, e.joint) for e in found.effects] == [("stribeck", "two")]
    (effect,) = found.effects
    assert effect.parameters["exponent"] == 1.0
    for name, truth in (("amplitude", -rise), ("velocity", velocity)):
        assert effect.parameters[name] == pytest.approx(truth, rel=0.05), name
        assert abs(effect.parameters[name] - truth) < 4 * effect.std_error[name], name
    assert not found.unexplained
    truths = np.stack([ARMATURE, COULOMB + rise * np.array([0, 1, 0]), VISCOUS, OFFSET], axis=1)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - truths) / error).max() < 4


def test_friction_that_does_fade_in_is_kept(tmp_path: Path) -> None:
    soft = moved(
        3, 6.0, push=lambda x, v, load: COULOMB * np.clip(v / 0.08, -1.0, 1.0), grip=lambda x, v, load: -COULOMB
    )
    fit = fitted(tmp_path, soft)
    assert fit.unknowns.soft.keys() == {0, 1, 2}
    assert hardened(fit, fit.unknowns.soft) is fit


def test_friction_that_holds_a_joint_is_tried_for_less_than_other_effects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, stribeck, spring = fitted(tmp_path, moved(5, 3.0)), Stribeck(1, (0.1, 2.0)), LinkSpring(1)
    cases: list[tuple[Effect, float, bool]] = [
        (stribeck, 0.05, True), (stribeck, 0.03, False), (spring, 0.05, False), (spring, 0.16, True),
    ]  # fmt: skip
    for effect, gain, tried in cases:
        found = Candidate(effect, gain, 1.0, np.ones(len(effect.amplitudes)))

        def screened(_: object, joint: int, *__: object, found: Candidate = found) -> list[Candidate]:
            return [found] if joint == found.effect.joint else []

        monkeypatch.setattr(search, "screened", screened)
        best, left, _ = search._best(fit, [type(effect)])
        assert [item.effect for item in best] == ([effect] if tried else []), (effect.name, gain)
        assert list(left) == ([] if tried else [found])


def test_an_effect_that_may_be_nothing_by_its_errors_is_not_named(tmp_path: Path) -> None:
    spring = LinkSpring(0)
    fit = grown(fitted(tmp_path, moved(3, 4.0, push=lambda x, v, load: 1.5 * x * [1, 0, 0])), [spring])
    own = fit.unknowns.amplitudes_of(0)
    assert (np.abs(fit.alone) > 100 * fit.deviation)[0, own.start]
    for errors, named in ((1.9, False), (2.1, True), (-1.9, False), (-2.1, True)):
        alone = fit.alone.copy()
        alone[0, own] = errors * fit.deviation[own]
        after, kept = search._kept(replace(fit, alone=alone), [Named(spring, 1.0, 1.0)], 0)
        assert [item.effect.name for item in kept] == ["link_spring"] * named, errors
        assert len(after.effects) == named
