"""Whole robots for drawn base parameters.

Bodies are drawn where they could be built. Where hardly any set's could (a log shows inertias only roughly, and the
estimate of such a sum may be that of no body), they are held at the robot's own, and rotors, friction and springs are
drawn from their distribution given those bodies (generalised least squares), widened by what the bodies do not fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.estimation.refined_robot import representative
from elid_cli.estimation.sampling.draw import draw_sets
from elid_cli.estimation.sampling.pool import Distribution, Origin
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.consistency import MARGIN, consistency
from elid_cli.model.effects.posed import as_posed
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import POSITIVE, StandardParameter
from elid_cli.robot.robot import Robot

LEAST = 0.2
"""Share of the drawn sets that must have bodies that could be built, for bodies to be drawn at all."""
BATCHES = 50
"""Times that as many sets as are wanted are drawn at most."""
SAME = 1e-6
"""Relative difference of coefficients up to which combinations are the same."""
NULL = 1e-12
"""Eigenvalues of correlations below this part of the largest carry no information."""


def as_identified(robot: Robot, found: Distribution) -> tuple[Robot, BaseParameters, NDArray[np.intp]]:
    """Return the robot as the results know it: elastic where they say; their base parameters; their places.

    Raises
    ------
    UsageError
        It has other joints, or lacks a parameter that they estimate.
    """
    if found.joints != robot.joint_names:
        absent = [name for name in robot.joint_names if name not in found.joints]
        detail = f"the result is of {len(found.joints)} joints, the robot has {robot.n}"
        hint = f"--lock {absent[0]}=0" if absent else "give the robot that was identified"
        raise UsageError(f"{robot.name}: its joints are not those of {found.files[0]}", detail=detail, hint=hint)
    used = {name for terms, drawn in zip(found.terms, found.drawn, strict=True) if drawn for name in terms}
    springs = [
        StandardParameter("K", k) in used and joint.transmission == "auto" for k, joint in enumerate(robot.joints)
    ]
    joints = zip(robot.joints, springs, strict=True)
    robot = replace(robot, joints=tuple(replace(j, transmission="elastic") if s else j for j, s in joints))
    names = robot.parameter_names()
    place = {str(name): k for k, name in enumerate(names)}
    if unknown := sorted(used - place.keys()):
        raise UsageError(
            f"{robot.name}: has no parameter {unknown[0]}, which {found.files[0]} estimates",
            detail="its transmissions or gears are not those of the robot that was identified",
            hint="give the robot that was identified",
        )
    rows = np.array([k for k, terms in enumerate(found.terms) if terms.keys() <= place.keys()], dtype=np.intp)
    transform = np.zeros((len(rows), len(names)))
    for row, k in enumerate(rows):
        for name, value in found.terms[k].items():
            transform[row, place[name]] = value
    leaders = np.array([place[next(iter(found.terms[k]))] for k in rows], dtype=np.intp)
    units = tuple(found.units[k] for k in rows)
    return robot, BaseParameters(names, units, leaders, transform, {}, np.nan), rows


def other_combinations(robot: Robot, base: BaseParameters) -> bool:
    """Whether a robot's own base parameters of the same leaders are other combinations."""
    own = find_base(Regressor(as_posed(robot)))
    place = {int(leader): k for k, leader in enumerate(own.leaders)}
    for leader, row in zip(base.leaders.tolist(), base.transform, strict=True):
        if leader in place and not np.allclose(own.transform[place[leader]], row, rtol=SAME, atol=SAME):
            return True
    return False


def whole_sets(
    robot: Robot,
    base: BaseParameters,
    found: Distribution,
    rows: NDArray[np.intp],
    values: Array,
    generator: np.random.Generator,
    *,
    held: bool = False,
) -> tuple[Array, tuple[Origin, ...], list[str]]:
    """Return sets of standard parameters, (N, p), NaN where unknown, where each is from, and what was limited.

    Parameters
    ----------
    robot, base, rows
        As `as_identified` returns them.
    found
        The distribution of the base parameters.
    values
        Base parameters drawn from it, (N, b).
    generator
        Of further draws.
    held
        Whether the results hold the bodies: then they are the robot's own.
    """
    if held:
        why = f"bodies are held at those of {robot.name}, as the results of simulated motion hold them"
        return _with_own_bodies(robot, base, found, rows, len(values), generator, why)
    reference = robot.reference()
    drawn = found.drawn[rows]

    def completed(draws: Array) -> Array:
        return representative(base, np.where(drawn, draws[:, rows], np.nan), reference)

    if not _built(robot, np.nan_to_num(reference)[None])[0]:
        words = [f"drawn bodies need not be ones that could be built, as those of {robot.name} are not either"]
        return *_marked(robot, base, completed(values), drawn), words
    sets = completed(values)
    good = _built(robot, sets)
    if good.mean() < LEAST:
        why = (
            f"too few drawn bodies could be built: bodies are held at those of {robot.name}, and friction, rotors "
            "and springs are drawn given these (elid identify --physical --write-robot gives bodies that agree with "
            "the log)"
        )
        return _with_own_bodies(robot, base, found, rows, len(values), generator, why)
    kept, count = sets[good], len(values)
    for _ in range(BATCHES):
        if len(kept) >= count:
            break
        more = completed(draw_sets(found.mean, found.covariance, found.positive, count, generator))
        kept = np.concatenate([kept, more[_built(robot, more)]])
    words = [] if good.all() else [f"{100 * good.mean():.3g} % of the drawn sets could be built: only those are kept"]
    return *_marked(robot, base, kept[:count], drawn), words


