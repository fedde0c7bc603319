"""Exciting trajectories: quintic B-splines from rest to rest that tell most about the base parameters.

The log determinant of the information (D-optimality) is maximised by a quasi-Newton method with exact gradients;
limits on position, velocity, acceleration and torque are penalties while optimising and are met exactly at the end,
by letting a joint that still breaks one move a little less. With aims, the standard deviations of the base parameters
that contain them come first and the rest of the information second.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, names, number, optional, options_given, real, several, whole
from elid_cli.errors import DataError, UsageError, did_you_mean
from elid_cli.experiment.bounds import ROOM, Bounds, bounds_of, within
from elid_cli.experiment.forecast import RATE as FORECAST_RATE
from elid_cli.experiment.forecast import forecast
from elid_cli.experiment.information import Evaluation, Information, States, Weights, residuals_of
from elid_cli.experiment.reference import ReferenceOptions, ReferenceSpline, SplineReference, random_reference
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.consistency import consistency, prior
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.tables import Shown

INSTANTS = 15.0
"""Instants per second at which the motion is judged while it is optimised."""
BANDWIDTH = 20.0
"""Independent samples per second that a log filtered at 10 Hz holds."""
ANGLES = 1.7
"""Weight per base parameter against the columns' variance inflation, beside the log volume. Without it the volume
grows by a third more on PUMA 560, and the condition number does not fall."""
BALANCE = 0.1
"""Weight of the log volume beside the standard deviations aimed at."""
PENALTIES = (20.0, 400.0)
"""Weights of broken limits in the two rounds of optimisation, per instant and squared relative excess."""
ENDS = 4
"""Control points at each end that are equal, so that it starts and ends at rest and without a jerk."""


_RULES = {
    "duration": number(above=0),
    "interval": optional(number(above=0)),
    "aims": names,
    "residual": number(above=0),
    "measured": optional(several(several(real, "residuals"), "pairs, one per joint")),
    "starts": whole(1),
    "rounds": whole(0),
    "seed": whole(0),
}


@dataclass(frozen=True)
class ExciteOptions:
    """What to look for."""

    duration: float = 20.0
    """s."""
    interval: float | None = None
    """Time between the splines' way-points, s; by default each joint has its own, from its limits."""
    aims: tuple[str, ...] = ()
    """Standard parameters that the log must show above all."""
    residual: float = 0.02
    """Expected residual of each torque, as a share of its rms, after filtering."""
    measured: tuple[tuple[float, float], ...] | None = None
    """Residual rms of every joint's sum and motor row in the last log, N·m: expected instead of a share."""
    starts: int = 8
    """Random motions of which the best is improved."""
    rounds: int = 40
    """Steps of each of the two rounds of optimisation."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse a motion that takes no time, or that nothing is tried for (UsageError)."""
        check_fields(self, _RULES)


@dataclass(frozen=True, repr=False)
class Excitation(Shown):
    """An exciting trajectory, what a log of it will show, and what random motion of equal length would."""

    robot: Robot
    base: BaseParameters
    trajectory: SplineReference
    evaluation: Evaluation
    random: Evaluation
    """Median random motion (by its condition number) of the same length."""
    std_error: Array
    """Standard deviations of the base parameters that estimation will give, (b,), in `base.units`; infinite where
    it sees nothing."""
    random_std_error: Array
    """Those after the random motion, (b,), in `base.units`."""
    used: dict[str, Array]
    """Share of each limit that the trajectory uses, (n,); NaN where the robot file has no limit."""
    options: ExciteOptions
    massless: tuple[str, ...] = ()
    """Masses of 0 in the robot file for which those of a typical arm are taken, without which some base parameters
    would not show."""

    @property
    def relative(self) -> Array:
        """Predicted standard deviations relative to reference values, (b,); NaN where there is none."""
        reference = np.abs(self.base.values(self.robot.reference()))
        known = np.isfinite(reference) & (reference > 1e-12 * np.nan_to_num(reference).max(initial=0.0))
        relative = np.full(len(reference), np.nan)
        relative[known] = self.std_error[known] / reference[known]
        return relative

    @property
    def unknown(self) -> tuple[int, int]:
        """How many parameters act on the torques, and of how many of them the robot file gives no value."""
        acting = np.any(self.base.transform != 0, axis=0)
        return int(acting.sum()), int((acting & np.isnan(self.robot.reference())).sum())

    @property
    def gain(self) -> float:
        """How many times smaller standard errors are than after random motion, geometric mean."""
        return float(np.exp((self.evaluation.log_det - self.random.log_det) / self.base.count))


