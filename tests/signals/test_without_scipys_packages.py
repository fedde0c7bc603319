"""What takes SciPy's numbers without the import of its larger packages: the same to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline as Known
from scipy.linalg import solve_banded
from scipy.signal import butter, sosfiltfilt

from elid_cli.estimation.motor_side.banded import FEW, BandedFactor
from elid_cli.estimation.motor_side.operators import quick_length
from elid_cli.signals.cubic import CubicSpline
from elid_cli.signals.zero_phase import zero_phase


@pytest.mark.parametrize(("count", "cutoff", "dt"), [(3000, 20.0, 1e-3), (500, 3.0, 4e-3), (400, 390.0, 1e-3)])
def test_a_butterworth_filter_in_both_directions(count: int, cutoff: float, dt: float) -> None:
    values = np.cumsum(np.random.default_rng(0).normal(size=(count, 2)), axis=0)
    known = sosfiltfilt(butter(4, cutoff, fs=1 / dt, output="sos"), values, axis=0)
    assert zero_phase(values, cutoff, dt) == pytest.approx(known, abs=1e-10 * np.abs(known).max())
    assert zero_phase(values[:, 0], cutoff, dt) == pytest.approx(known[:, 0], abs=1e-10 * np.abs(known).max())


def test_a_cubic_spline_through_columns_and_beyond_their_ends() -> None:
    generator = np.random.default_rng(1)
    t, y = np.sort(generator.uniform(size=60)), generator.normal(size=(60, 2))
    asked = np.linspace(-0.01, 1.01, 333)
    assert CubicSpline(t, y)(asked) == pytest.approx(Known(t, y)(asked), rel=1e-9, abs=1e-9)


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


def test_lengths_whose_spectrum_is_quick() -> None:
    assert [quick_length(n) for n in range(1, 2000)] == [next_fast_len(n, real=True) for n in range(1, 2000)]
