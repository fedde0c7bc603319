"""What a saved result says of the joint distribution of its base parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.estimation.saved_results import AGAIN, saved_object, told_by
from elid_cli.tables import Shown

INDEFINITE = 1e-6
"""Share of the largest eigenvalue of the correlations by which the smallest may be negative: rounding."""


@dataclass(frozen=True)
class SavedDistribution:
    """Estimates of one result with their covariance; NaN where refused."""

    file: str
    robot: str
    joints: tuple[str, ...]
    names: tuple[str, ...]
    """Of the base parameters, (b,)."""
    units: tuple[str, ...]
    terms: tuple[Mapping[str, float], ...]
    """Standard parameter: coefficient; the leading one first."""
    estimate: Array
    """SI, (b,)."""
    reference: Array
    """Value of the robot file, (b,); NaN where unknown."""
    covariance: Array
    """(b, b)."""
    biased: NDArray[np.bool_]
    """Whether what the model lacks can move it, (b,)."""
    channels: tuple[str, ...] = ()
    """Offsets and delays of drives that a fit of simulated motion found beside: ``torque_offset hip``."""
    bodies_held: bool = False
    """Whether it is a fit of simulated motion, which has the bodies of the robot file."""
    loop: float = 0.0
    """Longest period, s, of a drive's loop that its motion does not tell from none; 0 where it was not asked."""
    model: str = ""
    """What the result says of its model: ``sufficient``, ``insufficient``, or another word; empty: nothing."""
    unclear: bool = False
    """Whether something may be missing although the model is sufficient."""
    lacking: tuple[tuple[str, str | None], ...] = ()
    """Effects that a diagnosis found the robot to lack, each with its joint; None: of the whole robot."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which base parameters the result estimates, (b,)."""
        return np.isfinite(self.estimate) & np.isfinite(np.diag(self.covariance))


def read_distribution(path: str | Path) -> SavedDistribution:
    """Read a result of ``elid identify`` or ``elid diagnose`` saved with ``--json``.

    Raises
    ------
    UsageError
        No such file, not a result with estimates and their covariance, or a covariance that is none.
    """
    return distribution_of(saved_object(path), str(path))


def as_distribution(result: SavedDistribution | Shown | str | Path, number: int) -> SavedDistribution:
    """Return a result as a distribution: read where it is a file, called by its number where none holds it.

    Raises
    ------
    UsageError
        See `read_distribution`.
    """
    return result if isinstance(result, SavedDistribution) else distribution_of(*told_by(result, number))


def distribution_of(data: Mapping[str, Any], path: str) -> SavedDistribution:
    """Return what the JSON object of a result says; `path` is what it is called.

    Raises
    ------
    UsageError
        Not a result with estimates and their covariance, or a covariance that is none.
    """
    entries = data.get("base_parameters")
    if not isinstance(entries, list) or not entries or not all(map(_well_formed, entries)):
        detail = f"it was made by elid {data.get('command')}"
        raise UsageError(f"{path}: holds no base parameters", detail=detail, hint=AGAIN)
    if "covariance" not in data:
        detail = f"it was made by elid {data.get('command')}, version {data.get('version')}"
        raise UsageError(f"{path}: holds no covariance of its estimates", detail=detail, hint=AGAIN)
    joints = data.get("joints")
    found = SavedDistribution(
        file=path,
        robot=str(data.get("robot", "")),
        joints=tuple(str(name) for name in joints) if isinstance(joints, list) else (),
        names=tuple(str(e["name"]) for e in entries),
        units=tuple(str(e.get("unit", "")) for e in entries),
        terms=tuple(_terms(e["terms"], path) for e in entries),
        estimate=_numbers([e.get("estimate") for e in entries], path),
        reference=_numbers([e.get("reference") for e in entries], path),
        covariance=_matrix(data["covariance"], len(entries), path),
        biased=np.array([e.get("bias_possible") is True for e in entries]),
        channels=_channels(data),
        bodies_held=data.get("estimator") == "trajectory",
        loop=_loop(data),
        model=str(data.get("model", "")),
        unclear=data.get("unclear") is True,
        lacking=_lacking(data),
    )
    if len(set(found.names)) < len(found.names):
        raise UsageError(f"{path}: names a base parameter twice", hint=AGAIN)
    if not found.known.any():
        raise UsageError(f"{path}: every base parameter is refused", detail="there is nothing to draw from")
    return found


def _channels(data: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the drives' offsets and delays, without which a robot fitted by its motion does not move as measured."""
    found = data.get("nuisances")
    if data.get("estimator") != "trajectory" or not isinstance(found, list):
        return ()
    return tuple(f"{n.get('effect')} {n.get('joint')}" for n in found if isinstance(n, Mapping))


def _lacking(data: Mapping[str, Any]) -> tuple[tuple[str, str | None], ...]:
    found = data.get("effects")
    if data.get("command") != "diagnose" or not isinstance(found, list):
        return ()
    named = ((str(e.get("effect")), e.get("joint")) for e in found if isinstance(e, Mapping))
    return tuple(dict.fromkeys((effect, None if joint is None else str(joint)) for effect, joint in named))


def _loop(data: Mapping[str, Any]) -> float:
    """Return up to which period a drive's loop is left open by a fit of simulated motion, s; 0: none."""
    settings = data.get("settings")
    trajectory = settings.get("trajectory") if isinstance(settings, Mapping) else None
    found = trajectory.get("unseen_loop") if isinstance(trajectory, Mapping) else None
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else 0.0


def _well_formed(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(entry.get("terms"), dict) and bool(entry["terms"]) and "name" in entry


def _terms(terms: Mapping[str, Any], where: str) -> dict[str, float]:
    return dict(zip(map(str, terms), _numbers(list(terms.values()), where).tolist(), strict=True))


def _numbers(values: Sequence[Any], where: str) -> Array:
    """Return numbers, NaN for null (UsageError for anything else)."""
    if not all(v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in values):
        raise UsageError(f"{where}: expected a number in the result", hint=AGAIN)
    try:
        return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
    except OverflowError:
        raise UsageError(f"{where}: a number of the result is too large", hint=AGAIN) from None


def _matrix(rows: Any, count: int, where: str) -> Array:
    """Return the covariance, (count, count), checked to be one."""
    square = isinstance(rows, list) and len(rows) == count
    if not square or not all(isinstance(row, list) and len(row) == count for row in rows):
        raise UsageError(f"{where}: the covariance is not a matrix of {count} rows and columns", hint=AGAIN)
    found = np.array([_numbers(row, where) for row in rows])
    known = np.isfinite(np.diag(found))
    part = found[np.ix_(known, known)]
    deviation = np.sqrt(np.maximum(np.diag(part), 0.0))
    unit = part / np.outer(*[np.where(deviation > 0, deviation, 1.0)] * 2)
    symmetric = np.isfinite(part).all() and np.allclose(unit, unit.T, rtol=0, atol=INDEFINITE)
    if not symmetric or (np.diag(part) < 0).any() or _least(unit) < -INDEFINITE:
        detail = "it must be symmetric and may have no negative eigenvalue"
        raise UsageError(f"{where}: not a covariance", detail=detail, hint=AGAIN)
    return found


def _least(unit: Array) -> float:
    """Return the smallest eigenvalue of correlations over the largest; 0 without any."""
    if not unit.size:
        return 0.0
    values = np.linalg.eigvalsh((unit + unit.T) / 2)
    return float(values[0] / max(values[-1], 1.0))
