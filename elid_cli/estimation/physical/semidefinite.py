"""The nearest point of the cones of a physical robot: a small semidefinite programme, solved by Clarabel."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError, UsageError
from elid_cli.model.consistency import MARGIN, Consistency

_UPPER = tuple((r, c) for c in range(4) for r in range(c + 1))
_UNITS = (1.0, 1e2, 1e4)
"""Units of v tried: data that contradict a physical robot are many standard deviations away from one."""
_LIFT = 2.0
"""The solver is asked for this multiple of the margin, so that its rounding still leaves the margin."""


def need_solver() -> None:
    """Refuse early where the solver is not installed (UsageError)."""
    try:
        import clarabel  # noqa: F401
    except ModuleNotFoundError:
        raise UsageError(
            "--physical: the solver clarabel is not installed", hint="pip install 'elid[physical]'"
        ) from None


def nearest_physical(cones: Consistency, factor: Array, centre: Array) -> Array:
    """Return the y that minimises ``|factor (y - centre)|²`` over the cones.

    Parameters
    ----------
    cones
        Over the first p entries of y; further entries are free.
    factor
        Upper triangle of full rank, (w, w), w >= p: the metric.
    centre
        The unconstrained optimum, (w,).

    Raises
    ------
    DataError
        The solver found no answer (numbers out of any proportion).

    """
    p = len(cones.scales.sizes)
    if cones.slack(centre[:p]) >= 0:
        return centre
    import clarabel
    from scipy.linalg import solve_triangular
    from scipy.sparse import csc_matrix, identity

    # in v = factor (y - centre) the objective is |v|², as well conditioned as can be
    back = solve_triangular(factor, np.eye(factor.shape[0]))
    rows, offsets, kinds = _constraints(cones)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    for unit in _UNITS:
        problem = clarabel.DefaultSolver(
            csc_matrix(identity(factor.shape[0])),
            np.zeros(factor.shape[0]),
            csc_matrix(-rows @ back[:p]),
            (rows @ centre[:p] - offsets) / unit,
            [getattr(clarabel, name)(size) for name, size in kinds],
            settings,
        )
        solution = problem.solve()
        if str(solution.status) in ("Solved", "AlmostSolved"):
            return _inside(cones, centre + unit * (back @ np.array(solution.x)), p)
    raise DataError(
        f"{cones.robot.name}: no physical parameters found ({solution.status})",
        hint="check the units of the log and the robot file's reference values",
    )


def _constraints(cones: Consistency) -> tuple[Array, Array, list[tuple[str, int]]]:
    """Return (rows, offsets, cones): rows @ y - offsets lies in the cones, in Clarabel's order of a triangle."""
    p = len(cones.scales.sizes)
    scalars = np.concatenate([cones.positive, cones.nonnegative])
    rows = [np.eye(p)[scalars]]
    offsets = [np.concatenate([np.full(len(cones.positive), _LIFT * MARGIN), np.zeros(len(cones.nonnegative))])]
    kinds = [("NonnegativeConeT", len(scalars))]
    for link in cones.links:
        rows.append(np.array([link[r, c] * (1.0 if r == c else np.sqrt(2)) for r, c in _UPPER]))
        offsets.append(np.array([_LIFT * MARGIN if r == c else 0.0 for r, c in _UPPER]))
        kinds.append(("PSDTriangleConeT", 4))
    return np.concatenate(rows), np.concatenate(offsets), kinds


def _inside(cones: Consistency, found: Array, p: int) -> Array:
    """Return the solver's answer, moved into the cones by the little that its rounding may lack."""
    interior = cones.interior(found[:p])
    for share in (0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
        inside = found.copy()
        inside[:p] = (1 - share) * found[:p] + share * interior
        if cones.slack(inside[:p]) >= 0:
            return inside
    raise DataError(f"{cones.robot.name}: no physical parameters found", hint="check the units of the log")
