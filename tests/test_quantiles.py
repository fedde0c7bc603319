"""Quantiles without the overhead of NumPy's own."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.quantiles import quantiles


@pytest.mark.parametrize("length", [1, 2, 3, 10, 1000])
def test_they_are_numpys_to_the_last_bit(length: int) -> None:
    values = np.random.default_rng(length).standard_normal((3, length))
    shares = (0.02, 0.7, 0.999, 0.0, 1.0)
    np.testing.assert_array_equal(quantiles(values, shares), np.quantile(values, shares, axis=1))
