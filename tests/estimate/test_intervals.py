"""Standard errors where they are hardest: short logs, noisy positions, stiffnesses that say nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.accurate import widening
from elid_cli.link_equation import TwoWays, with_both_regressions
from elid_cli.recording import Recording, Segment
from tests.estimate.test_identify import found, noisy, planar_log


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
    assert "standard deviation" in told.reasons["K2"]
    assert told.verdict[-2] == "supported"


def test_a_stiffness_between_close_regressions_stays() -> None:
    result = found(planar_log(), guards=False)
    told = with_both_regressions(result, lambda joint: TwoWays(1500.0, 2200.0) if joint == 1 else None)
    assert told.verdict[-1] == "supported"
    assert told.estimate[-1] == pytest.approx(np.sqrt(1500.0 * 2200.0))


def test_noisy_positions_widen_accurate_errors() -> None:
    assert widening(100.0) == 1.0
    assert 2.5 < widening(60.0) < 3.5
    result = found(noisy(1, 60.0), accurate=True, guards=False)
    assert any("widened by" in note for note in result.notes)
    score = (result.estimate - result.reference) / result.std_error
    assert np.sqrt(np.mean(score**2)) < 2.5
