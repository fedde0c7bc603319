"""Splines seen through positions and measured rates are exact, and say honestly how noisy the positions are."""

import numpy as np
import pytest

from elid_cli.signals.spline_fit import fit_spline
from elid_cli.signals.splines import basis

DT = 1e-3
STRIDE = 2
SPREAD = (7e-5, 8e-5, 1.5e-4)
"""Noise of position (rad), velocity (rad/s) and acceleration (rad/s²)."""


def motion(samples: int) -> list[np.ndarray]:
    t = np.arange(samples) * DT
    omega, size, phase = (
        np.array([[1.1], [2.3], [4.9]]),
        np.array([[0.9], [0.4], [0.1]]),
        np.array([[0.1], [1.0], [2.0]]),
    )
    return [np.sum(size * omega**d * np.sin(omega * t + phase + d * np.pi / 2), axis=0) for d in range(3)]


def fused(samples: int, seed: int):
    exact = motion(samples)
    generator = np.random.default_rng(seed)
    noisy = [x + s * generator.standard_normal(samples) for x, s in zip(exact, SPREAD, strict=True)]
    rates = [(d, noisy[d][None], np.array([SPREAD[0] / SPREAD[d]])) for d in (1, 2)]
    return exact, noisy, fit_spline(noisy[0][None], STRIDE, DT, rates)


def test_the_normal_equations_lose_no_digits_to_the_accelerations() -> None:
    """A dense least-squares solution of the weighted observations, by orthogonal transformations, says the same."""
    samples = 401
    _, noisy, fit = fused(samples, 1)
    intervals = (samples - 1) // STRIDE
    rows = []
    for derivative, spread in enumerate(SPREAD):
        design = np.zeros((samples, intervals + 5))
        for k in range(samples):
            interval = min(k // STRIDE, intervals - 1)
            u = np.array([(k - interval * STRIDE) / STRIDE])
            design[k, interval : interval + 6] = basis(u, derivative)[0] / (STRIDE * DT) ** derivative / spread
        rows.append(np.column_stack([design, noisy[derivative] / spread]))
    system = np.concatenate(rows)
    scale = np.linalg.norm(system[:, :-1], axis=0)
    dense = np.linalg.lstsq(system[:, :-1] / scale, system[:, -1], rcond=None)[0] / scale
    assert fit.spline.coefficients[0] == pytest.approx(dense, abs=1e-9)


def test_positions_are_as_good_as_their_information() -> None:
    """Velocities and accelerations carry the motion: the position's error is far below its noise, and not drifting."""
    exact, _, fit = fused(20_000, 2)
    error = fit.spline.evaluate(0)[0] - exact[0]
    assert np.sqrt(np.mean(error**2)) < 0.05 * SPREAD[0]


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_positions_is_not_taken_for_freedom(seed: int) -> None:
    """With knots every second sample half the samples seem spent; but the rates decide nearly all coefficients."""
    _, _, fit = fused(20_000, seed)
    assert float(fit.rms[0]) == pytest.approx(SPREAD[0], rel=0.02)
