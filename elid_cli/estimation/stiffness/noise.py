"""Stiffness and noise in the deflection: errors in variables, which standard errors do not see.

The deflection q - theta is a small difference of two measured positions. What remains of it after the other columns
of the motor row are taken off decides K; where that is not well above the encoders' noise in it, the estimate is
pulled towards 0 however small its standard error looks. A clock skew between the encoders adds a multiple of the
velocity, which viscous friction takes off along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.judgement import ColumnNoise
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.triangles import Triangle, Triangles
from elid_cli.model.regressor import EstimationRow, Kind, Regressor
from elid_cli.robot.parameter import StandardParameter

_ROWS: tuple[Kind, ...] = ("motor", "spring")
LARGEST_SHARE = 0.2
"""Share of the deciding deflection's energy that noise may have: K is then pulled by as much."""
FELT = 0.1
"""Part of a rotor's torque in the sum rows from which these tell it from its link's."""
SEEN = 1e-6
"""Part of a column that other rows than the motor's must hold for them to say anything of it."""
COLLAPSED = 0.5
"""Share from which so little is left of K in the fit that what the spring passes on falls to the rotor."""


def stiffness_in_noise(model: Regressor, triangles: Triangles, solution: Solution, noise: Array) -> dict[str, str]:
    """Return stiffness parameters that deflections with this noise cannot support, with the reason.

    Parameters
    ----------
    model, triangles, solution
        The robot, the reduced logs, and what was solved for.
    noise
        Standard deviation of encoder noise in the filtered deflection, rad (m), (n,).
    """
    refused: dict[str, str] = {}
    for k, share in shares_of_noise(model, triangles, solution, noise).items():
        joint = model.robot.joints[k]
        if share > LARGEST_SHARE:
            reason = f"{min(share, 1.0):.0%} of the deflection that would tell it is encoder noise in {joint.name}"
            refused[StandardParameter("K", k)] = reason
        if share > COLLAPSED:
            why = f"{reason}: without K the motor equation takes the link's inertia for the rotor's"
            refused[model.robot.rotor_names[k]] = why
    return refused


def shares_of_noise(model: Regressor, triangles: Triangles, solution: Solution, noise: Array) -> dict[int, float]:
    """Return the noise's share of the energy of the deflection that decides a stiffness, by elastic joint."""
    joints = [k for k, joint in enumerate(model.robot.joints) if joint.elastic]
    left = {k: deciding_deflection(model, triangles, solution, k) for k in joints}
    return {k: float(noise[k] ** 2 / max(value, 1e-300)) for k, value in left.items() if value is not None}


def floor_of_pulled(share: float, floor: float, left: float) -> float:
    """Return what noise leaves of the motor's row whose stiffness it pulls towards 0, N·m (N).

    With a share s of noise a stiffness comes out as (1 - s) K, so that noise and what the spring passes on and the fit
    does not know leave K² s (1 - s) of the deflection's mean square: 1 / (1 - s) times what noise alone makes with the
    stiffness as it came out. Where that has collapsed, all that is left may be the spring's torque.

    Parameters
    ----------
    share
        Of noise in the deflection that decides the stiffness.
    floor, left
        What noise alone makes with the stiffness as it came out, and what is left of the row, N·m (N).
    """
    return max(floor, left) if share > COLLAPSED else floor / math.sqrt(1.0 - share)


def with_pull(model: Regressor, triangles: Triangles, solution: Solution, covariance: Array, noise: Array) -> Array:
    """Return the covariance of the basis, (r, r), with what noise in the deflections pulls the stiffnesses by.

    A stiffness comes out smaller by the noise's share in the deciding deflection (errors in variables: attenuation),
    and what its column is correlated with moves along. The share is known roughly only (smoothing takes some of the
    noise away, and how much depends on its colour): anything from nothing to all of it, so that the errors are widened
    by the standard deviation of a uniform distribution instead of correcting the values. More logs do not make it
    smaller. Where the noise is most of that deflection, a share of what is left of the stiffness says nothing of how
    far it was pulled: see `taken_over`.

    Parameters
    ----------
    model, triangles, solution, covariance
        The robot, the reduced logs, what was solved for and its covariance.
    noise
        Standard deviation of encoder noise in the filtered deflection, rad (m), (n,).
    """
    wider = covariance.copy()
    for k, joint in enumerate(model.robot.joints):
        if not joint.elastic:
            continue
        place = np.flatnonzero(solution.basis == model.index[StandardParameter("K", k)])
        left = deciding_deflection(model, triangles, solution, k) if len(place) else None
        if left is None or not left > 0 or not np.isfinite(noise[k]):
            continue
        own = int(place[0])
        if not covariance[own, own] > 0:
            continue
        value = float(solution.values[solution.basis[own]])
        moved = covariance[:, own] / covariance[own, own] * pull(value, float(noise[k]), left)
        wider += np.outer(moved, moved)
    return wider


def pull(value: float, noise: float, left: float) -> float:
    """Return by how much noise in the deflection pulls a stiffness, a standard deviation, N·m/rad (N/m).

    Parameters
    ----------
    value
        The stiffness.
    noise
        Standard deviation of encoder noise in the filtered deflection, rad (m).
    left
        Mean square of the deflection that the other columns leave, rad² (m²).
    """
    return min(noise**2 / left, 1.0) * value / math.sqrt(3.0) if left > 0 else value


