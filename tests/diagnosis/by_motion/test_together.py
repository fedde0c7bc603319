"""Which of several changes that do alike is named, and what is told beside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion import together, torque_gains
from elid_cli.diagnosis.by_motion.together import simplest, twins_of_gains
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.estimation.trajectory.changes import Changed

SIZE = np.array([1e-4, 2e-4])


def fit(nearer: float) -> Any:
    """Return a fit whose error is smaller than `SIZE` by this sum of logarithms."""
    return SimpleNamespace(equations=SimpleNamespace(size=SIZE * np.exp(-0.5 * nearer)))


def change(name: str, nearer: float, deviations: list[float], joints: tuple[int, ...] = ()) -> Any:
    """Return a change of numbers that are 1 with these standard errors."""
    by = SimpleNamespace(joints=joints, count=len(deviations), kind=SimpleNamespace(name=name, record="", of_drive=""))
    found = Changed(by, np.ones(len(deviations)), np.array(deviations), None, fit(nearer))  # type: ignore[arg-type]
    return SimpleNamespace(by=by, fit=found.fit, sure=found.sure, numbers=found.numbers, is_nearer=lambda _: True)


@pytest.fixture(autouse=True)
def _named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        together, "effects_of", lambda one, before: [FoundEffect(one.by.kind.name, None, {"m": 1.0}, {}, 0.3, "")]
    )


def test_the_change_of_fewest_numbers_is_named() -> None:
    zero = change("encoder_zero", 2.0, [0.01], (1,))
    load = change("payload", 2.05, [np.inf, 0.01, 0.5])  # two numbers that a joint feels, one of them sure
    assert (zero.numbers, load.numbers) == (1, 2)
    best, rivals = simplest([load, zero], fit(0.0))
    assert best is zero
    assert [(rival.effect, rival.instead_of) for rival in rivals] == [("payload", "encoder_zero")]

    clearer = change("payload", 2.6, [np.inf, 0.01, 0.5])
    best, rivals = simplest([clearer, zero], fit(0.0))
    assert best is clearer
    assert not rivals


def test_numbers_of_joints_count_where_they_are_sure() -> None:
    assert change("torque_delay", 1.0, [0.01, 0.5, 0.01], (0, 1, 2)).numbers == 2


def test_a_load_is_told_beside_a_gain_that_does_no_better() -> None:
    gains: Any = SimpleNamespace(fit=fit(2.0))
    asked: Any = SimpleNamespace(fit=fit(1.9), changes=(change("payload", 1.9, [0.01]),))
    told = twins_of_gains(gains, asked, fit(0.0))
    assert [(rival.effect, rival.instead_of) for rival in told] == [("payload", "torque_gain")]
    asked.fit = fit(1.5)
    assert not twins_of_gains(gains, asked, fit(0.0))
    assert not twins_of_gains(gains, None, fit(0.0))


@pytest.mark.parametrize(("left", "asked"), [(0.55, True), (0.85, False)])
def test_a_gain_is_asked_for_by_what_it_takes_beyond_noise(
    monkeypatch: pytest.MonkeyPatch, left: float, asked: bool
) -> None:
    # of 1.4 times the noise a right model leaves 0.51 of the squared error
    beside = SimpleNamespace(steps=np.array([0.1]), deviations=np.array([1e-3]), left=np.array([1.0, left]))
    monkeypatch.setattr(torque_gains, "moved_by_gains", lambda fit, joints: [])
    monkeypatch.setattr(torque_gains.Beside, "of", lambda fit, moved: beside)
    off: Any = SimpleNamespace(above_noise=lambda signals: np.array([1.0, 1.4]))
    found = torque_gains.asked_by_motion(off, None, ())  # type: ignore[arg-type]
    assert [scale.joint for scale in found] == ([1] if asked else [])