def excite(
    robot: Robot, options: ExciteOptions | None = None, progress: Callable[[float], None] | None = None
) -> Excitation:
    """Return an exciting trajectory for a robot.

    Parameters
    ----------
    robot
        Its limits bound the motion (defaults where it has none); its reference values give the torques, a typical
        body's where it has none, or where masses of 0 would leave stiffness and rotor alike.
    options
        What to look for.
    progress
        Called with the fraction done.

    Raises
    ------
    UsageError
        An aim that is no parameter of the robot, or a duration too short to move.
    DataError
        An aim that no motion can show.

    """
    check_robot(robot)
    options = options_given("excite", options, ExciteOptions)
    model = Regressor(robot)
    base = find_base(model)
    aims = _aims(base, options.aims)
    scales = consistency(robot, robot.reference()).scales
    parameters = prior(robot, scales)
    bounds = bounds_of(robot)
    grid = np.linspace(0.0, options.duration, max(round(options.duration * INSTANTS), 40))
    starts = [_start(robot, options, seed) for seed in range(options.seed, options.seed + max(options.starts, 1))]
    first = starts[0].evaluate(grid)
    massless: tuple[str, ...] = ()
    try:
        unit = Information(model, base, parameters, np.ones((2, robot.n)), 1.0, first)
    except DataError:
        # a body told by its hinge inertia alone loads its transmission as its rotor does: the two look alike
        names = robot.parameter_names()
        missing = np.array([name.kind == "m" for name in names]) & (parameters == 0)
        massless = tuple(str(names[k]) for k in np.flatnonzero(missing))
        parameters = np.where(missing, scales.sizes, parameters)
        unit = Information(model, base, parameters, np.ones((2, robot.n)), 1.0, first)
    residual = _residuals(unit.torques(first), options, robot)
    information = Information(model, base, parameters, residual, options.duration * BANDWIDTH / len(grid), first)
    judged = [information.evaluate(start.evaluate(grid)) for start in starts]
    order = sorted(range(len(starts)), key=lambda k: judged[k].condition)
    weights = Weights(BALANCE, 0.0, tuple(aims)) if aims else Weights(1.0, ANGLES * base.count)
    best = max(range(len(starts)), key=lambda k: (_merit(judged[k], weights), -k))
    search = _Search(information, bounds, grid, weights, starts[best])
    trajectory = search.run(options.rounds, progress)
    trajectory, used = within(trajectory, information.torques, bounds)
    median = order[len(order) // 2]
    noise = residual if options.measured else np.stack([residual[0], residual[0]])
    mine, other = (forecast(information, base, _played(s, options), noise) for s in (trajectory, starts[median]))
    return Excitation(
        robot, base, trajectory, information.evaluate(trajectory.evaluate(grid)), judged[median], mine, other, used,
        options, massless,
    )  # fmt: skip


def _residuals(torque: Array, options: ExciteOptions, robot: Robot) -> Array:
    """Return the expected residual rms of sum and motor rows, (2, n)."""
    if options.measured is None:
        return residuals_of(torque, options.residual, robot.elastic)
    rms = np.sqrt(np.mean(torque**2, axis=0))
    known = np.array(options.measured, dtype=float).T
    return np.where(known > 0, known, options.residual * np.maximum(rms, 0.01 * rms.max()))


def _played(motion: SplineReference, options: ExciteOptions) -> States:
    return motion.evaluate(np.arange(round(options.duration * FORECAST_RATE) + 1) / FORECAST_RATE)


def _start(robot: Robot, options: ExciteOptions, seed: int) -> SplineReference:
    return random_reference(robot, options.duration, seed, ReferenceOptions(interval=options.interval))


def _merit(evaluation: Evaluation, weights: Weights) -> float:
    aimed = float(np.log(evaluation.std_error[list(weights.aims)]).sum()) if weights.aims else 0.0
    return weights.volume * evaluation.log_det - aimed - weights.angles * float(np.log(evaluation.condition))


def _aims(base: BaseParameters, names: Sequence[str]) -> list[int]:
    rows: set[int] = set()
    for name in names:
        if name not in base.parameters:
            raise UsageError(f"--for: no parameter {name!r}", hint=did_you_mean(name, base.parameters))
        found = np.flatnonzero(base.transform[:, base.parameters.index(name)])
        if not found.size:
            raise DataError(
                f"--for: {name} has no effect on any torque of this robot: no motion can show it",
                hint="elid classify lists what can be identified",
            )
        rows |= {int(row) for row in found}
    return sorted(rows)


class _Search:
    """Maximises the information over the inner control points of every joint's spline."""

    def __init__(
        self, information: Information, bounds: Bounds, grid: Array, weights: Weights, start: SplineReference
    ) -> None:
        self.information, self.bounds, self.weights, self.start = information, bounds, weights, start
        self.reach = np.minimum(bounds.high - bounds.low, 2 * np.pi)
        self.bases = [[_basis(spline, grid, order) for spline in start.splines] for order in range(3)]
        inner = [len(spline.points) - 2 * ENDS for spline in start.splines]
        self.parts = [slice(sum(inner[:k]), sum(inner[: k + 1])) for k in range(len(inner))]

    def run(self, rounds: int, progress: Callable[[float], None] | None) -> SplineReference:
        """Return the improved motion."""
        from scipy.optimize import minimize

        splines = zip(self.start.splines, self.reach, strict=True)
        x = np.concatenate([spline.points[ENDS:-ENDS] / reach for spline, reach in splines])
        done = 0

        def stepped(_: Array) -> None:
            nonlocal done
            done += 1
            if progress is not None:
                progress(min(done / (rounds * len(PENALTIES)), 1.0))

        watch: Any = stepped
        settings: Any = {"maxiter": rounds, "maxfun": 2 * rounds, "maxcor": 20}
        for penalty in PENALTIES:
            cost: Any = partial(self._cost, penalty)
            x = minimize(cost, x, jac=True, method="L-BFGS-B", callback=watch, options=settings).x
        return self._motion(x)

    def _motion(self, x: Array) -> SplineReference:
        splines = []
        for spline, reach, part in zip(self.start.splines, self.reach, self.parts, strict=True):
            points = spline.points.copy()
            points[ENDS:-ENDS] = x[part] * reach
            splines.append(ReferenceSpline(spline.knots, points))
        return replace(self.start, splines=tuple(splines))

    def _cost(self, penalty: float, x: Array) -> tuple[float, Array]:
        points = [spline.points for spline in self._motion(x).splines]
        q, dq, ddq = (np.stack([b @ c for b, c in zip(basis, points, strict=True)], axis=1) for basis in self.bases)
        states = (q, dq, ddq)
        excess, slopes, by_torque = _excess(states, self.information.torques(states), self.bounds)
        value, gradients = self.information.gain(states, self.weights, -penalty * by_torque)
        slope = np.zeros_like(x)
        for basis, gradient, over in zip(self.bases, gradients, slopes, strict=True):
            by_state = gradient - penalty * over
            for k, part in enumerate(self.parts):
                slope[part] += self.reach[k] * (basis[k].T @ by_state[:, k])[ENDS:-ENDS]
        return penalty * excess - value, -slope


def _basis(spline: ReferenceSpline, grid: Array, order: int) -> Array:
    """Return the matrix (N, control points) that gives a derivative of a spline at the grid."""
    return ReferenceSpline(spline.knots, np.eye(len(spline.points))).evaluate(grid, order)


def _excess(states: States, torque: Array, bounds: Bounds) -> tuple[float, States, Array]:
    """Return the mean squared relative excess over the limits and its derivatives by states and torques."""
    q, dq, ddq = states
    half = 0.5 * ROOM * (bounds.high - bounds.low)
    centre = 0.5 * (bounds.high + bounds.low)
    total = 0.0
    slopes = []
    for value, limit in ((q - centre, half), (dq, ROOM * bounds.velocity), (ddq, ROOM * bounds.acceleration),
                         (torque, ROOM * bounds.torque)):  # fmt: skip
        over = np.maximum(np.abs(value) / limit - 1.0, 0.0)
        total += float(np.sum(over**2))
        slopes.append(2 * over * np.sign(value) / limit)
    return total, (slopes[0], slopes[1], slopes[2]), slopes[3]
