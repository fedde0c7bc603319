"""Base parameters and the class of every standard parameter (paper, section 5, eqs. 39-41).

Structural answers come from random states in which links and motors move freely: the dependencies between columns
are algebraic identities of the rows, so neither noise nor a particular log can change them. The base is made of
the leftmost independent columns in standard order; every other column that is not zero is a combination of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import RobotError, check_kind
from elid_cli.memory import Recent
from elid_cli.model.regressor import BASE_TERMS, Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.motion import random_motion
from elid_cli.tables import Shown

Class = Literal["independent", "combined", "unidentifiable"]

STRUCTURAL_TOLERANCES = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
"""A column is dependent when its distance from the span of those before it is below this part of its norm.

Leading columns may be nearly parallel (masses of a finger's links, seen from the torso), which amplifies rounding: the
first tolerance is taken that finds the rank that singular values tell, whose gap is wide.
"""
STRUCTURAL_RANK = 1e-11
"""Singular values below this part of the largest are zero."""
ZERO_COEFFICIENT = 1e-8
"""Coefficients of a combination below this part of the largest possible are rounding and dropped."""
ROUNDING = 1e-12
"""A sum below this part of its terms is zero but for rounding."""
_STATES = 60
"""Random states per structural question beyond one per parameter, up to 100 parameters …"""
_FEWEST, _SHARED = 40, 12_000
"""… and, with more, the fewest states, and how many parameters times further states there are: a state adds as many
equations as there are rows, so that a large robot has four or more for each parameter in fewer states."""


@dataclass(frozen=True, repr=False)
class BaseParameters(Shown):
    """Base parameters of a robot: which combinations of standard parameters the equations determine."""

    parameters: tuple[StandardParameter, ...]
    """Standard parameters in standard order, (p,)."""
    units: tuple[str, ...]
    """Units of the base parameters, (b,)."""
    leaders: NDArray[np.intp]
    """Positions of the leftmost independent columns, (b,)."""
    transform: Array
    """Base parameters = transform @ standard parameters, (b, p), SI; identity in the leaders' columns (eq. 41)."""
    classes: Mapping[str, Class]
    """Structural class of every standard parameter."""
    margin: float
    """Rank margin: smallest distance of a kept column over the largest of a dropped one."""

    @property
    def count(self) -> int:
        """Number of base parameters b."""
        return len(self.leaders)

    @cached_property
    def terms(self) -> tuple[dict[str, float], ...]:
        """Return each base parameter as standard parameter -> coefficient, in standard order."""
        return tuple({self.parameters[k]: tidy(float(row[k])) for k in np.flatnonzero(row)} for row in self.transform)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return each base parameter as text: ``m1 - 4*Izz1 + 4*Izz2`` (docs/reference/formats.md)."""
        return tuple(combination(terms) for terms in self.terms)

    @property
    def counts(self) -> dict[str, int]:
        """Return how many parameters there are and of which class."""
        kinds = list(self.classes.values())
        return {
            "parameters": len(self.parameters),
            "base": self.count,
            "independent": kinds.count("independent"),
            "combined": kinds.count("combined"),
            "unidentifiable": kinds.count("unidentifiable"),
        }

    def values(self, standard: Array) -> Array:
        """Return the base parameters of standard parameters (p,); NaN where a needed one is unknown."""
        used = self.transform != 0
        terms = [row[u] * standard[u] for row, u in zip(self.transform, used, strict=True)]
        # a sum whose terms cancel is zero, not the 1e-16 that rounding leaves: relative errors divide by it
        return np.array([0.0 if abs(term.sum()) < ROUNDING * np.abs(term).sum() else term.sum() for term in terms])


def tidy(value: float) -> float:
    """Return a coefficient as the simple fraction it equals to 1e-9, else as it is."""
    near = Fraction(value).limit_denominator(64)
    return float(near) if abs(float(near) - value) < 1e-9 * max(1.0, abs(value)) else value


def coefficient_text(value: float) -> str:
    """Return a positive coefficient with 6 significant digits, without an exponent where that is short."""
    text = f"{value:.6g}"
    if "e" not in text:
        return text
    plain = np.format_float_positional(float(text), trim="-")
    return plain if len(plain) <= 12 else text


def combination(terms: Mapping[str, float]) -> str:
    """Return ``m1 - 4*Izz1``: terms in the given order, a coefficient of 1 omitted."""
    parts: list[str] = []
    for name, value in terms.items():
        digits = coefficient_text(abs(value))
        piece = name if digits == "1" else f"{digits}*{name}"
        if not parts:
            parts.append(piece if value > 0 else f"-{piece}")
        else:
            parts.append(f"{'+' if value > 0 else '-'} {piece}")
    return " ".join(parts)


@dataclass(frozen=True)
class Dependencies:
    """Leftmost independent columns and how the others follow from them."""

    leaders: NDArray[np.intp]
    followers: NDArray[np.intp]
    null: NDArray[np.intp]
    coefficients: Array
    """Followers = leaders @ coefficients, (leaders, followers)."""
    margin: float


def leftmost(columns: Array, tolerance: float, *, null: float | None = None) -> Dependencies:
    """Split columns into the leftmost independent ones, those that follow from them, and zero columns.

    Ordered Gram-Schmidt with two passes on unit columns; no pivoting, so the order of the columns decides.

    Parameters
    ----------
    columns
        Shape (rows, p); the R factor of a regressor serves as well as the regressor.
    tolerance
        Relative distance below which a column is dependent.
    null
        Norm below which a column is zero, relative to the largest (default: `tolerance`).
    """
    norms = np.linalg.norm(columns, axis=0)
    largest = float(norms.max()) if norms.size else 0.0
    zero = norms <= (tolerance if null is None else null) * largest
    unit = columns / np.where(zero, 1.0, norms)
    basis = np.empty((len(norms), columns.shape[0]))  # in rows
    leaders: list[int] = []
    followers: list[int] = []
    kept, dropped = np.inf, 0.0
    for k in range(columns.shape[1]):
        if zero[k]:
            continue
        rest = unit[:, k]
        for _ in range(2):
            known = basis[: len(leaders)]
            rest = rest - (known @ rest) @ known
        distance = float(np.linalg.norm(rest))
        if distance > tolerance:
            basis[len(leaders)] = rest / distance
            leaders.append(k)
            kept = min(kept, distance)
        else:
            followers.append(k)
            dropped = max(dropped, distance)
    solution: Array = np.zeros((len(leaders), len(followers)))
    if leaders and followers:
        known = basis[: len(leaders)]  # on which the leaders are a triangle
        solution[:] = np.linalg.solve(np.triu(known @ unit[:, leaders]), known @ unit[:, followers])
        solution[np.abs(solution) < ZERO_COEFFICIENT] = 0.0
        solution *= norms[followers][None] / norms[leaders][:, None]
    margin = kept / max(dropped, float(np.finfo(float).eps)) if leaders else 0.0
    return Dependencies(
        np.array(leaders, dtype=np.intp),
        np.array(followers, dtype=np.intp),
        np.flatnonzero(zero).astype(np.intp),
        solution,
        margin,
    )


_BASES: Recent[BaseParameters] = Recent(16)


def find_base(model: Regressor, seed: int = 0) -> BaseParameters:
    """Return the structural base parameters of a robot, from random states and without data.

    Parameters
    ----------
    model
        Its regressor (eqs. 13, 14).
    seed
        Of the random states; any other gives the same answer.

    Raises
    ------
    RobotError
        If nothing of the robot can be identified (no column differs from zero).
    UsageError
        `model` is no regressor.
    """
    check_kind("model", model, Regressor, "Regressor(robot) makes one")
    if model.terms != BASE_TERMS:
        return _found(model, seed)
    return _BASES.of((model.robot.structure, seed), lambda: _found(model, seed))


def _found(model: Regressor, seed: int) -> BaseParameters:
    robot = model.robot
    model = Regressor(robot.squared(), model.terms)
    states = min(_STATES + model.parameters, _FEWEST + _SHARED // max(model.parameters, 1))
    motion = random_motion(robot.n, robot.elastic, states, seed)
    triangles = []
    for _, columns, block in model.blocks(motion):
        triangle = np.asarray(np.linalg.qr(block, mode="r"))
        triangle /= np.abs(triangle).max(initial=1e-300)  # the rows near a tip count as much as those that carry all
        triangles.append(np.zeros((len(triangle), model.parameters)))
        triangles[-1][:, columns] = triangle
    whole = np.asarray(np.linalg.qr(np.concatenate(triangles), mode="r"))
    norms = np.linalg.norm(whole, axis=0)
    shown = norms > STRUCTURAL_TOLERANCES[0] * norms.max()
    sizes = np.linalg.svd(whole[:, shown] / norms[shown], compute_uv=False)
    rank = int(np.count_nonzero(sizes > STRUCTURAL_RANK * sizes[0]))
    for tolerance in STRUCTURAL_TOLERANCES:
        found = leftmost(whole, tolerance, null=STRUCTURAL_TOLERANCES[0])
        if len(found.leaders) <= rank:
            break
    if not len(found.leaders):
        raise RobotError(f"robot {robot.name}: no dynamic parameter has any effect on the torques")
    transform = np.zeros((len(found.leaders), model.parameters))
    transform[np.arange(len(found.leaders)), found.leaders] = 1.0
    transform[:, found.followers] = found.coefficients
    names = model.names
    units = robot.parameter_units()
    return BaseParameters(
        parameters=names,
        units=tuple(units[k] for k in found.leaders),
        leaders=found.leaders,
        transform=transform,
        classes=classes_of(names, found),
        margin=found.margin,
    )


def classes_of(names: Sequence[str], found: Dependencies) -> dict[str, Class]:
    """Return the class of every parameter (section 5): null column, leader with an empty row, or combination."""
    classes: dict[str, Class] = {}
    lead = {int(k): row for row, k in enumerate(found.leaders)}
    null = set(found.null.tolist())
    for k, name in enumerate(names):
        if k in null:
            classes[name] = "unidentifiable"
        elif k in lead and not found.coefficients[lead[k]].any():
            classes[name] = "independent"
        else:
            classes[name] = "combined"
    return classes
