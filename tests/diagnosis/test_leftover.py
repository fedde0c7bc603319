"""What an effect leaves, or takes too well, says that its name is a wrong one; but not everything does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elid_cli.diagnosis.evidence import leftover
from elid_cli.model.regressor import EstimationRow

ROW = EstimationRow("motor", 1)


def poor(before: float, after: float, *, sticks: bool, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Return whether an effect of the motor's speed fits poorly that leaves `after` of `before`, in times the noise."""
    groups = SimpleNamespace(beyond=True, groups=("motor speed",))
    monkeypatch.setattr(leftover, "followed_by", lambda *_: groups)
    monkeypatch.setattr(leftover, "following", lambda *_: groups)
    monkeypatch.setattr(leftover, "_sticks", lambda *_: sticks)
    lacking: Any = SimpleNamespace(ratios=lambda: {ROW: before})
    columns = [SimpleNamespace(rows={ROW: np.ones((1, 5))})]
    state: Any = SimpleNamespace(ratios=lambda: {ROW: after}, coefficients=lambda _: np.ones(1), columns=columns)
    return leftover._fits_poorly(lacking, state, 0, ROW)


@pytest.mark.parametrize(
    ("after", "sticks", "is_poor"),
    [
        (3.56, True, False),  # `elid simulate --robot planar2 --effect stribeck@joint2:amplitude=3,velocity=0.12`
        (3.56, False, True),  # a curve that follows the speed where something else is missing
        (6.0, True, True),  # friction that builds up over a distance: the motor sticks, and most is left
        (1.5, False, False),
    ],
)
def test_what_a_sticking_motor_leaves_is_no_poor_fit_of_its_friction(
    after: float, sticks: bool, is_poor: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert poor(13.45, after, sticks=sticks, monkeypatch=monkeypatch) == is_poor


@pytest.mark.parametrize(("before", "after", "silent"), [(1.2, 0.5, True), (9.7, 0.5, False), (9.7, 0.9, False)])
def test_what_was_far_from_noise_may_come_below_it(
    before: float, after: float, silent: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise that is taken for too large refuses an effect that fits it, not one that takes ten times as much."""
    floor = SimpleNamespace(rms={ROW: 1.0})
    lacking: Any = SimpleNamespace(rms=lambda _: before, floor=floor)
    monkeypatch.setattr(leftover, "without", lambda *_: lacking)
    noise = SimpleNamespace(floor=lambda _: floor)
    effect = SimpleNamespace(corrects=None, whole_robot=False, quasi_static=False)
    state: Any = SimpleNamespace(
        effects=[effect], columns=[SimpleNamespace(rows={ROW: None})],
        triangles=SimpleNamespace(rows={ROW: None}, torque_rms=lambda _: 10.0), floor=floor, rms=lambda _: after,
        log=SimpleNamespace(noise_alone=noise), standard=None,
    )  # fmt: skip
    assert leftover.silences(state, 0) == silent
