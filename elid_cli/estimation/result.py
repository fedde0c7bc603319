"""What an identification answers: base parameters, their errors and verdicts, and how well they predict torque."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.checks import check_fields, flag, number, optional, several, whole, word
from elid_cli.errors import UsageError
from elid_cli.estimation.judgement import Insufficient, JointError, ModelWord, NotExcluded, RowNoise
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.tables import Shown

if TYPE_CHECKING:
    from elid_cli.estimation.motor_side.result import MotorSide
    from elid_cli.estimation.regression.held_effects import HeldErrors

Verdict = Literal["supported", "weak", "refused"]


MOST_FOLDS = 1000
"""Stretches of a log that are predicted one by one; there are never more than samples, and each takes a fit."""

_RULES = {
    "estimator": word("default", "paper"),
    "accurate": flag,
    "fit": word("auto", "torque", "trajectory"),
    "folds": whole(2, MOST_FOLDS),
    "delays": flag,
    "declared_late": several(whole(0), "joints' numbers, from 0"),
    "offsets": flag,
    "mask": optional(flag),
    "hold": number(least=0),
    "valleys": flag,
    "guards": flag,
}


@dataclass(frozen=True)
class EstimateOptions:
    """How to estimate."""

    estimator: Literal["default", "paper"] = "default"
    accurate: bool = False
    """Follow with the spline collocation (`collocation`), accepted only if it proves itself."""
    fit: Literal["auto", "torque", "trajectory"] = "auto"
    """What comes near what was measured: the torque, or the simulated motion under the log's commands.

    ``auto``: the torque, but the motion of a short log whose torques are computed from commands (`trajectory.unasked`).
    """
    folds: int = 6
    """Contiguous stretches; each in turn is predicted by a fit to the others."""
    delays: bool = True
    """Estimate one torque delay per torque channel."""
    declared_late: tuple[int, ...] = ()
    """Joints whose torques' delays stay, whatever their sign and size: a robot file declares them."""
    offsets: bool = True
    """Estimate one torque offset per torque channel."""
    mask: bool | None = None
    """Leave out reversals of the motors; None: of those motors that do not follow Coulomb friction there."""
    hold: float = 0.0
    """Declared effects keep their shapes, and amplitudes within this part of what is declared; 0: all is fitted."""
    held: HeldErrors | None = None
    """How well the effects that are held are known; None: standard errors beside them take them for known."""
    valleys: bool = True
    """Look for other valleys of the declared effects' shapes than the one that they start in."""
    guards: bool = True
    """Test signs, units and swapped channels by flipping them."""

    @property
    def chooses(self) -> bool:
        """Whether the motion may be fitted unasked: nothing that it does not hold was asked for."""
        return self.fit == "auto" and self.offsets and not self.hold

    def __post_init__(self) -> None:
        """Refuse values that no estimate can have, and wishes that exclude each other (UsageError)."""
        check_fields(self, _RULES)
        other = "--accurate" if self.accurate else "--estimator paper" if self.estimator == "paper" else ""
        if self.fit == "trajectory" and other:
            raise UsageError(f"--fit trajectory and {other} exclude each other", hint="leave one of them out")


@dataclass(frozen=True)
class Nuisance:
    """Something of the measurement that was estimated along and corrected."""

    effect: str
    joint: str
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]
    kept: bool = False
    """Whether other values rest on it, whatever its error: it is written to robots."""
    long: bool = False
    """Whether it is a delay of more than a sample: what a model lacks may look like one."""
    bias_possible: bool = False
    """Whether what the model lacks can move it by more than its standard error says."""

    @property
    def doubted(self) -> Nuisance:
        """The same in a model that lacks something."""
        return replace(self, bias_possible=self.bias_possible or self.long)


@dataclass(frozen=True)
class DriveGain:
    """What a drive's logged torque is to be multiplied by, from a pair of logs with a known payload in one of them."""

    joint: str
    gain: float | None
    """N·m (N) at the joint per unit of the torque as it was mapped; None where refused."""
    std_error: float | None
    interval: tuple[float, float] | None
    """Of 95 %: that of one over the gain, which is what least squares estimate, turned over."""
    verdict: Verdict


@dataclass(frozen=True)
class FittedEffect:
    """An effect that the robot file declares, with the parameters that this log gives it."""

    effect: str
    joint: str | None
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]
    """Standard errors of the amplitudes, by name."""

    @property
    def unshown(self) -> tuple[str, ...]:
        """Names of the parameters that the log does not determine: their values stand for nothing."""
        return tuple(name for name, error in self.std_error.items() if not math.isfinite(error))

    @property
    def shown(self) -> dict[str, float]:
        """The other parameters."""
        return {name: value for name, value in self.parameters.items() if name not in self.unshown}


