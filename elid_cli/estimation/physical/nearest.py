"""A full standard parameter set that a real robot could have, nearest to what the data say (``--physical``).

Minimises the weighted residual of the data plus a pull towards the reference values, over the cones of
`consistency`. The pull decides only what the data leave open: its standard deviation is a parameter's typical size,
and it is weakened where it would cost prediction. What the constraint costs in prediction is measured on held-out
stretches, by fitting each of them anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError, UsageError, check_kind
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.physical.semidefinite import nearest_physical, need_solver
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.cross_validation import all_others, joint_errors, left_out
from elid_cli.model.consistency import Consistency, consistency, prior
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import Robot
from elid_cli.robot.urdf.write import with_parameters
from elid_cli.tables import Shown

Origin = Literal["data", "split", "reference", "assumed"]

PULLS = ((2.0, 20.0), (2.0, 2.0), (0.6, 0.6), (0.2, 0.2))
"""Pulls tried, strongest first, in standard deviations per typical size from the reference value: for parameters
that the log shows and for those that it does not. Two, because correlated residuals make standard deviations two to
three times larger than this weighting believes."""
UNKNOWN = 0.1
"""Share of the pull, towards a typical body, where the robot file has no reference value."""
AFFORDABLE = 0.001
"""Relative rise of the residual's square that a pull may cost beyond that of the weakest."""
ROUNDING = 1e-9
"""Values below this share of their typical size are the solver's rounding and count as zero."""
MOVED = 2.0
"""Standard deviations by which a base parameter must move to be named."""
TRUST = (1.0, 0.8, 0.6, 0.4)
"""Weights tried for the motor rows of joints whose stiffness the log refused. Their spring torque is encoder noise,
which pulls the fit where no physical robot is; what predicts left-out stretches best decides how far they count."""
CONTRADICTION = 0.02
"""Relative rise of the held-out error above which data and a physical robot contradict each other."""


@dataclass(frozen=True)
class Impossible:
    """A base estimate that no physical robot has: it must be positive and is not."""

    name: str
    estimate: float
    std_error: float
    value: float
    """What it became."""


@dataclass(frozen=True, repr=False)
class PhysicalParameters(Shown):
    """Standard parameters of a robot that could be built, and what they cost."""

    robot: Robot
    values: Array
    """Standard parameters in standard order, (p,), in the units of `robot.parameter_units`."""
    origin: tuple[Origin, ...]
    """What decided each: the data; the data up to a split among a combination's members; the reference value; or
    an assumption, where neither says anything."""
    base: Array
    """Its base parameters, (b,), SI."""
    moved: Array
    """How far each base parameter moved from its estimate, in standard deviations, (b,); NaN where refused."""
    impossible: tuple[Impossible, ...]
    chi2_before: float
    """Weighted mean square of the residual of the unconstrained fit."""
    chi2_after: float
    error_before: Mapping[str, JointError]
    error_after: Mapping[str, JointError]
    """Held-out errors with the constraint, each stretch predicted by a constrained fit to the others."""
    margin: float
    """Smallest eigenvalue of a link's scaled pseudo-inertia."""

    def refined_robot(self) -> Robot:
        """Return the robot with these parameters as its reference values."""
        return with_parameters(self.robot, self.values)

    @property
    def rises(self) -> dict[str, float]:
        """Relative rise of every joint's held-out error, as a fraction; a fall is negative."""
        return {j: self.error_after[j].rms / e.rms - 1 for j, e in self.error_before.items() if j in self.error_after}

    @property
    def loss(self) -> float:
        """Relative rise of the held-out error of all joints together, each weighed by its own; NaN without any."""
        squares = [(1 + rise) ** 2 for rise in self.rises.values()]
        return float(np.sqrt(np.mean(squares))) - 1 if squares else float("nan")

    @property
    def contradiction(self) -> bool:
        """Whether the data contradict a physical robot: a sign, a gain or gravity may be wrong."""
        return self.loss > CONTRADICTION

    def moved_far(self, names: Sequence[str]) -> tuple[tuple[str, float], ...]:
        """Return (name, standard deviations) of base parameters that moved by more than `MOVED`, farthest first."""
        far = [(names[k], float(z)) for k, z in enumerate(self.moved) if abs(z) > MOVED]
        return tuple(sorted(far, key=lambda item: -abs(item[1])))


