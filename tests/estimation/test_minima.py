"""Least values of functions of a few unknowns: SciPy's own points, and no worse ends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares as theirs
from scipy.optimize import minimize, minimize_scalar

from elid_cli.estimation.minima import between, by_simplex, least_squares


@pytest.mark.parametrize("seed", range(5))
def test_between_looks_at_the_points_that_scipy_looks_at(seed: int) -> None:
    place, power = np.random.default_rng(seed).uniform((-0.6, 1.2), (0.6, 3.0))
    mine, other = list[float](), list[float]()

    def cost(z: float, seen: list[float]) -> float:
        seen.append(float(z))
        return float(np.abs(z - place) ** power + 0.1 * np.sin(4 * z))

    found = between(lambda z: cost(z, mine), -0.7, 0.7, 14)
    end = minimize_scalar(lambda z: cost(z, other), bounds=(-0.7, 0.7), method="bounded", options={"maxiter": 14})
    assert np.allclose(mine, other, rtol=0, atol=1e-12)
    assert found == pytest.approx(end.x, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_simplex_looks_at_the_points_that_scipy_looks_at(seed: int) -> None:
    draw = np.random.default_rng(seed)
    root, place = draw.normal(size=(3, 3)), draw.uniform(-1, 1, 3)
    mine, other = list[np.ndarray](), list[np.ndarray]()

    def cost(z: np.ndarray, seen: list[np.ndarray]) -> float:
        seen.append(z.copy())
        return float(np.sum((root @ (z - place)) ** 2) + 0.2 * np.sum(np.sin(3 * z)))

    first = np.vstack([np.zeros(3), 0.25 * np.eye(3)])
    found = by_simplex(lambda z: cost(z, mine), first, 40)
    options = {"maxfev": 40, "initial_simplex": first}
    minimize(lambda z: cost(z, other), np.zeros(3), method="Nelder-Mead", options=options)
    assert 40 <= len(mine) < 40 + 2 + len(place)
    assert np.allclose(mine[:40], other, rtol=0, atol=1e-12)
    assert cost(found, mine) == min(cost(z, []) for z in mine)


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_ends_as_low_as_scipy_within_bounds(seed: int) -> None:
    draw, t = np.random.default_rng(seed), np.linspace(0, 3, 200)
    truth, noise = draw.uniform((-1.4, 0.0), (0.0, 1.0)), 0.01 * draw.standard_normal(len(t))
    bounds = (np.array([-1.0, -1.0]), np.array([0.8, 0.8]))

    def residual(z: np.ndarray) -> np.ndarray:
        fall = [np.exp(-t * np.exp(rate)) for rate in (*z, *truth)]
        return np.asarray(fall[0] + 2 * fall[1] - fall[2] - 2 * fall[3] + noise)

    found, cost = least_squares(residual, np.zeros(2), bounds, 1e-3, 25)
    end = theirs(residual, np.zeros(2), bounds=bounds, diff_step=np.full(2, 1e-3), x_scale=0.3, max_nfev=25)
    assert np.all((found >= bounds[0]) & (found <= bounds[1]))
    assert cost == pytest.approx(0.5 * float(np.sum(residual(found) ** 2)))
    assert cost <= end.cost * (1 + 1e-5)
