"""Standard errors where they are hardest: short logs, noisy positions, stiffnesses that say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elid_cli.estimation.collocation.bordered_banded import variance_apart
from elid_cli.estimation.collocation.knots import astray, between_knots, between_valleys
from elid_cli.estimation.facts import deflection_noise
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.stiffness.link_equation import TwoWays, with_both_regressions
from elid_cli.estimation.stiffness.links import link_stiffness, merged_stiffness
from elid_cli.estimation.stiffness.noise import pull
from elid_cli.estimation.streaming.reduce import reduce_log
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.estimation.test_identify import PLANAR, found, noisy, planar_log
from tests.system.reproduce import coverage
from tests.system.reproduce.unseen import arm


def cut(log: Recording, start: int, samples: int) -> Recording:
    part = {name: getattr(log, name)[start : start + samples] for name in ("t", "q", "theta", "tau")}
    return replace(log, **part, dq=None, dtheta=None, segments=(Segment(0, samples),))


@pytest.mark.parametrize(("samples", "least"), [(800, 0.8), (1000, 0.85), (1500, 0.85)])
def test_a_short_log_has_intervals_that_hold_the_truth(samples: int, least: float) -> None:
    scores, short = [], False
    for number in range(6):
        log = cut(noisy(number, 90.0, 0.004), 1100 * number, samples)
        result = found(log, guards=False)
        score = (result.estimate - result.reference) / result.std_error
        scores.append(score[np.isfinite(score)])
        short = short or any("so short" in reason for reason in result.reasons.values())
    assert np.mean(np.abs(np.concatenate(scores)) < 1.96) > least
    assert short or samples > 800


def test_a_stiffness_that_says_nothing_is_refused() -> None:
    result = found(planar_log(), guards=False)
    place = result.base.parameters[result.base.leaders[-1]]
    assert place == "K2"
    told = with_both_regressions(result, lambda joint: TwoWays(1e2, 1e9) if joint == 1 else None)
    assert told.verdict[-1] == "refused"
    assert np.isnan(told.estimate[-1])
    assert np.isnan(told.covariance[-1]).all()
    assert "standard error" in told.reasons["K2"]
    assert told.verdict[-2] == "supported"


def test_a_stiffness_between_close_regressions_stays() -> None:
    result = found(planar_log(), guards=False)
    told = with_both_regressions(result, lambda joint: TwoWays(1500.0, 2200.0) if joint == 1 else None)
    assert told.verdict[-1] == "supported"
    assert told.estimate[-1] == pytest.approx(np.sqrt(1500.0 * 2200.0))


def test_noise_in_the_deflection_pulls_a_stiffness_by_its_share() -> None:
    assert pull(1000.0, 1e-6, 1e-11) == pytest.approx(100.0 / np.sqrt(3.0))
    assert pull(1000.0, 1e-6, 1e-13) == pytest.approx(1000.0 / np.sqrt(3.0))
    assert pull(1000.0, 1e-6, 0.0) == 1000.0


@cache
def stiff_motion() -> tuple[Robot, Recording]:
    """Return the arm with springs a thousand times as stiff, and its motion without noise."""
    stiff = replace(
        PLANAR,
        joints=tuple(replace(j, parameters={**j.parameters, "K": 1e3 * j.parameters["K"]}) for j in PLANAR.joints),
    )
    options = SimulationOptions(
        duration=8.9, reference=ReferenceOptions(amplitude=0.75), control=ControlOptions(continuous=True)
    )
    return stiff, simulate(stiff, options)


@pytest.mark.parametrize("db", [70.0, 90.0, 110.0])
def test_a_links_equation_knows_the_encoders_noise(db: float) -> None:
    stiff, exact = stiff_motion()
    generator = np.random.default_rng(1)
    noise = 10 ** (-db / 20) * exact.q.std(axis=0)
    log = replace(
        exact,
        q=exact.q + noise * generator.standard_normal(exact.q.shape),
        theta=exact.theta + noise * generator.standard_normal(exact.q.shape),
    )
    signals = prepare(log, stiff, SignalOptions(cutoff=10.0))
    model = Regressor(stiff)
    base, observation = find_base(model), observe(model, signals)
    system = reduce_log(stiff, signals, log, {}).links
    for joint in range(2):
        told = link_stiffness(base, observation, signals, stiff.reference(), joint)
        assert told is not None
        true = 1e3 * PLANAR.joints[joint].parameters["K"]
        assert abs(told.value - true) < 2.0 * told.deviation or told.deviation > 0.3 * told.value
        assert told.deviation > 0.3 * told.value if db == 70.0 else db == 90.0 or told.deviation < 0.05 * told.value
        assert system[joint] is not None
        reduced = merged_stiffness([system[joint]], deflection_noise(signals, joint))
        assert reduced is not None
        assert reduced.deviation == pytest.approx(told.deviation, rel=0.2)


def test_the_link_of_a_held_joint_says_nothing_in_a_reduced_log() -> None:
    stiff, exact = stiff_motion()
    moving = np.array([1.0, 0.0])
    log = replace(exact, q=exact.q * moving, theta=exact.theta * moving, dq=None, dtheta=None)
    signals = prepare(log, stiff, SignalOptions(cutoff=10.0))
    assert signals.still.tolist() == [False, True]
    links = reduce_log(stiff, signals, log, {}).links
    assert links[0] is not None  # of a joint that is held the deflection is one more constant
    assert links[1] is None


def test_noisy_positions_widen_accurate_errors() -> None:
    assert astray(100.0) == 1.0
    assert astray(40.0) == pytest.approx(2.0, abs=0.05)
    result = found(noisy(1, 60.0), accurate=True, guards=False)
    score = (result.estimate - result.reference) / result.std_error
    assert np.sqrt(np.mean(score**2)) < 2.5


def test_positions_a_hundredth_noise_ask_for_wide_knots() -> None:
    # with knots as close as for good encoders the cost has many valleys along an inertia: errors of twelve deviations
    log = noisy(1, 40.0)
    result, usual = found(log, accurate=True, guards=False), found(log, guards=False)
    assert any("knots every 30 ms" in note for note in result.notes)
    score = (result.estimate - result.reference) / result.std_error
    assert np.isfinite(result.estimate).all()
    assert np.sqrt(np.mean(score**2)) < 1.5
    assert result.normalised_mean_error() < 0.5 * usual.normalised_mean_error()


def errors_in_deviations(db: float, torque: float) -> tuple[Sequence[str], np.ndarray]:
    """Return base parameters and the collocation's errors in standard errors on three logs."""
    results = [found(noisy(number, db, torque), accurate=True, guards=False) for number in range(3)]
    assert all(result.estimator == "accurate" for result in results)
    return results[0].base.names, np.array([(r.estimate - r.reference) / r.std_error for r in results])


