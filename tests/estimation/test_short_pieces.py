"""`--accurate` on slow logs in pieces shorter than the widest window that a torque's rate is taken over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.collocation.setup import _WINDOWS, _rate
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, World, _late, log_of, make, recorded

DT, DELAY = 0.01, 0.01


@pytest.mark.parametrize("samples", [*_WINDOWS, 4, 3, 50, 75, 80, 82])
def test_a_rate_is_taken_over_no_more_samples_than_there_are(samples: int) -> None:
    t = np.arange(samples) * DT
    noise = 10.0 * np.random.default_rng(samples).standard_normal(samples)
    rate = _rate(3.0 * t + noise, 10.0, DT)  # no window is wide enough
    assert rate.shape == (samples,)
    assert np.isfinite(rate).all()
    assert rate.any() == (samples >= min(_WINDOWS))


def test_a_quiet_torque_has_an_exact_rate_and_a_noisy_one_the_widest_window() -> None:
    t = np.arange(200) * DT
    torque, rate = np.sin(3.0 * t), 3.0 * np.cos(3.0 * t)
    noise = 0.03 * np.random.default_rng(1).standard_normal(len(t))
    inner = slice(50, -50)
    assert _rate(torque, 0.0, DT)[inner] == pytest.approx(rate[inner], abs=2e-3)
    left = _rate(torque + noise, 0.03, DT) - rate
    assert np.sqrt(np.mean(left[inner] ** 2)) < 0.15
    assert np.sqrt(np.mean((np.gradient(torque + noise, DT) - rate)[inner] ** 2)) > 1.0


def test_a_delay_in_short_pieces_of_a_noisy_log_is_an_unknown() -> None:
    """Recorded at 100 Hz, three quarters of a second each, with more torque noise than any window takes off."""
    piece = 76

    def late(world: World, signals: dict[str, np.ndarray]) -> None:
        _late(world.t, signals["tau"], 0, -DELAY)

    made = make(303, 2, rate=1 / DT, duration=15.0)
    signals = log_of(made, Laws(sensors=[late]))
    log = recorded(made, signals, db=90.0, counts=0.0, torque=0.08, colour=0.0, seed=1)
    pieces = tuple(Segment(k, k + piece) for k in range(0, log.samples - piece + 1, piece))
    log = replace(log, segments=pieces)
    found = identify(made.robot, prepare(log, made.robot), EstimateOptions(accurate=True, guards=False))
    assert found.estimator in ("accurate", "default")
    assert np.isfinite(found.estimate).any()
    delay = next(n for n in found.nuisances if n.joint == "j1")
    assert delay.parameters["delay"] == pytest.approx(DELAY, abs=2e-3)