ROUNDING = 1e-9
"""Part of a value, or of its standard error, below which the file's is 0 but for rounding."""


@dataclass(frozen=True)
class BaseEstimate:
    """One base parameter as a log gives it."""

    name: str
    """The combination as printed: ``m1 - 4*Izz1 + 4*Izz2``."""
    leader: StandardParameter
    """Its leading standard parameter: ``m1``."""
    unit: str
    estimate: float
    """NaN where refused."""
    std_error: float
    reference: float
    """Value by the robot file; NaN where unknown."""
    verdict: Verdict
    reason: str = ""
    """Why it is weak, refused, or not from the motor torque."""
    bias_possible: bool = False
    """Whether what the model lacks can move it by more than its standard error says."""

    @property
    def relative_error(self) -> float:
        """|estimate - reference| / |reference|; NaN where there is no reference, or one that is 0 but for rounding."""
        least = ROUNDING * np.nanmax([abs(self.estimate), self.std_error, 0.0])
        if not abs(self.reference) > least:
            return float("nan")
        return abs(self.estimate - self.reference) / abs(self.reference)


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """What a log says about a robot's parameters, in SI units at the joint."""

    robot: Robot
    base: BaseParameters
    parameters: tuple[BaseEstimate, ...]
    """One record per base parameter, in standard order, (b,)."""
    error: Mapping[str, JointError]
    condition: float
    rank_margin: float
    rank: int
    covariance: Array
    """Covariance of the base parameters, (b, b), in products of `base.units`; NaN rows where refused."""
    standard: Array
    """A representative set of standard parameters (p,), SI, that predicts as the base parameters do."""
    delays: Array
    """Torque delay per joint that was corrected, s, (n,)."""
    settings: Mapping[str, object] = field(default_factory=dict)
    nuisances: tuple[Nuisance, ...] = ()
    effects: tuple[FittedEffect, ...] = ()
    """Effects declared in the robot file, as fitted to this log."""
    warnings: tuple[str, ...] = ()
    log_warnings: tuple[str, ...] = ()
    """What reading the log warned of."""
    notes: tuple[str, ...] = ()
    """What was decided on the way and why (a collocation that was not accepted…)."""
    estimator: str = "default"
    triangles: Triangles | None = None
    """The reduced data, for those who fit again under further conditions (`physical`)."""
    with_nuisances: Triangles | None = None
    """The same with every delay and offset of the torque channels as a column, also those that were taken for none."""
    weights: Mapping[EstimationRow, float] = field(default_factory=dict)
    """Weight of every row group in the fit: one over its residual rms."""
    model: ModelWord = "not judged"
    """Whether the residual follows the motion beyond the sensors' noise."""
    noise: tuple[RowNoise, ...] = ()
    insufficient: tuple[Insufficient, ...] = ()
    """The rows that make the model insufficient."""
    not_excluded: tuple[NotExcluded, ...] = ()
    """What other parameters would take up without a sign."""
    published: Mapping[str, JointError] = field(default_factory=dict)
    """Of a diagnosis: the held-out error at identification's cut-off, where the parameters are from."""
    drive_gains: tuple[DriveGain, ...] = ()
    """Of a pair of logs with a known payload: the gain of every drive; the rest is found with them."""
    gain_map: str = ""
    """The mapping of the torque with these gains in it; empty where one of them is refused."""
    hidden: Mapping[str, str] = field(default_factory=dict)
    """Standard parameters of the robot as described that logs of this kind do not show, with the reason."""
    rotors: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Inertias at joints, kg·m² (kg), with standard errors, of rotors that friction under load tells apart from bodies,
    where motion shows their sum alone, or that it was fitted with as the robot file has them; by joint."""
    motor_side: MotorSide | None = None
    """Stiffnesses of joints whose links the log does not hold; its other parameters are those of rigid joints."""

    @cached_property
    def estimate(self) -> Array:
        """Base parameters, (b,); NaN where refused."""
        return np.array([item.estimate for item in self.parameters])

    @cached_property
    def std_error(self) -> Array:
        """Standard errors of the base parameters, (b,); NaN where refused."""
        return np.array([item.std_error for item in self.parameters])

    @cached_property
    def reference(self) -> Array:
        """Reference values of the base parameters, (b,); NaN where unknown."""
        return np.array([item.reference for item in self.parameters])

    @property
    def verdict(self) -> tuple[Verdict, ...]:
        """Verdicts on the base parameters, (b,)."""
        return tuple(item.verdict for item in self.parameters)

    @cached_property
    def joint_covariance(self) -> Array:
        """Covariance of the estimates as given, (b, b): their own standard errors; NaN rows where refused.

        A stiffness that another regression gave in the end goes by itself, without correlations of its own.
        """
        fitted = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        known = fitted > 0  # False where NaN
        unit = np.where(known, self.std_error / np.where(known, fitted, 1.0), 0.0)
        found: Array = np.where(np.outer(known, known), self.covariance, 0.0) * np.outer(unit, unit)
        found[np.diag_indices(len(found))] = self.std_error**2
        refused = ~np.isfinite(self.std_error)
        found[refused] = found[:, refused] = np.nan
        return found

    @property
    def drives(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
        """Values and errors of every drive, by joint and parameter, of a fit of the motion under commands; else empty.

        Parameters are ``Ja`` ``fs`` ``fv`` ``offset``, each with ``estimate``, ``std_error`` and ``verdict`` at least.
        Its bodies are those of the robot file.
        """
        told: Any = self.settings.get("trajectory")
        found: Mapping[str, Any] = told.get("joint_parameters", {}) if isinstance(told, dict) else {}
        return found

    @property
    def this_log(self) -> Mapping[str, str]:
        """Class of every standard parameter for this log: as structural, or weak, or not excited."""
        return self._in_log[0]

    @property
    def reasons(self) -> Mapping[str, str]:
        """Why a standard parameter is weak, refused or not excited."""
        return self._in_log[1]

    @cached_property
    def _in_log(self) -> tuple[dict[str, str], dict[str, str]]:
        """Classes of the standard parameters, and reasons: those of the leaders, which their followers share."""
        base = self.base
        classes: dict[str, str] = dict(base.classes)
        reasons = {item.leader: item.reason for item in self.parameters if item.reason}
        for k, item in enumerate(self.parameters):
            if item.verdict == "supported":
                continue
            classes[item.leader] = "weak" if item.verdict == "weak" else "not excited"
            for j in np.flatnonzero(base.transform[k])[1:]:
                follower = base.parameters[j]
                rows = [self.parameters[row] for row in np.flatnonzero(base.transform[:, j])]
                if any(row.verdict == "supported" for row in rows):
                    continue
                deciding = next((row for row in rows if row.verdict == "weak"), item)
                classes[follower] = "weak" if deciding.verdict == "weak" else "not excited"
                reasons.setdefault(follower, deciding.reason)
        classes |= dict.fromkeys(self.hidden, "not excited")
        for joint in self.motor_side.joints if self.motor_side else ():
            if joint.verdict != "refused":
                classes[joint.parameter] = "independent" if joint.verdict == "supported" else "weak"
                if joint.reason:
                    reasons[joint.parameter] = joint.reason
        return classes, reasons | dict(self.hidden)

    def beside(self, reference: Array) -> Identification:
        """Return the identification with other reference values of the base parameters, (b,)."""
        items = zip(self.parameters, reference.tolist(), strict=True)
        return replace(self, parameters=tuple(replace(item, reference=value) for item, value in items))

    def relative_error(self) -> Array:
        """Return |estimate - reference| / |reference|, (b,); NaN where there is no non-zero reference."""
        return np.array([item.relative_error for item in self.parameters])

    def normalised_mean_error(self) -> float:
        """Return the paper's figure: mean relative error over all base parameters, zero-valued ones counting 0."""
        error = np.where(self.reference == 0, 0.0, np.nan_to_num(self.relative_error(), nan=1.0))
        return float(error.mean())


def records(
    base: BaseParameters, estimate: Array, covariance: Array, refused: NDArray[np.bool_], reference: Array,
    verdicts: Sequence[Verdict], reasons: Mapping[str, str],
) -> tuple[tuple[BaseEstimate, ...], Array]:  # fmt: skip
    """Return one record per base parameter, from arrays (b,), and their covariance, (b, b); NaN where refused.

    `reasons` go by the leading parameter's name.
    """
    std_error = np.where(refused, np.nan, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    estimate = np.where(refused, np.nan, estimate)
    found = []
    for k, leader in enumerate(base.leaders):
        name = base.parameters[leader]
        values = float(estimate[k]), float(std_error[k]), float(reference[k])
        found.append(BaseEstimate(base.names[k], name, base.units[k], *values, verdicts[k], reasons.get(name, "")))
    return tuple(found), np.where(refused[:, None] | refused, np.nan, covariance)
