"""Drawn sets have the distribution that they are drawn from."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.sampling.draw import draw_sets

COUNT = 40_000


def drawn(mean: list[float], covariance: list[list[float]], positive: list[bool], seed: int = 0) -> np.ndarray:
    return draw_sets(np.array(mean), np.array(covariance), np.array(positive), COUNT, np.random.default_rng(seed))


def test_mean_and_covariance_are_the_stated_ones() -> None:
    covariance = [[4.0, 1.9, 0.0], [1.9, 1.0, -1e-4], [0.0, -1e-4, 1e-6]]
    sets = drawn([1.0, -2.0, 0.1], covariance, [False, False, True])
    deviation = np.sqrt(np.diag(covariance))
    assert np.abs((sets.mean(axis=0) - [1.0, -2.0, 0.1]) / deviation).max() < 4 / np.sqrt(COUNT)
    unit = (np.cov(sets.T) - covariance) / np.outer(deviation, deviation)
    assert np.abs(unit).max() < 4 * np.sqrt(2 / COUNT)


def test_components_of_no_variance_keep_their_mean() -> None:
    sets = drawn([3.0, -1.0], [[0.0, 0.0], [0.0, 1.0]], [True, False])
    assert (sets[:, 0] == 3.0).all()


@pytest.mark.parametrize("correlation", [-0.9, 0.5, 0.95])
@pytest.mark.parametrize("mean", [0.5, -0.5])
def test_positive_ones_are_the_draws_that_rejection_keeps(mean: float, correlation: float) -> None:
    covariance = [[1.0, correlation, 0.6], [correlation, 1.0, 0.3], [0.6, 0.3, 1.0]]
    if np.linalg.eigvalsh(covariance)[0] < 0:
        covariance[0][2] = covariance[2][0] = covariance[1][2] = covariance[2][1] = 0.1
    sets = drawn([mean, 0.3, 5.0], covariance, [True, True, False])
    assert (sets[:, :2] > 0).all()
    free = np.random.default_rng(1).multivariate_normal([mean, 0.3, 5.0], covariance, 20 * COUNT)
    kept = free[(free[:, :2] > 0).all(axis=1)]
    bound = 5 * kept.std(axis=0) * np.sqrt(1 / COUNT + 1 / len(kept))
    assert (np.abs(sets.mean(axis=0) - kept.mean(axis=0)) < bound).all()
    assert np.cov(sets.T) == pytest.approx(np.cov(kept.T), abs=0.04)


def test_an_estimate_far_below_zero_becomes_small_and_positive() -> None:
    sets = drawn([-50.0, 0.0], [[1.0, 0.5], [0.5, 1.0]], [True, False])
    assert (sets[:, 0] >= 0).all()
    assert sets[:, 0].mean() == pytest.approx(1 / 50, rel=0.05)  # the normal tail falls as exp(-50 x)
    assert sets[:, 1].mean() == pytest.approx(0.5 * 50, rel=0.01)  # what is correlated with it follows


def test_the_same_seed_gives_the_same_sets() -> None:
    one, same, other = (drawn([0.1], [[1.0]], [True], seed) for seed in (3, 3, 4))
    assert (one == same).all()
    assert (one != other).any()
