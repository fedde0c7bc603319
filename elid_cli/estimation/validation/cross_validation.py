"""Errors on data not used in the fit: every contiguous stretch predicted by a fit to the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.judgement import JointError, SensorError
from elid_cli.estimation.regression.least_squares import Solution, solve_system
from elid_cli.estimation.regression.triangles import Triangles, factor_of
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import Robot


def held_out(
    robot: Robot, triangles: Triangles, solution: Solution, before: Solution | None = None
) -> dict[str, JointError]:
    """Return each joint's error on every fold, predicted by a fit to the other folds (`fold_fits`)."""
    return joint_errors(robot, triangles, left_out(triangles, fold_fits(triangles, solution, before)))


def left_out(triangles: Triangles, fits: Iterable[Array]) -> dict[EstimationRow, Array]:
    """Return the residual sum of squares of every row group per fold, (folds,), predicted by the `fits` of each."""
    squares = {row: np.zeros(triangles.folds) for row in triangles.rows}
    for fold, fitted in enumerate(fits):
        for row, found in squares.items():
            found[fold] = sum(t.squares(fitted) for t in triangles.of(row, [fold]))
    return squares


def all_others(folds: int) -> Iterator[list[int] | None]:
    """Yield the other folds of each; None, which stands for all, where there is one only."""
    for fold in range(folds):
        yield [f for f in range(folds) if f != fold] or None


def fold_fits(triangles: Triangles, solution: Solution, before: Solution | None = None) -> Iterator[Array]:
    """Yield the parameters, (p + e,), that a fit to all other folds gives, fold by fold.

    `before` is the triangles' own solution where `solution` was refined from it; the refinement is then added to every
    fold's fit.
    """
    shift = 0.0 if before is None else solution.values - before.values
    folds = range(triangles.folds)
    parts = [replace(triangles, prior=None).stacked(solution.weights, [fold]) for fold in folds]  # each reduced once
    known = [] if triangles.prior is None else [triangles.prior]
    for fold in folds:
        others = [part for number, part in enumerate(parts) if number != fold or len(parts) == 1]
        system = factor_of(np.concatenate([*others, *known]))
        yield solve_system(system, triangles.parameters, solution.weights, len(solution.basis)).values + shift


def joint_errors(
    robot: Robot, triangles: Triangles, squares: Mapping[EstimationRow, Array | float]
) -> dict[str, JointError]:
    """Return each joint's error from residual sums of squares per row group."""

    def rms(row: EstimationRow) -> float | None:
        count = sum(t.count for t in triangles.of(row))
        return None if row not in squares else float(np.sqrt(np.sum(squares[row]) / count)) if count else float("nan")

    return errors_of_rows(robot, rms, triangles.torque_rms)


def errors_of_rows(
    robot: Robot, rms: Callable[[EstimationRow], float | None], size: Callable[[EstimationRow], float]
) -> dict[str, JointError]:
    """Return each joint's error from the rms of every row's residual and of its torque; None: there is no such row."""
    errors = {}
    for k, joint in enumerate(robot.joints):
        total, motor, spring = (EstimationRow(kind, k) for kind in ("sum", "motor", "spring"))
        whole, own, read = rms(total), rms(motor), rms(spring)
        if whole is None:
            continue
        torque, sensor = size(total), None
        if read is not None:
            load, drive, nothing = rms(EstimationRow("load", k)), rms(EstimationRow("drive", k)), float("nan")
            sensor = SensorError(
                nothing if load is None else load, nothing if drive is None else drive, read, size(spring)
            )
        share = None if own is None else own / torque
        errors[joint.name] = JointError(whole, whole / torque, own, share, torque, sensor=sensor)
    return errors


def floored(
    errors: Mapping[str, JointError], joints: Sequence[str], floor: Mapping[EstimationRow, float]
) -> dict[str, JointError]:
    """Return errors by joint with the noise floor of each row filled in."""
    numbers = {name: k for k, name in enumerate(joints)}
    return {
        name: replace(
            e,
            floor=floor.get(EstimationRow("sum", numbers[name])),
            spring_floor=floor.get(EstimationRow("motor", numbers[name])),
        )
        for name, e in errors.items()
    }
