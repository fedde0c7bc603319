"""A log reduced to triangles: all that identification keeps of it, a few hundred kilobytes however long the log was.

Beside the triangles stand the long-run covariance of the scores (for standard errors that know of correlation in
time), what the signals were like, and where they came from. Several of these, of one robot and reduced under the same
options, are identified together by `merge`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.judgement import Judgement
from elid_cli.estimation.regression.triangles import Triangle
from elid_cli.estimation.stiffness.links import LinkSystem
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.recording import Recording, without_samples


@dataclass(frozen=True)
class Scores:
    """Long-run covariance of the scores (column times residual) of every column of every row group.

    The residual is that of this log's own fit; another fit's differs by no more than both fits' errors.
    """

    gram: Array
    """(s, s), the columns of `ReducedLog.layout` one row group after the other."""
    bandwidth: float
    nuisances: tuple[int, ...]
    """Numbers of the nuisances in that fit."""


@dataclass(frozen=True)
class ReducedLog:
    """One log, reduced.

    Columns are the p standard parameters, then a delay and then an offset for each of the n torque channels, whether
    the log has it or not, so that the columns of all logs of a robot agree.
    """

    fingerprint: str
    """Of the model of the robot as described (`robot.text.fingerprint`)."""
    options: Mapping[str, object]
    """How the signals were conditioned, as asked for, JSON values; of commands, what was decided: smooth, or None."""
    recording: Recording
    """What is known of the log, its samples left out."""
    facts: SignalFacts
    layout: tuple[tuple[EstimationRow, NDArray[np.intp]], ...]
    """Row groups and the numbers of their columns."""
    steady: tuple[Triangle, ...]
    """Triangles of the instants away from reversals, per row group and fold."""
    reversing: tuple[Triangle, ...]
    """The same of the instants around reversals."""
    scores: tuple[Scores, ...]
    """Of the fit with all nuisances and, where it differs, of the one with the significant ones only."""
    links: tuple[LinkSystem | None, ...]
    """Equation of every joint's link with the inertias of the robot file, where it gives them."""
    reference: Array
    """The robot file's parameters, (p,), NaN where it gives none."""
    judgement: Judgement | None = None
    """What its residual says of the model, by stretches of a long log; None where it told too little."""
    origin: str = ""
    """Triangle file that it was read from."""

    @property
    def name(self) -> str:
        """What to call it in an error: the triangle file and the log in it, or the log."""
        logs = ", ".join(self.recording.files)
        return f"{self.origin} ({logs})" if self.origin else logs


def hollow(recording: Recording) -> Recording:
    """Return a recording that says all about its samples but holds none: arrays of the same shape that take no room."""
    kept = ("segments", "files", "sha256", "repairs", "notes", "warnings", "smooth")
    told = {name: getattr(recording, name) for name in kept}
    samples = recording.samples
    return without_samples(recording.joints, recording.dt, samples, **told, sources=dict(recording.sources))


def without_positions(recording: Recording) -> Recording:
    """Return a recording without its positions and velocities, but for whether a joint has them (a number, else NaN).

    Once splines stand for them, they only take memory.
    """

    def told(values: Array, number: Array | float = 0.0) -> Array:
        known = [not np.isnan(column[:1]).all() or not np.isnan(column).all() for column in values.T]
        return np.broadcast_to(np.where(known, number, np.nan), values.shape)

    apart = np.where(recording.missing_link, 0.0, 1.0)  # the same number on both sides of what has one side only
    q, theta = told(recording.q), told(recording.theta, apart)
    return replace(recording, q=q, theta=theta, dq=None, dtheta=None, gyro={}, accel={})