def make_physical(found: Identification) -> PhysicalParameters:
    """Return the physical parameters nearest to an identification.

    Raises
    ------
    UsageError
        The solver is not installed (extra ``physical``), or the bodies of a fit of the motion, which are the file's;
        what is no identification.
    DataError
        The solver found no answer.

    """
    check_kind("found", found, Identification, "identify(robot, signals) returns one")
    need_solver()
    if found.drives:
        raise UsageError(
            "a physically consistent set is found from the torque; this is a fit of the motion with the file's bodies",
            hint="--fit torque, in Python EstimateOptions(fit='torque')",
        )
    robot, base = found.robot, found.base
    cones = consistency(robot, _typical(found))
    system = _system(found)
    solution, error_after = _best(found, cones)
    p = len(base.parameters)
    sizes = cones.scales.sizes
    values = np.where(np.abs(solution[:p]) < ROUNDING * sizes, 0.0, solution[:p])
    springs = _unseen_springs(found)
    values[springs] = robot.reference()[springs]
    physical = base.transform @ values
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = (physical - found.estimate) / found.std_error
    count = _equations(found)
    least = np.linalg.lstsq(_scaled(system), system[:, -1], rcond=1e-10)[0] / _norms(system)
    return PhysicalParameters(
        robot=robot,
        values=values,
        origin=_origins(found),
        base=physical,
        moved=moved,
        impossible=_impossible(found, cones, physical),
        chi2_before=_squares(system, least) / count,
        chi2_after=_squares(system, solution) / count,
        error_before=found.error,
        error_after=error_after,
        margin=float(cones.eigenvalues(values / sizes).min()),
    )


@dataclass(frozen=True)
class _Fit:
    """A constrained fit: the cones, the values that it is pulled to (scaled) and how strongly."""

    cones: Consistency
    target: Array
    pull: Array

    def solve(self, system: Array) -> Array:
        """Return standard parameters and extra coefficients, (p + e,), for a weighted system [R | z]."""
        from scipy.linalg import solve_triangular

        p = len(self.target)
        extra = system.shape[1] - 1 - p
        norms = _norms(system)[p:]
        sizes = np.concatenate([self.cones.scales.sizes, 1.0 / np.where(norms > 0, norms, 1.0)])
        pull = np.concatenate([self.pull, np.full(extra, 1e-6)])
        target = np.concatenate([self.target, np.zeros(extra)])
        stacked = np.concatenate(
            [
                np.column_stack([system[:, :-1] * sizes, system[:, -1]]),
                np.column_stack([np.diag(pull), pull * target]),
            ]
        )
        width = p + extra
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
        metric = factor[:width, :width]
        centre = solve_triangular(metric, factor[:width, width])
        return np.asarray(nearest_physical(self.cones, metric, centre) * sizes)


def _best(found: Identification, cones: Consistency) -> tuple[Array, dict[str, JointError]]:
    """Return the solution whose worst row gives up least on left-out stretches, and its errors there."""
    triangles = found.triangles
    if triangles is None:
        return _pulled(found, cones, _system(found))[1], {}
    refused = {int(found.base.parameters[k][1:]) - 1 for k in _refused_springs(found)}
    answers = []
    for trust in TRUST if refused else TRUST[:1]:
        weights = {
            row: weight * (trust if row.kind == "motor" and row.joint in refused else 1.0)
            for row, weight in found.weights.items()
        }
        fit, solution = _pulled(found, cones, triangles.stacked(weights))
        errors = _held_out(found.robot, fit, triangles, weights)
        answers.append((_worst(found.error, errors), solution, errors))
    return min(answers, key=lambda answer: answer[0])[1:]


def _worst(before: Mapping[str, JointError], after: Mapping[str, JointError]) -> float:
    """Return the largest relative rise of any joint's held-out error, motor rows included."""
    pairs = [(after[j].rms, e.rms) for j, e in before.items() if j in after]
    pairs += [(after[j].spring_rms or 0.0, e.spring_rms) for j, e in before.items() if j in after and e.spring_rms]
    return max((new / old - 1 for new, old in pairs), default=0.0)


