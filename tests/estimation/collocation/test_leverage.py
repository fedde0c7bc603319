"""What a fit takes out of its own scores, against simulated noise."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.collocation.bordered_banded import LASTING, left
from elid_cli.estimation.regression.long_run import NARROWEST, KernelSum, small_sample, student_quantile, uncertain

INSTANTS, BANDWIDTH = 240, 24.0


def design() -> np.ndarray:
    """Return columns (instants, p) that change slowly, as those of a motion do."""
    t = np.linspace(0.0, 1.0, INSTANTS)
    return np.column_stack([np.sin(2 * np.pi * k * t + k) for k in range(1, 5)] + [np.ones(INSTANTS)])


def shown(columns: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return the variance of every estimate by the kernel's sum over the scores of a fit to noise, (p,)."""
    inverse = np.linalg.inv(columns.T @ columns)
    residual = noise - columns @ (inverse @ (columns.T @ noise))
    total = KernelSum(columns.shape[1], BANDWIDTH)
    total.feed(columns.T * residual, 0)
    return np.diag(inverse @ total.total() @ inverse)


def test_the_share_that_a_fit_leaves_is_that_of_simulated_white_noise() -> None:
    columns, generator = design(), np.random.default_rng(1)
    inverse = np.linalg.inv(columns.T @ columns)
    mean = np.mean([shown(columns, generator.standard_normal(INSTANTS)) for _ in range(1500)], axis=0)
    share = left(columns[:, :, None] * columns[:, None, :], inverse, np.zeros(INSTANTS, dtype=np.intp), BANDWIDTH)
    share = 1.0 - (1.0 - share) / (1.0 + LASTING * (1.0 - NARROWEST / BANDWIDTH))  # of white noise
    assert share == pytest.approx(mean / np.diag(inverse), rel=0.05)
    assert share.max() < 0.8  # a good part is gone
    # the rule that knows no columns is no further off than their differences
    assert 1.0 / small_sample(INSTANTS, columns.shape[1], BANDWIDTH) == pytest.approx(float(np.mean(share)), abs=0.1)


def test_two_equations_at_every_instant_lose_half_as_much_as_one() -> None:
    lost = [1.0 - 1.0 / small_sample(1000, 10, 20.0, rows) for rows in (1, 2)]
    assert lost == pytest.approx([0.15, 0.075])
    assert 1.0 / small_sample(100, 50, 20.0) == pytest.approx(0.5)  # no more than the part that is believed


def test_a_sum_of_few_independent_pieces_is_as_uncertain_as_its_scatter() -> None:
    generator = np.random.default_rng(2)
    sums = []
    for _ in range(1500):
        total = KernelSum(1, BANDWIDTH)
        total.feed(generator.standard_normal((1, INSTANTS)), 0)
        sums.append(float(total.total()[0, 0]))
    degrees = 2.0 * np.mean(sums) ** 2 / np.var(sums)  # of the chi-squared with this mean and variance
    assert uncertain(INSTANTS, BANDWIDTH) == pytest.approx((student_quantile(degrees, 0.975) / 1.96) ** 2, rel=0.03)
    assert uncertain(10**7, BANDWIDTH) == 1.0


def test_neighbours_that_count_as_one_leave_the_same_share() -> None:
    columns, together = design(), 4
    inverse = np.linalg.inv(columns.T @ columns)
    each = columns[:, :, None] * columns[:, None, :]
    blocks = each.reshape(-1, together, *inverse.shape).sum(axis=1)
    fine, coarse = (
        left(part, inverse, np.zeros(len(part), dtype=np.intp), BANDWIDTH, INSTANTS // len(part))
        for part in (each, blocks)
    )
    assert 1.0 - coarse == pytest.approx(1.0 - fine, rel=0.06)
