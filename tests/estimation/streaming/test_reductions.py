"""A reduction that is read off another one is the one that the data give."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from elid_cli.errors import DataError
from elid_cli.estimation.regression.least_squares import WEIGHT_ITERATIONS, reweighted, solve, solve_system
from elid_cli.estimation.regression.long_run import student_quantile
from elid_cli.estimation.regression.nuisances import delay_columns, offset_columns
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.triangles import Triangles, to_triangles
from elid_cli.estimation.stretches import stretch_of
from elid_cli.logs import read_recording
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.motion import random_motion
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare

Array = NDArray[np.float64]

LOG = Path(__file__).parents[3] / "sample_logs" / "puma560.h5"


@pytest.fixture(scope="module")
def observation() -> Observation:
    robot = read_robot("puma560")
    return observe(Regressor(robot), prepare(read_recording([LOG], robot), robot, SignalOptions(cutoff=10.0)))


def answer(base: BaseParameters, values: Array) -> Array:
    """Return base parameters and nuisances: which columns a pivoted QR solves for may hang on the last digit."""
    count = len(base.parameters)
    return np.concatenate([base.transform @ values[:count], values[count:]])


@pytest.mark.parametrize("chosen", [[], [2], [0, 5, 7, 11], [11, 3, 4], list(range(12))])
def test_with_fewer_or_reordered_columns(observation: Observation, chosen: list[int]) -> None:
    extras = [*delay_columns(observation), *offset_columns(observation)]
    fold = stretch_of(observation.instants, 6)
    some = [extras[k] for k in chosen]
    to_triangles(observation, extras, fold)
    short = to_triangles(observation, some, fold)
    fresh = to_triangles(replace(observation), some, fold)
    assert (short.rows, short.extras, short.folds) == (fresh.rows, fresh.extras, fresh.folds)
    for a, b in zip(short.items, fresh.items, strict=True):
        assert (a.row, a.fold, a.count, a.power) == (b.row, b.fold, b.count, b.power)
        order = np.argsort(a.index), np.argsort(b.index)
        assert np.array_equal(a.index[order[0]], b.index[order[1]])
        one, other = (t.factor[:, np.append(o, len(o))] for t, o in zip((a, b), order, strict=True))
        size = np.linalg.norm(other, axis=0)
        assert np.abs((one.T @ one - other.T @ other) / np.outer(size, size)).max() < 1e-12
    base = find_base(Regressor(observation.robot))
    one, other = (answer(base, reweighted(t, base.count + len(some)).values) for t in (short, fresh))
    assert np.abs(one - other).max() < 1e-9 * np.abs(other).max()


def same(a: Triangles, b: Triangles) -> bool:
    """Return whether two reductions are of the same instants and say the same, to rounding."""
    assert (a.rows, a.extras, a.folds) == (b.rows, b.extras, b.folds)
    for one, other in zip(a.items, b.items, strict=True):
        assert (one.row, one.fold, one.count) == (other.row, other.fold, other.count)
        assert one.power == pytest.approx(other.power, rel=1e-12)
        assert np.array_equal(one.index, other.index)
        size = np.linalg.norm(other.factor, axis=0)
        gap = one.factor.T @ one.factor - other.factor.T @ other.factor
        assert np.abs(gap / np.outer(size, size)).max() < 1e-12
    return True


@pytest.mark.parametrize("joints", [[], [1], [0, 1, 2, 3, 4, 5]])
def test_reversals_are_added_to_what_was_reduced_without_them(observation: Observation, joints: list[int]) -> None:
    extras = [*delay_columns(observation), *offset_columns(observation)]
    fold = stretch_of(observation.instants, 6)
    masked = to_triangles(observation, extras, fold)
    wider = observation.unmasked(np.isin(np.arange(6), joints))
    grown = to_triangles(wider, extras, fold)
    assert (sum(t.count for t in grown.items) > sum(t.count for t in masked.items)) == bool(joints)
    assert same(grown, to_triangles(replace(wider), extras, fold))
    some = [extras[k] for k in (3, 7)]
    order = to_triangles(wider, some, fold)
    assert [t.count for t in order.items] == [t.count for t in grown.items]
    assert same(to_triangles(observation, extras, fold), masked)  # which of both is asked first makes no difference


def test_a_fold_all_of_reversals_is_added_too(observation: Observation) -> None:
    fold = stretch_of(observation.instants, 6)
    extras = offset_columns(observation)
    empty = replace(observation, groups=tuple(replace(g, use=g.use & (fold != 2)) for g in observation.groups))
    few = np.flatnonzero(fold == 3)[:7]  # fewer than columns: kept as they are until there are more
    empty = replace(
        empty,
        groups=tuple(replace(g, use=g.use & (fold != 3) | np.isin(np.arange(len(fold)), few)) for g in empty.groups),
    )
    assert {t.fold for t in to_triangles(empty, extras, fold).items} == {0, 1, 3, 4, 5}
    wider = empty.unmasked(np.ones(6, dtype=bool))
    assert same(to_triangles(wider, extras, fold), to_triangles(replace(wider), extras, fold))


def test_fewer_instants_are_reduced_anew(observation: Observation) -> None:
    extras = offset_columns(observation)
    to_triangles(observation, extras)
    fewer = observation.only(np.arange(observation.instants) % 2 == 0)
    fewer.reductions[:] = observation.reductions
    assert same(to_triangles(fewer, extras), to_triangles(replace(fewer), extras))


def test_what_cannot_be_solved_is_left_out_or_refused() -> None:
    generator = np.random.default_rng(0)
    system = generator.standard_normal((20, 5))
    system[:, 2] = 0.0
    found = solve_system(system, 4, {}, basis=np.array([0, 2, 3]))
    assert sorted(found.basis) == [0, 3]
    expected = np.linalg.lstsq(system[:, [0, 3]], system[:, 4], rcond=None)[0]
    assert found.values == pytest.approx([expected[0], 0.0, 0.0, expected[1]], rel=1e-12)
    with pytest.raises(DataError, match="excites no parameter"):
        solve_system(system, 4, {}, basis=np.array([2]))
    for row, column in ((3, 1), (5, 4)):
        broken = system.copy()
        broken[row, column] = np.nan
        with pytest.raises(ValueError, match="NaN"):
            solve_system(broken, 4, {})


def test_weights_are_iterated_as_solving_every_time_would(observation: Observation) -> None:
    extras = [*delay_columns(observation), *offset_columns(observation)]
    triangles = to_triangles(observation, extras).joined()
    base = find_base(Regressor(observation.robot))
    rank = base.count + len(extras)
    weights = {row: 1.0 / triangles.torque_rms(row) for row in triangles.rows}
    solution = solve(triangles, weights, None, rank)
    for _ in range(WEIGHT_ITERATIONS):
        weights = {row: 1.0 / triangles.rms(solution.values, row) for row in weights}
        solution = solve(triangles, weights, None, rank, solution.basis)
    expected = solve(triangles, weights, None, rank)
    found = reweighted(triangles, rank)
    assert found.weights == pytest.approx(dict(expected.weights), rel=1e-9)
    one, other = answer(base, found.values), answer(base, expected.values)
    assert np.abs(one - other).max() < 1e-9 * np.abs(other).max()


def test_columns_that_repeat_are_computed_once_and_the_same() -> None:
    model = Regressor(read_robot("puma560"))
    program = model.estimation.program
    lean, place = program.distinct
    assert lean.outputs == len(set(place.tolist())) < program.outputs
    inputs = np.random.default_rng(0).uniform(-1, 1, (program.inputs, 500))
    whole, short = np.empty((program.outputs, 500)), np.empty((lean.outputs, 500))
    program.run(inputs, whole)
    lean.run(inputs, short)
    assert np.array_equal(short[place], whole)


def test_evenly_spaced_samples_of_splines_are_evaluated_alone() -> None:
    robot = read_robot("puma560")
    motion = prepare(read_recording([LOG], robot), robot, SignalOptions()).motion
    index = np.arange(3, motion.samples, 7)
    assert "q" not in vars(motion)
    part = motion[index]
    assert "q" not in vars(motion)
    for name in ("t", "q", "dq", "ddq", "theta", "dtheta", "ddtheta"):
        whole = getattr(motion, name)[index]
        assert np.abs(getattr(part, name) - whole).max() < 1e-12 * (1 + np.abs(whole).max())
    assert len(motion[np.array([5, 4, 9])].t) == 3
    assert random_motion(2, np.ones(2, dtype=bool), 10)[np.arange(0, 10, 3)].samples == 4


@pytest.mark.parametrize("degrees", [1.0, 1.7, 3.0, 12.5, 80.0, 400.0, 5000.0])
def test_students_t_is_that_of_scipy(degrees: float) -> None:
    from scipy.special import stdtrit

    for probability in (0.6, 0.975, 0.995):
        assert student_quantile(degrees, probability) == pytest.approx(
            stdtrit(degrees, probability), rel=1e-8
        )  # SciPy 1.12 is that exact