def _pulled(found: Identification, cones: Consistency, system: Array) -> tuple[_Fit, Array]:
    """Return the fit with the strongest pull that the data can afford, and its solution."""
    target = prior(found.robot, cones.scales) / cones.scales.sizes
    share = np.where(np.isnan(found.robot.reference()), UNKNOWN, 1.0)
    unseen = np.array([found.this_log.get(name) == "not excited" for name in found.base.parameters])
    fits = [_Fit(cones, target, share * np.where(unseen, strong, pull)) for pull, strong in PULLS]
    weakest = fits[-1].solve(system)
    limit = (1 + AFFORDABLE) * _squares(system, weakest)
    for fit in fits[:-1]:
        solution = fit.solve(system)
        if _squares(system, solution) <= limit:
            return fit, solution
    return fits[-1], weakest


def _system(found: Identification) -> Array:
    """Return the weighted data [R | z] over standard parameters and extras; from the covariance where none is kept."""
    if found.triangles is not None:
        return found.triangles.stacked(found.weights)
    known = np.isfinite(found.estimate)
    if not known.any():
        raise DataError("nothing was identified that could be made physical")
    covariance = found.covariance[np.ix_(known, known)]
    values, vectors = np.linalg.eigh(covariance / np.outer(found.std_error[known], found.std_error[known]))
    root = (vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))).T / found.std_error[known]
    return np.column_stack([root @ found.base.transform[known], root @ found.estimate[known]])


def _refused_springs(found: Identification) -> list[int]:
    """Return the places of stiffnesses that the log refused."""
    return [
        int(leader)
        for leader, verdict in zip(found.base.leaders, found.verdict, strict=True)
        if verdict == "refused" and found.base.parameters[leader].kind == "K"
    ]


def _unseen_springs(found: Identification) -> list[int]:
    """Return stiffnesses that the log refused and the robot file gives.

    In the fit they stay free: their deflection is mostly noise, which the motor row explains best with a K near 0,
    but held at its true K the same noise would spoil what else that row knows.
    """
    reference = found.robot.reference()
    return [k for k in _refused_springs(found) if reference[k] > 0]


def _equations(found: Identification) -> int:
    if found.triangles is None:
        return found.base.count
    return sum(t.count for t in found.triangles.items if found.weights.get(t.row, 0.0) > 0)


def _held_out(
    robot: Robot, fit: _Fit, triangles: Triangles, weights: Mapping[EstimationRow, float]
) -> dict[str, JointError]:
    fits = (fit.solve(triangles.stacked(weights, others)) for others in all_others(triangles.folds))
    return joint_errors(robot, triangles, left_out(triangles, fits))


def _typical(found: Identification) -> Array:
    """Return estimates of parameters that stand alone in the base, (p,); NaN elsewhere."""
    values = np.full(len(found.base.parameters), np.nan)
    for k, leader in enumerate(found.base.leaders):
        if found.base.classes[found.base.parameters[leader]] == "independent":
            values[leader] = found.estimate[k]
    return values


def _origins(found: Identification) -> tuple[Origin, ...]:
    reference = found.robot.reference()
    origins: list[Origin] = []
    for k, name in enumerate(found.base.parameters):
        seen = found.this_log.get(name, found.base.classes[name])
        if found.base.classes[name] == "independent" and seen in ("independent", "weak"):
            origins.append("data")
        elif found.base.classes[name] == "combined" and seen in ("combined", "weak"):
            origins.append("split")
        else:
            origins.append("assumed" if np.isnan(reference[k]) else "reference")
    return tuple(origins)


def _impossible(found: Identification, cones: Consistency, physical: Array) -> tuple[Impossible, ...]:
    return tuple(
        Impossible(found.base.names[k], float(found.estimate[k]), float(found.std_error[k]), float(physical[k]))
        for k in range(found.base.count)
        if found.estimate[k] < 0 and cones.positive_only(found.base.transform[k])
    )


def _norms(system: Array) -> Array:
    norms = np.linalg.norm(system[:, :-1], axis=0)
    return np.where(norms > 0, norms, 1.0)


def _scaled(system: Array) -> Array:
    return np.asarray(system[:, :-1] / _norms(system))


def _squares(system: Array, values: Array) -> float:
    residual = system[:, :-1] @ values - system[:, -1]
    return float(residual @ residual)
