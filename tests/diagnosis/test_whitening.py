"""Whitening filters exist for whatever noise histories a log has."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import firwin, lfilter

from elid_cli.diagnosis.fit.whitening import ORDER, _autoregression


@pytest.mark.parametrize("instants", [3 * ORDER, 60, 400, 2000])
@pytest.mark.parametrize("cutoff", [0.02, 0.1, 0.4])
def test_noise_of_any_smoothness_has_a_whitening_filter(instants: int, cutoff: float) -> None:
    # covariances that each lag's own number of instants divides are those of no process: short and smooth ones failed
    generator = np.random.default_rng(instants)
    taps = firwin(101, cutoff)
    for scale in (1e-9, 1.0, 1e6):
        white = generator.standard_normal((2, 3, instants + 100))
        series = scale * np.cumsum(lfilter(taps, 1.0, white, axis=2)[:, :, 100:], axis=2)
        lags, mix = _autoregression(series, 1e-6 * scale)
        assert np.isfinite(lags).all()
        assert np.isfinite(mix).all()


def test_the_filter_makes_an_autoregression_white() -> None:
    generator = np.random.default_rng(1)
    series = lfilter([1.0], [1.0, -0.9], generator.standard_normal((1, 4, 20_000)), axis=2)
    lags, mix = _autoregression(series, 1e-6)
    rest = series[:, :, ORDER:].copy()
    for k, lag in enumerate(lags, start=1):
        rest -= np.einsum("ab,bpm->apm", lag, series[:, :, ORDER - k : series.shape[2] - k])
    rest = np.einsum("ab,bpm->apm", mix, rest)
    assert rest.var() == pytest.approx(1.0, abs=0.02)
    assert abs(np.mean(rest[0, :, 1:] * rest[0, :, :-1])) < 0.02
