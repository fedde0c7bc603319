"""One distribution from one result or several: with the spread between recordings beyond their own errors.

Of several results the mean counts every recording alike. The spread between recordings is what the results scatter by
beyond their standard errors (moments, DerSimonian and Laird 1986, Controlled Clinical Trials 7). Sets are drawn for a
further recording: variance between · (1 + 1/K) + mean variance within / K for K results, the former widened by what the
spread of so few is known badly (Student's t; Higgins, Thompson, Spiegelhalter 2009, J. R. Statist. Soc. A 172).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.estimation.sampling.saved import SavedDistribution
from elid_cli.robot.parameter import POSITIVE, parameter_named

Origin = Literal["drawn", "split", "held", "unknown"]
INERTIAL = ("m", "Ixx", "Iyy", "Izz")
"""Kinds of a body that are positive in every robot."""


@dataclass(frozen=True)
class Distribution:
    """Normal distribution of the base parameters of one machine, cut off where no robot is."""

    robot: str
    joints: tuple[str, ...]
    files: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    terms: tuple[Mapping[str, float], ...]
    mean: Array
    """(b,): of those that are held, the reference; NaN where that is unknown."""
    covariance: Array
    """(b, b); rows of 0 for those that are held."""
    between: Array
    """Standard deviation between recordings, (b,); NaN for one result."""
    drawn: NDArray[np.bool_]
    """Those that a result estimates, (b,)."""
    positive: NDArray[np.bool_]
    """Those that are positive in every robot, (b,)."""
    biased: NDArray[np.bool_]
    """Those that a result says its model may have moved, (b,)."""

    @property
    def origin(self) -> tuple[Origin, ...]:
        """Where each value comes from, (b,)."""
        return tuple(
            "drawn" if drawn else "held" if np.isfinite(mean) else "unknown"
            for drawn, mean in zip(self.drawn, self.mean, strict=True)
        )


def pooled(results: Sequence[SavedDistribution]) -> Distribution:
    """Return the distribution that results of one robot tell together.

    Raises
    ------
    UsageError
        Results of unlike robots: other base parameters.
    """
    first = results[0]
    for other in results[1:]:
        if other.names != first.names:
            alike = len(set(first.names) & set(other.names))
            raise UsageError(
                f"{other.file}: its base parameters are not those of {first.file}",
                detail=f"{alike} of {len(first.names)} are the same; robots {other.robot!r} and {first.robot!r}",
                hint="give results of one robot, of logs with the same signals",
            )
    known = np.array([result.known for result in results])
    drawn = np.asarray(known.any(axis=0))
    estimate = np.array([np.where(result.known, result.estimate, np.nan) for result in results])
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(drawn, np.nansum(estimate, axis=0) / count, first.reference)
    within = _within(results, known, count)
    between = _between(estimate, known, mean, within)
    weight = np.sqrt(1.0 + 1.0 / count) * _widening(count)
    share = within / np.sqrt(np.outer(count, count))
    return Distribution(
        first.robot, first.joints, tuple(r.file for r in results), first.names, first.units, first.terms,
        mean=mean,
        covariance=np.where(np.outer(drawn, drawn), share + between * np.outer(weight, weight), 0.0),
        between=np.sqrt(np.diag(between)) if len(results) > 1 else np.full(len(mean), np.nan),
        drawn=drawn,
        positive=np.array([_positive(terms) for terms in first.terms]),
        biased=np.asarray(np.any([r.biased for r in results], axis=0)),
    )  # fmt: skip


def _widening(count: NDArray[np.intp]) -> Array:
    """Return how many times wider 95 % reach where a spread is that of `count` values, (b,); two as if of three."""
    from scipy.special import ndtri, stdtrit

    return np.asarray(stdtrit(np.maximum(count - 1, 2), 0.975) / ndtri(0.975))


def _within(results: Sequence[SavedDistribution], known: NDArray[np.bool_], count: NDArray[np.intp]) -> Array:
    """Return the results' mean covariance, (b, b); one that lacks a parameter gives it the others' variance alone."""
    own = [np.where(np.outer(k, k), r.covariance, 0.0) for r, k in zip(results, known, strict=True)]
    variances = np.sum([np.diag(matrix) for matrix in own], axis=0) / count
    total = np.zeros_like(own[0])
    for matrix, there in zip(own, known, strict=True):
        total += matrix + np.diag(np.where(there, 0.0, variances))
    return np.asarray(total / len(results))


def _between(estimate: Array, known: NDArray[np.bool_], mean: Array, within: Array) -> Array:
    """Return the covariance between recordings, (b, b): correlations count as far as so many results show them.

    Those of two results are all 1 or -1 and count nothing, those of K results the share (K - 2)/K.
    """
    logs = len(estimate)
    if logs < 2:
        return np.zeros_like(within)
    apart = np.where(known, estimate - mean, 0.0)
    free = np.maximum(known.sum(axis=0) - 1, 1)
    scatter = (apart**2).sum(axis=0) / free
    deviation = np.sqrt(np.where(known.sum(axis=0) > 1, np.maximum(scatter - np.diag(within), 0.0), 0.0))
    length = np.sqrt((apart**2).sum(axis=0))
    unit = apart / np.where(length > 0, length, 1.0)
    shown = (logs - 2) / logs
    correlation = shown * unit.T @ unit
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation * np.outer(deviation, deviation))


def _positive(terms: Mapping[str, float]) -> bool:
    """Whether a combination is positive in every robot: a sum of frictions, springs, rotors, masses and moments."""
    kinds = (known.kind if (known := parameter_named(name)) else "" for name in terms)
    return all(value > 0 for value in terms.values()) and all(kind in (*POSITIVE, *INERTIAL) for kind in kinds)
