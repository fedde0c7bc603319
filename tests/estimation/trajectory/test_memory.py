"""Whether errors near each other in time are alike, told from sums over parts of a log."""

from __future__ import annotations

import numpy as np

from elid_cli.estimation.trajectory.memory import SHOWN, excess

UNKNOWNS, SAMPLES, PARTS = 8, 4800, 96


def excess_of(seed: int, memory: float) -> float:
    """Return what is told of a linear fit whose error remembers a part of the sample before."""
    rng = np.random.default_rng(seed)
    # columns that change slowly, as those of a motion do, and more towards the end, as those of a chirp
    time = np.linspace(0, 1, SAMPLES)
    columns = np.stack([np.sin((3 + 2 * k) * time * (1 + time) + k) for k in range(UNKNOWNS)], axis=1)
    columns *= (0.3 + time)[:, None]
    noise = rng.standard_normal(SAMPLES)
    error = np.empty(SAMPLES)
    error[0] = noise[0]
    for k in range(1, SAMPLES):
        error[k] = memory * error[k - 1] + np.sqrt(1 - memory**2) * noise[k]
    error -= columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    whole = columns.reshape(PARTS, -1, UNKNOWNS)
    matrix = np.einsum("bni,bnj->bij", whole, whole)
    load = np.einsum("bni,bn->bi", whole, error.reshape(PARTS, -1))
    return excess(matrix, load, float(np.mean(error**2)))


def test_white_noise_rarely_looks_like_a_memory() -> None:
    told = np.array([excess_of(seed, 0.0) for seed in range(200)])
    assert abs(told.mean()) < 0.3
    assert 0.7 < told.std() < 1.3
    assert np.mean(told > SHOWN) < 0.07


def test_a_short_memory_is_seen() -> None:
    told = np.array([excess_of(seed, 0.3) for seed in range(20)])
    assert (told > SHOWN).all()


def test_what_shows_nothing_has_no_memory() -> None:
    assert excess(np.zeros((PARTS, 3, 3)), np.zeros((PARTS, 3)), 1.0) == 0.0