def taken_over(
    model: Regressor, triangles: Triangles, solution: Solution, noise: Array, columns: Sequence[ColumnNoise] = ()
) -> Array:
    """Return what lost stiffnesses may have moved the basis by, as standard deviations, (r, joints with one).

    Where noise is most of the deflection that decides a stiffness, the rotor has taken anything from nothing to all of
    its inertia from the link. Where the sum rows tell the two apart, the values lie between what these say and what the
    motor's row does, which lacks what the spring passes on.

    Parameters
    ----------
    model, triangles, solution
        The robot, the reduced logs and what was solved for.
    noise
        Standard deviation of encoder noise in the filtered deflection, rad (m), (n,).
    columns
        What noise is in the columns.
    """
    lost = []
    for k, joint in enumerate(model.robot.joints):
        left = deciding_deflection(model, triangles, solution, k) if joint.elastic else None
        if left is not None and noise[k] ** 2 > COLLAPSED * left:
            taken = _taken_by_rotor(model, triangles, solution, k, columns)
            lost.append(_moved_by_motor(triangles, solution, k) if taken is None else taken / math.sqrt(3.0))
    return np.array(lost).T.reshape(len(solution.basis), -1)


def _moved_by_motor(triangles: Triangles, solution: Solution, joint: int) -> Array:
    """Return what the basis (r,) changes by without the motor's row of a joint, whose stiffness is lost."""
    basis, change = solution.basis, np.zeros(len(solution.basis))
    others = {row: weight for row, weight in solution.weights.items() if row != EstimationRow("motor", joint)}
    system = triangles.stacked(others)
    matrix = system[:, basis]
    size = np.linalg.norm(matrix, axis=0)
    seen = size > SEEN * np.linalg.norm(triangles.stacked(solution.weights)[:, basis], axis=0)
    left = system[:, -1] - matrix @ solution.values[basis]
    change[seen] = np.linalg.lstsq(matrix[:, seen] / size[seen], left, rcond=1e-10)[0] / size[seen]
    return change


def _taken_by_rotor(
    model: Regressor, triangles: Triangles, solution: Solution, joint: int, columns: Sequence[ColumnNoise]
) -> Array | None:
    """Return what the basis (r,) changes by if all of a rotor's inertia is the link's; None where the sums tell.

    The sum rows hold both, whatever the stiffness; where they feel a difference that is no noise, they tell the two
    apart.
    """
    basis = solution.basis
    rotor = np.flatnonzero(basis == model.index[model.robot.rotor_names[joint]])
    if not len(rotor):
        return np.zeros(len(basis))
    place = {int(column): k for k, column in enumerate(basis)}
    stiffnesses = [k for k, column in enumerate(basis) if column < model.parameters and model.names[column].kind == "K"]
    sums = {row: weight for row, weight in solution.weights.items() if row.kind == "sum"}
    matrix = triangles.stacked(sums)[:, basis]
    matrix[:, stiffnesses] = 0.0
    column = matrix[:, rotor[0]].copy()
    matrix[:, rotor[0]] = 0.0
    size = np.linalg.norm(matrix, axis=0)
    scale = np.where(size > 0, size, 1.0)
    change = -np.linalg.lstsq(matrix / scale, column, rcond=1e-10)[0] / scale
    felt, noisy = float(np.sum((column + matrix @ change) ** 2)), 0.0
    change[rotor[0]] = 1.0
    for item in columns:
        known = [k for k, number in enumerate(item.index) if int(number) in place]
        if item.row.kind == "sum" and known:
            moved = change[[place[int(item.index[k])] for k in known]]
            count = sum(triangle.count for triangle in triangles.of(item.row))
            weight = solution.weights.get(item.row, 0.0) ** 2 * count
            noisy += weight * float(moved @ item.gram[np.ix_(known, known)] @ moved)
    # what noise makes of it is known to a factor of two
    if felt - 2.0 * noisy > (FELT * float(np.linalg.norm(column))) ** 2:
        return None
    return -change * float(solution.values[basis[rotor[0]]])


def deciding_deflection(model: Regressor, triangles: Triangles, solution: Solution, joint: int) -> float | None:
    """Return the mean square of the deflection that the other columns of its row leave, rad² (m²).

    Where a joint torque sensor gives it a second row, the one in which more is left decides. Where an effect has a
    column in the row, what the other rows say of that counts as well: a gain of the torque looks like the stiffness
    there, and is told by other joints' torques.
    """
    left = []
    for row in (EstimationRow(kind, joint) for kind in _ROWS):
        chosen = triangles.of(row)
        if chosen:
            left += [_left(model, chosen, solution.basis, joint), _left_by_all(model, chosen, solution, row)]
    return max((value for value in left if value is not None), default=None)


def _left_by_all(model: Regressor, chosen: list[Triangle], solution: Solution, row: EstimationRow) -> float | None:
    """Return what all rows together leave of the deflection where an effect has a column in its row; else None."""
    own = np.flatnonzero(solution.basis == model.index[StandardParameter("K", row.joint)])
    weight = solution.weights.get(row, 0.0)
    if not len(own) or not weight or not np.any(chosen[0].index >= model.parameters):
        return None
    variance = float(np.sum(solution.inverse[own[0]] ** 2))
    return 1.0 / (variance * weight**2 * sum(t.count for t in chosen))


def _left(model: Regressor, chosen: list[Triangle], basis: NDArray[np.intp], joint: int) -> float | None:
    index = chosen[0].index
    own = model.index[StandardParameter("K", joint)]
    place = np.flatnonzero(index == own)
    if not len(place):
        return None
    factor = np.concatenate([t.factor for t in chosen])
    solved = set(basis.tolist())
    others = [k for k, column in enumerate(index) if column != own and int(column) in solved]
    rest = factor[:, place[0]]
    if others:
        matrix = factor[:, others]
        size = np.linalg.norm(matrix, axis=0)
        matrix = matrix[:, size > 0] / size[size > 0]
        rest = rest - matrix @ np.linalg.lstsq(matrix, rest, rcond=1e-10)[0]
    return float(rest @ rest) / sum(t.count for t in chosen)