def test_the_noise_of_a_torque_does_not_bend_an_inertia() -> None:
    # knots that followed it took a rotor's inertia 2 % too large, twice its standard error
    names, scores = errors_in_deviations(90.0, 0.01)
    assert np.sqrt(np.mean(np.square(scores))) < 1.4
    assert abs(np.mean(scores[:, names.index("Jm1")])) < 1.2
    exact = found(noisy(1, 90.0), accurate=True, guards=False)
    assert any("knots every 5 ms" in note for note in exact.notes)


def test_links_of_a_stiff_arm_that_ring_faster_than_knots_follow_do_not_bend_the_answer() -> None:
    # links' equations that had to hold as closely as of slow ones took K1 and Jm1 five standard errors astray
    robot = arm(51, 3)
    (log,) = coverage.motions(robot, 1, 2)
    signals = prepare(coverage.noisy(log, 80.0, 0.003, 0.0, 1), robot)
    usual = identify(robot, signals, EstimateOptions(guards=False))
    result = identify(robot, signals, EstimateOptions(guards=False, accurate=True))
    assert result.estimator == "accurate"
    scores = (result.estimate - result.reference) / result.std_error
    assert np.sqrt(np.nanmean(np.square(scores))) < 1.3
    accurate, default = (np.nanmedian(np.abs(r.estimate - r.reference) / usual.std_error) for r in (result, usual))
    assert accurate < 0.6 * default


def test_errors_at_noisy_positions_reach_to_what_cannot_be_told_apart() -> None:
    assert [between_knots(db) for db in (60.0, 75.0, 80.0, 95.0)] == [1.0, 0.5, 0.0, 0.0]
    assert [between_valleys(db) for db in (58.0, 64.0, 67.0, 70.0)] == pytest.approx([0.45, 0.45, 0.225, 0.0])


def test_the_noise_that_takes_two_answers_apart_is_that_of_their_difference() -> None:
    noise = np.random.default_rng(0).standard_normal((40_000, 2))
    coarse = [noise[:24_000:2] + noise[1:24_000:2], noise[24_000::2] + noise[24_001::2]]
    fine = [1.5 * noise[:24_000], 1.5 * noise[24_000:]]
    assert variance_apart(fine, coarse, 1) == pytest.approx(0.25 * 40_000 * np.ones(2), rel=0.1)
    assert variance_apart([noise[:24_000], noise[24_000:]], coarse, 1).max() < 1e-20


def test_an_answer_that_is_no_sharper_leaves_the_default_one() -> None:
    # noise that remembers 50 ms, which the likelihood takes for white: errors twice the default's
    log = coverage.noisy(coverage.motions(PLANAR, 1, 4)[0], 80.0, 0.001, coverage.COLOURS["coloured"], 3)
    usual, result = (found(log, guards=False, accurate=accurate) for accurate in (False, True))
    assert result.estimator == "default"
    assert any("standard errors are 1." in note and "the default's" in note for note in result.notes)
    assert np.array_equal(result.estimate, usual.estimate)


def test_coarse_knots_stand_only_while_fine_ones_agree() -> None:
    # with 0.1 % of torque noise they lose two standard errors of a rotor's inertia: where that shows, fine ones stand
    _, scores = errors_in_deviations(80.0, 0.001)
    assert np.sqrt(np.mean(np.square(scores))) < 1.2
    assert np.abs(np.mean(scores, axis=0)).max() < 1.7


def test_noise_of_positions_alone_lowers_the_cut_off() -> None:
    log = noisy(1, 100.0)
    chosen = found(log, guards=False)
    usual = identify(PLANAR, prepare(log, PLANAR, SignalOptions(cutoff=10.0)), EstimateOptions(guards=False))
    assert chosen.settings["cutoff"] < 10.0
    assert usual.settings["cutoff"] == 10.0
    assert chosen.normalised_mean_error() < usual.normalised_mean_error()
    assert found(noisy(1, 110.0, 0.01), guards=False).settings["cutoff"] == 10.0