def _built(robot: Robot, sets: Array) -> NDArray[np.bool_]:
    """Return which sets, (N, p), are of robots that could be built, (N,); friction and rotors may be 0."""
    cones = consistency(robot, np.nan_to_num(robot.reference()))
    scalars = [name.kind in POSITIVE for name in robot.parameter_names()]
    scaled = sets / cones.scales.sizes
    bodies = np.linalg.eigvalsh(np.einsum("iabp,np->niab", cones.links, scaled, optimize=True))[..., 0]
    return np.asarray((bodies >= MARGIN).all(axis=1) & (scaled[:, scalars] >= 0).all(axis=1), dtype=bool)


def _marked(
    robot: Robot, base: BaseParameters, sets: Array, drawn: NDArray[np.bool_]
) -> tuple[Array, tuple[Origin, ...]]:
    """Return sets with the reference where nothing is drawn, and where each parameter is from."""
    reference, used = robot.reference(), base.transform != 0
    single = used.sum(axis=1) == 1
    alone = used[single].any(axis=0) & ~used[~single].any(axis=0)
    moved = used[drawn].any(axis=0)
    known = np.isfinite(reference)
    origin: list[Origin] = [
        ("drawn" if alone[k] else "split") if moved[k] else "held" if known[k] else "unknown" for k in range(len(alone))
    ]
    return np.where(moved, sets, reference), tuple(origin)


def _with_own_bodies(
    robot: Robot,
    base: BaseParameters,
    found: Distribution,
    rows: NDArray[np.intp],
    count: int,
    generator: np.random.Generator,
    why: str,
) -> tuple[Array, tuple[Origin, ...], list[str]]:
    """Return sets with the robot's own bodies and what is left drawn given them; with `why`, in words."""
    reference = robot.reference()
    drawn = found.drawn[rows] & (np.diag(found.covariance)[rows] > 0)  # what is without error is of the bodies alone
    known = rows[drawn]
    transform = base.transform[drawn]
    scalar = np.array([name.kind in POSITIVE for name in robot.parameter_names()])
    free = np.flatnonzero(scalar & (transform != 0).any(axis=0))
    rest = found.mean[known] - transform[:, ~scalar] @ np.nan_to_num(reference[~scalar])
    mean, covariance, misfit = _given(transform[:, free], rest, found.covariance[np.ix_(known, known)])
    sets = np.tile(reference, (count, 1))
    sets[:, free] = draw_sets(mean, covariance, np.ones(len(free), dtype=bool), count, generator)
    said = [why]
    if misfit > 1:
        said.append(
            f"the estimates are {misfit:.2g} times as far from these bodies as their errors allow: sets widened by that"
        )
    drawn_now = np.isin(np.arange(len(reference)), free)
    origin: list[Origin] = [
        "drawn" if now else "held" if np.isfinite(value) else "unknown"
        for now, value in zip(drawn_now, reference, strict=True)
    ]
    return sets, tuple(origin), said


def _given(columns: Array, values: Array, covariance: Array) -> tuple[Array, Array, float]:
    """Return x with values = columns @ x by generalised least squares, its covariance, and the misfit in deviations.

    The covariance is widened by a misfit above 1 (Birge 1932, Physical Review 40).
    """
    deviation = np.sqrt(np.diag(covariance))
    size, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    kept = size > NULL * size[-1]
    whiten = vectors[:, kept].T / np.sqrt(size[kept])[:, None] / deviation
    left, singular, right = np.linalg.svd(whiten @ columns, full_matrices=False)
    inverse = right.T / singular
    target = whiten @ values
    mean = inverse @ (left.T @ target)
    freedom = max(len(target) - len(mean), 1)
    misfit = float(np.linalg.norm(target - whiten @ columns @ mean) / np.sqrt(freedom))
    return mean, inverse @ inverse.T * max(misfit, 1.0) ** 2, misfit
