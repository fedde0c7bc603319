"""Knot spacings are looked for in two passes, which must find what all of them find; ends are as good as middles."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.knots import KNOTS, _choose, _spacings
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Segment
from elid_cli.signals.spline_fit import fit_spline

DT, SAMPLES = 2e-3, 6000


def moved(seed: int, noise: float) -> np.ndarray:
    """Return positions (N, 4) of two slow joints and two that follow vibrations, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) * DT
    slow = [np.sin(rng.uniform(0.5, 2) * t + rng.uniform(0, 6)) for _ in range(2)]
    fast = [s + 0.02 * np.sin(rng.uniform(20, 60) * t) for s in slow]
    return np.array([*slow, *fast]).T + noise * rng.standard_normal((SAMPLES, 4))


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("seed", [1, 2])
def test_two_passes_find_the_least_of_all_spacings(seed: int, noise: float) -> None:
    values = moved(seed, noise)
    whole = (Segment(0, SAMPLES),)
    assert excerpts(whole, DT) == whole
    candidates = _spacings(DT, SignalOptions(), KNOTS[0])
    scores = np.array([fit_spline(values.T, stride, DT).aicc for stride in candidates])
    chosen = _choose((values, values), whole, DT, 4, SignalOptions(), ())
    assert chosen.tolist() == [candidates[k] for k in np.argmin(scores, axis=0)]


@pytest.mark.parametrize("rest", [0, 1, 2, 25, 49])
def test_the_end_of_a_spline_is_as_good_as_its_middle_wherever_the_last_interval_is_cut(rest: int) -> None:
    stride = 50
    t = np.arange(40 * stride + 1 + rest) * DT
    smooth = 3.0 + np.sin([1.5 * t, 4.0 * t + 1.0])
    left = np.abs(fit_spline(smooth, stride, DT).spline.evaluate() - smooth)
    assert left[:, -stride:].max() < 1.1 * left[:, stride:-stride].max() < 1e-6
    noise = 1e-4 * np.random.default_rng(rest).standard_normal((200, *smooth.shape))
    error = fit_spline((smooth + noise).reshape(400, -1), stride, DT).spline.evaluate().reshape(noise.shape) - smooth
    spread = error.std(axis=0)[:, -5:]
    assert spread.max() < 0.8e-4  # of samples by themselves: 1e-4
    assert np.abs(error.mean(axis=0)[:, -5:]).max() < 4.0 / np.sqrt(200) * spread.max()


@pytest.mark.parametrize("samples", [1, 2, 3, 5])
@pytest.mark.parametrize("stride", [1, 4, 50])
def test_a_few_samples_have_a_spline(samples: int, stride: int) -> None:
    fit = fit_spline(np.ones((2, samples)), stride, DT)
    assert np.isfinite(fit.spline.evaluate()).all()
