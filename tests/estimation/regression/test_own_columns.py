"""Triangles by the reflections of an observation's own columns are those of the whole system."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.own_columns import beside_own
from elid_cli.estimation.regression.triangles import to_triangles
from elid_cli.model.effects import effect_classes
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import laws_of, log_of, make, recorded

RATE = 500.0


@pytest.fixture(scope="module")
def log() -> Log:
    made = make(302, 2, rate=RATE)
    told = recorded(made, log_of(made, laws_of("torque_ripple", made, 1)), db=90.0, counts=0.0, torque=0.002,
                    colour=0.0, seed=1)  # fmt: skip
    return divided(made.robot, prepare(told, made.robot, SignalOptions.for_diagnosis(RATE)))


def test_they_have_the_same_products_and_solution(log: Log) -> None:
    scene = scene_of(log.model, log.signals, np.ones(log.model.parameters))
    for name in ("load_friction", "torque_ripple", "encoder_offset"):
        kind = effect_classes()[name]
        extras = [*log.data.delays, log.columns.of(kind(1, kind.grid(scene, 1)[0]), scene)]
        whole = to_triangles(log.training, extras, log.fold)
        own = beside_own(log.training, extras, log.fold)
        assert own is not None
        for one, other in zip(whole.items, own.items, strict=True):
            assert (one.row, one.fold, one.count, one.power) == (other.row, other.fold, other.count, other.power)
            assert np.array_equal(one.index, other.index)
            products = one.factor.T @ one.factor
            size = np.sqrt(np.diag(products))
            assert np.abs(other.factor.T @ other.factor - products).max() <= 1e-12 * size.max() ** 2
        rank = log.base.count + whole.extras
        found, expected = reweighted(own, rank), reweighted(whole, rank)
        assert np.allclose(found.values, expected.values, rtol=1e-8, atol=1e-10)


def test_a_first_reduction_keeps_nothing(log: Log) -> None:
    fresh = log.observation.only(log.fold >= 0)
    assert beside_own(fresh, log.data.delays, log.fold) is None
