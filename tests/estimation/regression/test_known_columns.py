"""Columns that are kept between fits are those that would be computed anew."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from elid_cli.estimation.regression.effect_columns import extra_of
from elid_cli.estimation.regression.known_columns import KnownColumns
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.free_decay import decaying
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.recording import Segment
from tests.model.effects.effect_scenes import N, planar, scene_of

KEPT = ("backlash", "contact", "hysteresis", "payload", "stribeck", "torque_delay", "torque_ripple")
"""Effects of motion and logged torque alone."""


def signals(scene: Scene) -> Any:
    """Return what columns are reduced by: one segment, no filter."""
    return cast(
        Any, SimpleNamespace(motion=scene.motion, segments=(Segment(0, N),), decimate=lambda rows: rows[:, ::7])
    )


def effect_in(scene: Scene, name: str) -> Effect:
    kind = effect_classes()[name]
    joint = kind.number(scene.robot, None) if kind.whole_robot else scene.robot.n - 1
    _, shape = kind.coefficients(scene, joint, kind.example)
    return kind(joint, shape)


def fitted_otherwise(scene: Scene) -> Scene:
    """Return the scene of the same log after another fit."""
    return replace(scene, load=1.3 * scene.load, predicted=0.8 * scene.predicted, parameters=1.1 * scene.parameters,
                   stiffness=1.2 * scene.stiffness, cache={})  # fmt: skip


@pytest.mark.parametrize("name", effect_classes())
def test_columns_follow_what_they_are_computed_from(name: str) -> None:
    first = scene_of(planar())
    effect, known = effect_in(first, name), KnownColumns(signals(first))
    kept = []
    for scene in (first, first, fitted_otherwise(first), replace(first, tau=2.0 * first.tau, cache={})):
        found, anew = known.of(effect, scene), extra_of(effect, replace(scene, cache={}), signals(scene))
        assert found.rows.keys() == anew.rows.keys()
        assert all(np.array_equal(found.rows[row], anew.rows[row]) for row in anew.rows)
        kept.append(found)
    assert kept[0] is kept[1]
    if name in KEPT:
        assert kept[0] is kept[2]


@pytest.mark.parametrize("factor", [0.999 * np.exp(0.3j), np.exp(-2.0 + 1.0j), 1.0 + 0j])
@pytest.mark.parametrize("samples", [1, 63, 64, 65, 1000])
def test_a_decaying_history_is_its_recursion(factor: complex, samples: int) -> None:
    driven = np.random.default_rng(0).standard_normal((samples, 2)).view(complex)[:, 0]
    states, state = [], 0j
    for push in driven.tolist():
        state = complex(factor) * state + push
        states.append(state)
    assert np.allclose(decaying(complex(factor), driven), states, rtol=0, atol=1e-11)
