"""The part of what is left that columns take: nothing by chance, all of it at most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.projection import Projected, Stretch
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.effect_columns import extra_of
from elid_cli.model.effects import effect_classes
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import laws_of, log_of, make, recorded

RATE = 500.0


@pytest.fixture(scope="module")
def state() -> State:
    """Return the plain model on a log in which the last joint's torque ripples."""
    made = make(302, 2, rate=RATE)
    signals = log_of(made, laws_of("torque_ripple", made, 1))
    log = recorded(made, signals, db=90.0, counts=0.0, torque=0.002, colour=0.0, seed=1)
    return refreshed(fit(divided(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE))), ()))


def noise(state: State, seed: int, width: int, joint: int) -> dict[EstimationRow, np.ndarray]:
    """Return columns of noise in the sum and motor rows of a joint."""
    generator = np.random.default_rng(seed)
    size = (width, state.log.observation.instants)
    return {
        EstimationRow("sum", joint): generator.standard_normal(size),
        EstimationRow("motor", joint): generator.standard_normal(size),
    }


def left(state: State, joint: int) -> dict[EstimationRow, np.ndarray]:
    """Return what the model leaves of a joint's rows as a column."""
    found = residuals(state.log.observation, state.solution.values, state.extras)
    return {
        EstimationRow("sum", joint): found["sum", joint][None],
        EstimationRow("motor", joint): found["motor", joint][None],
    }


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("width", [1, 5, 20])
def test_noise_takes_next_to_nothing(state: State, joint: int, width: int) -> None:
    assert all(0.0 <= state.projected.taken(noise(state, seed, width, joint)) < 0.02 for seed in range(5))


@pytest.mark.parametrize("joint", [0, 1])
def test_what_is_left_takes_all_of_itself_and_no_more(state: State, joint: int) -> None:
    assert 0.95 < state.projected.taken(left(state, joint)) <= 1.0


def test_the_effect_itself_takes_nearly_all_and_another_next_to_nothing(state: State) -> None:
    ripple = effect_classes()["torque_ripple"]
    part, less = (
        state.projected.taken(extra_of(ripple(1, (order,)), state.scene, state.log.signals).rows)
        for order in (14.0, 9.0)
    )
    assert 0.6 < part <= 1.0
    assert 0.0 <= less < 0.1


def test_what_the_model_explains_already_takes_nothing(state: State) -> None:
    group = state.log.observation.group(EstimationRow("motor", 1))  # the only row that K2 stands in
    place = group.index.tolist().index(state.log.model.index["K2"])
    assert state.projected.taken({group.row: group.columns[[place]].copy()}) == 0.0
    assert state.projected.taken({}) == 0.0


@dataclass(frozen=True)
class White:
    """The whitener of a joint whose one row is white already."""

    rows: tuple[EstimationRow, ...]

    def apply(self, series: np.ndarray) -> np.ndarray:
        return series


def two_joints(shared: np.ndarray, residual: np.ndarray) -> Projected:
    """Return two joints of one white row each, whose residual (2M,) is left by one parameter that both share."""
    folds, instants = 6, len(shared)
    length = instants // folds
    basis = np.concatenate([shared, -shared])[:, None] / (np.sqrt(2.0) * np.linalg.norm(shared))
    return Projected(
        cast(Any, tuple(White((EstimationRow("sum", joint),)) for joint in range(2))),
        (np.arange(instants),) * 2,
        (slice(0, instants), slice(instants, 2 * instants)),
        basis,
        residual - basis[:, 0] * (basis[:, 0] @ residual),
        tuple(
            Stretch(joint, fold, slice(joint * instants + fold * length, joint * instants + (fold + 1) * length))
            for joint in range(2)
            for fold in range(folds)
        ),
        folds,
        instants,
    )


def test_what_another_joint_loses_along_is_not_counted() -> None:
    """A parameter that both joints share passes a column of the first on to the second."""
    shared, noise = np.random.default_rng(1).standard_normal((2, 240))
    projected = two_joints(shared, np.concatenate([shared, shared]) + 0.01 * np.tile(noise, 2))
    assert 0.8 < projected.taken({EstimationRow("sum", 0): shared[None]}) <= 1.0


def test_many_columns_of_a_short_log_take_nothing_by_fitting_noise() -> None:
    """They are judged where they were not fitted: there, 40 columns in 480 equations took a twelfth."""
    generator = np.random.default_rng(2)
    shared, columns = generator.standard_normal(240), generator.standard_normal((40, 240))
    projected = two_joints(shared, generator.standard_normal(480))
    assert projected.taken({EstimationRow("sum", 0): columns}) < 0.01


def test_gains_of_several_candidates_are_those_of_whole_least_squares(state: State) -> None:
    """Columns in one joint's rows, of which the model spans part, scored together and dense, one by one."""
    projected = state.projected
    mixed = noise(state, 3, 3, 1)
    for row, columns in mixed.items():
        columns[0] = state.log.observation.group(row).columns[0]
        columns[1] += columns[0]
    candidates = [noise(state, 1, 3, 0), mixed, noise(state, 2, 3, 0), left(state, 1)]
    for rows, gain in zip(candidates, projected.gains(candidates), strict=True):
        white = np.zeros((projected.count, len(next(iter(rows.values())))))
        for joint, (whitener, seen, place) in enumerate(
            zip(projected.whiteners, projected.seen, projected.places, strict=True)
        ):
            if EstimationRow("sum", joint) in rows:
                series = whitener.apply(np.array([rows[row] for row in whitener.rows]))
                white[place] = np.concatenate([channel[:, seen].T for channel in series])
        both = np.hstack([projected.basis, white / np.linalg.norm(white, axis=0)])
        rest = projected.residual - both @ np.linalg.lstsq(both, projected.residual, rcond=1e-10)[0]
        whole = sum(
            0.5 * (c.stop - c.start) * np.log(np.sum(projected.residual[c] ** 2) / np.sum(rest[c] ** 2))
            for c in projected.channels
        )
        assert gain is not None
        assert gain.whole == pytest.approx(whole, rel=1e-6, abs=1e-6)
