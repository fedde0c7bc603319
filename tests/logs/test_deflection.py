"""Two positions of one joint: one logged twice, or both ends of a spring."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.logs.checks.deflection import Sensed, same_position

RIGID, STIFF, SOFT = 0.0, 3e5, 1e4
"""N·m/rad; 0: no spring."""


def two_positions(
    stiffness: float, *, noise: float = 0.0, quantum: float = 0.0, late: float = 0.0, every: int = 1, seed: int = 0
) -> tuple[Sensed, Sensed, Sensed]:
    """Return q, theta and tau of an arm with 20 N·m of gravity and 4 N·m of friction, 1000 Hz, 10 s."""
    rng = np.random.default_rng(seed)
    w, phase, size = 2 * np.pi * rng.uniform(0.2, 1.5, 6), rng.uniform(0, 6, 6), rng.normal(0, 0.3, 6)

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = np.outer(t, w) + phase
        return np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)

    def load(t: np.ndarray) -> np.ndarray:
        q, _, ddq = motion(t)
        return 2 * ddq + 20 * np.cos(q)

    t = np.arange(10_000) / 1000
    own = t[::every] + (0.0003 if every > 1 else 0.0)
    q, dq, ddq = motion(t)
    theta = motion(own + late)[0] + (load(own) / stiffness if stiffness else 0.1)
    tau = load(t) + 0.5 * ddq + 3 * np.sign(dq) + dq + 0.3 * rng.normal(size=t.size)
    q, theta = (values + noise * rng.normal(size=values.size) for values in (q, theta))
    if quantum:
        q, theta = np.round(q / quantum) * quantum, np.round(theta / (1.37 * quantum)) * 1.37 * quantum
    return Sensed(t, q), Sensed(own, theta), Sensed(t, tau)


@pytest.mark.parametrize(
    "sensors",
    [
        {},
        {"noise": 1e-4},
        {"quantum": 1e-4},
        {"noise": 1e-5, "late": 2e-3},
        {"quantum": 1e-4, "late": 1e-3},
        {"noise": 1e-5, "every": 7},
        {"quantum": 1e-4, "every": 10},
    ],
    ids=str,
)
def test_one_position_twice_is_told_from_a_spring(sensors: dict[str, float]) -> None:
    """The stiff spring bends by a tenth of what its sensors' noise or quanta are."""
    for seed in range(3):
        assert same_position(*two_positions(RIGID, seed=seed, **sensors))
        assert not same_position(*two_positions(STIFF, seed=seed, **sensors))
        assert not same_position(*two_positions(SOFT, seed=seed, **sensors))


def test_glitches_of_one_sensor_are_no_deflection() -> None:
    q, theta, tau = two_positions(RIGID, noise=1e-5)
    theta.values[[1200, 5000, 5001]] = 0.0
    assert same_position(q, theta, tau)


def test_what_is_more_than_noise_is_no_rigid_joint_even_without_torque() -> None:
    q, theta, _ = two_positions(SOFT, noise=1e-5)
    assert not same_position(q, theta, None)
    assert same_position(*two_positions(RIGID, noise=1e-5)[:2], None)


def test_positions_that_never_overlap_decide_nothing() -> None:
    q, theta, tau = two_positions(RIGID)
    assert not same_position(q, Sensed(theta.t + 100.0, theta.values), tau)
