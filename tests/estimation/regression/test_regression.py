"""Least squares of one equation: coefficients, and standard errors under residuals that remember."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from elid_cli.estimation.regression.covariance import regression


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_intervals_of_a_short_record_hold_the_truth(pole: float) -> None:
    generator, scores = np.random.default_rng(3), []
    for _ in range(400):
        columns = np.column_stack([lfilter([1.0], [1.0, -0.9], generator.standard_normal(400)), np.ones(400)])
        noise = lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], generator.standard_normal(600))[200:]
        found = regression(columns, columns @ [2.0, -1.0] + noise, np.zeros(400, dtype=np.intp))
        scores.append((found.values - [2.0, -1.0]) / found.spread)
    inside = np.mean(np.abs(scores) < 1.96, axis=0)
    assert np.all((inside > 0.91) & (inside < 0.98))


def test_what_other_columns_explain_is_no_columns_own() -> None:
    generator = np.random.default_rng(4)
    own, other = generator.standard_normal((2, 5000))
    columns = np.column_stack([other + 0.1 * own, other])
    found = regression(columns, own, np.zeros(5000, dtype=np.intp))
    left = columns[:, 0] - other * (other @ columns[:, 0]) / (other @ other)
    assert found.alone[0] == pytest.approx(np.mean(left**2), rel=1e-9)
    assert found.values == pytest.approx([10.0, -10.0], rel=1e-9)
