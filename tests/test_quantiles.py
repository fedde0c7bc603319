"""Quantiles are NumPy's to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.quantiles import quantiles

SHARES = (0.0, 0.005, 0.02, 0.3, 0.5, 0.7, 0.98, 0.999, 1.0)


@pytest.mark.parametrize("shape", [(1,), (2,), (3,), (50,), (1001,), (1, 2), (7, 3), (998, 2)])
def test_quantiles_are_those_of_numpy(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(0).standard_normal(shape)
    before = values.copy()
    assert np.array_equal(quantiles(values, *SHARES), np.quantile(values, SHARES, axis=0))
    assert np.array_equal(quantiles(values.T.copy().T, *SHARES), np.quantile(values, SHARES, axis=0))
    assert np.array_equal(values, before)


def test_where_a_value_is_missing_so_are_the_quantiles() -> None:
    values = np.random.default_rng(0).standard_normal((20, 3))
    values[4, 1] = np.nan
    found = quantiles(values, 0.1, 0.9)
    assert np.array_equal(found, np.quantile(values, (0.1, 0.9), axis=0), equal_nan=True)
    assert np.isnan(found[0]).tolist() == [False, True, False]
