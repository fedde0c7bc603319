"""Banded factors solve as SciPy's solver of the whole matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_banded

from elid_cli.estimation.motor_side.banded import FEW, BandedFactor


@pytest.mark.parametrize("size", [5, 12, 13, 36, 100])
@pytest.mark.parametrize("sides", [1, FEW + 2])
def test_a_banded_factor_solves_as_the_matrix_itself(size: int, sides: int) -> None:
    generator, width = np.random.default_rng(size), 6
    band = 0.1 * generator.normal(size=(width + 1, size))
    band[-1] = 3.0
    whole = np.vstack([band, np.zeros((width, size))])  # the lower half, column by column
    for k in range(1, min(width + 1, size)):
        whole[width + k, : size - k] = band[width - k, k:]
    load = generator.normal(size=(size, sides))
    factor = BandedFactor(band.copy())
    assert factor.back(factor.forward(load)) == pytest.approx(solve_banded((width, width), whole, load), abs=1e-12)
