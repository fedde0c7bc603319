"""Friction that makes a motor stick is named, though what it does near standstill bends any curve."""

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
