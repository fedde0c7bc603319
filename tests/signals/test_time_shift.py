"""Signals moved in time are those of SciPy's cubic spline."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.signals.time_shift import shifted


@pytest.mark.parametrize("samples", [0.0, 0.3, -0.77, 1.0, -2.5, 200.3])
@pytest.mark.parametrize("count", [4, 5, 7, 1000])
def test_a_signal_moves_along_the_cubic_spline_of_scipy(count: int, samples: float) -> None:
    from scipy.interpolate import CubicSpline

    values = np.random.default_rng(count).standard_normal(count).cumsum()
    index = np.arange(count, dtype=float)
    expected = CubicSpline(index, values)(np.clip(index + samples, 0.0, index[-1]))
    np.testing.assert_allclose(shifted(values, samples), expected, rtol=0.0, atol=1e-13 * np.abs(values).max())


def test_a_column_of_a_table_moves_like_the_signal_alone() -> None:
    table = np.random.default_rng(0).standard_normal((50, 3)).cumsum(axis=0)
    before = table.copy()
    np.testing.assert_array_equal(shifted(table[:, 1], 0.4), shifted(table[:, 1].copy(), 0.4))
    np.testing.assert_array_equal(table, before)


def test_too_few_samples_stay_where_they_are() -> None:
    np.testing.assert_array_equal(shifted(np.array([1.0, 2.0, 4.0]), 0.5), [1.0, 2.0, 4.0])
