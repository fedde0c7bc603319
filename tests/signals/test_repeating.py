"""A motion that repeats is recognised, with its period."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.signals.recording import Segment
from elid_cli.signals.repeating import repeats_every
from elid_cli.signals.signals import Signals, prepare
from tests.system.plain_arms import log, random_arm

ARM = random_arm(np.random.default_rng(1), 2)
PERIOD = 5.4


def made(times: int, noise: float = 1e-5) -> Signals:
    once = log(ARM, 1, PERIOD)
    generator, count = np.random.default_rng(2), times * len(once.t)

    def again(values: np.ndarray) -> np.ndarray:
        tiled = np.concatenate([values] * times)
        return tiled + noise * generator.standard_normal(tiled.shape)

    recording = dataclasses.replace(
        once, t=np.arange(count) * once.dt, q=again(once.q), theta=again(once.theta), tau=again(once.tau),
        segments=(Segment(0, count),),
    )  # fmt: skip
    return prepare(recording, ARM.described())


@pytest.mark.parametrize("times", [2, 3, 5])
def test_a_repeated_motion_is_told_with_its_period(times: int) -> None:
    signals = made(times)
    assert repeats_every(signals) == pytest.approx(PERIOD, abs=1.01 / signals.rate)


def test_a_motion_that_goes_on_is_not() -> None:
    assert repeats_every(made(1)) is None
    assert repeats_every(prepare(log(ARM, 3, 20.0), ARM.described())) is None
