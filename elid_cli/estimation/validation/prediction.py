"""A described robot predicts a log: `validate`, whole or log by log."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import RobotError, UsageError, first_of
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.scene_with_effects import with_effects
from elid_cli.estimation.slow_effects import CUTOFFS, declares_slow, highest_that_holds
from elid_cli.estimation.validation.cross_validation import errors_of_rows
from elid_cli.estimation.validation.noise_floor import noise_floor
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.effects.declared import as_observed, resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import with_loops
from elid_cli.model.effects.posed import as_posed, declared_pose, turns_model
from elid_cli.model.effects.scene import Scene
from elid_cli.model.effects.shifts import corrected, declared_shifts, delivered, unshifted_robot
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals, check_signals
from elid_cli.tables import Shown

LEAST = 100
"""Instants that a lower cut-off must leave to be tried."""
MOSTLY = 0.5
"""Part of the squared error left from which a constant is most of it."""


@dataclass(frozen=True, repr=False)
class Validation(Shown):
    """Prediction error of a robot description on a log, without fitting."""

    robot: Robot
    error: Mapping[str, JointError]
    residual: Mapping[EstimationRow, Array]
    """Measured minus predicted torque per row group, N·m (N), (M,); the columns of masked instants included. Rows of
    a spring whose stiffness nobody knows are absent."""
    observation: Observation
    signals: Signals
    """The log."""
    corrected: Signals
    """The same with its channels corrected as the description says."""
    model: Regressor
    standard: Array
    """Standard parameters of the description, (p,), SI; 0 where unknown."""
    effect_columns: Mapping[EstimationRow, tuple[Array, ...]]
    """Columns of the declared effects, N·m (N) per unit of their amplitudes, (d, M) each, by row group."""
    chosen: NDArray[np.bool_] | None = None
    """Instants that are judged, (M,); None: all."""
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def constants(self) -> dict[str, float]:
        """Mean of what is left of joints' torque, N·m (N), of those where it is most of what is left."""
        found = {}
        for group in self.observation.groups:
            if group.row.kind != "sum" or group.row not in self.residual:
                continue
            use = group.use if self.chosen is None else group.use & self.chosen
            left = self.residual[group.row][use]
            if not len(left):
                continue
            mean = float(left.mean())
            if mean**2 > MOSTLY * float(np.mean(left**2)):
                found[self.robot.joint_names[group.row.joint]] = mean
        return found


def validate(
    robot: Robot, signals: Signals, chosen: NDArray[np.bool_] | None = None, *, observation: Observation | None = None
) -> Validation:
    """Predict the motor torque of a log from a robot description.

    Parameters
    ----------
    robot
        Description with parameter values, and effects with theirs.
    signals
        The log.
    chosen
        Instants to judge, (M,) of True and False, default all.
    observation
        The log's equations where they are at hand.

    Raises
    ------
    RobotError
        If the description holds no parameter values, or an effect lacks some.
    UsageError, LogError
        These are no signals, or those of other joints; instants that are not those of the log, or none of them.
    """
    check_signals(signals, robot)
    if signals.cutoff_free and chosen is None and observation is None:
        signals = where_it_holds(robot, signals)
    turned = bool(declared_pose(robot))
    asked, described, logged = signals, robot, signals
    robot, signals = with_loops(as_posed(as_observed(robot, signals)), signals)
    model = Regressor(robot)
    standard = complete(robot, find_base(model))
    shifts = declared_shifts(robot)
    scene = scene_of(model, signals, standard) if robot.effects else None
    effects = [] if scene is None else _declared(robot, scene)
    drives = [(effect, linear) for effect, linear in effects if effect.simulated == "motor"]
    signals = corrected(delivered(signals, drives), shifts)
    changed = turned or bool(shifts) or bool(drives) or signals is not asked
    observation = observe(model, signals) if observation is None or changed else observation
    chosen = _instants(chosen, observation.instants)
    springs = {k for k, name in enumerate(model.names) if name.kind == "K" and not np.isfinite(robot.reference()[k])}
    residual = {
        group.row: group.target - standard[group.index] @ group.columns
        for group in observation.groups
        if springs.isdisjoint(group.index.tolist())
    }
    acting: dict[EstimationRow, tuple[Array, ...]] = {}
    if scene is not None and signals is not logged:
        scene = scene_of(model, signals, standard)
    scene = None if scene is None else with_effects(scene, [pair for pair in effects if pair not in drives])
    for effect, linear in effects:
        if scene is None or effect.simulated == "motor":
            continue
        for row, columns in extra_of(effect, scene, signals).rows.items():
            if row in residual:
                residual[row] = residual[row] - linear @ columns
                acting[row] = (*acting.get(row, ()), columns)
    settings = {"cutoff": signals.filter.cutoff, "rate": signals.rate, "instants": observation.instants}
    errors = _errors(robot, observation, residual, chosen)
    return Validation(
        described, errors, residual, observation, logged, signals, model, standard, acting, chosen, settings
    )


def where_it_holds(robot: Robot, signals: Signals) -> Signals:
    """Return a log at the highest cut-off at which declared effects whose form holds at low frequencies alone hold.

    A robot that declares none has it as it is.
    """
    own = signals.filter.cutoff
    if not declares_slow(robot):
        return signals
    tried: list[tuple[float, Signals]] = []
    for cutoff in (own, *(lower for lower in CUTOFFS if lower < own)):
        lower = replace(signals.refiltered(cutoff), cutoff_free=False)
        if tried and len(lower.outputs) < LEAST:
            break
        tried.append((_left(validate(robot, lower)), lower))
    return highest_that_holds(tried)


def _left(told: Validation) -> float:
    """Return the residual over what the sensors' noise alone would leave, of the joint that has most of it."""
    floor = noise_floor(told.model, told.corrected, told.observation, told.standard).rms
    return max(told.error[told.robot.joint_names[row.joint]].rms / floor[row] for row in floor if row.kind == "sum")


def _instants(chosen: object, count: int) -> NDArray[np.bool_] | None:
    """Return the instants to judge, (M,) of `count` (UsageError: another shape, or positions)."""
    if chosen is None:
        return None
    mask = np.asarray(chosen)
    if mask.dtype != bool or mask.shape != (count,):
        raise UsageError(
            f"validate: chosen: {mask.dtype}, shape {mask.shape}, in place of bool, shape ({count},)",
            hint="True for every instant after filtering that is judged: signals.outputs says which samples they are",
        )
    return mask


def _declared(robot: Robot, scene: Scene) -> list[tuple[Effect, Array]]:
    """Return the effects that a robot declares with their amplitudes (d,), but for shifts in time and what turns it.

    Raises
    ------
    RobotError
        An effect lacks a value.
    """
    found: list[tuple[Effect, Array]] = []
    for spec in unshifted_robot(robot).effects:
        kind, joint = resolve(robot, spec)
        if turns_model(kind):
            continue
        try:
            linear, shape = kind.coefficients(scene, joint, spec.parameters)
        except KeyError as error:
            raise RobotError(
                f"{robot.name}: effect {spec.effect} has no value for {error.args[0]!r}",
                hint="elid identify fits declared effects: use its --write-robot",
            ) from None
        found.append((kind(joint, shape), linear))
    return found


def complete(robot: Robot, base: BaseParameters) -> Array:
    """Return the standard parameters (p,) of a robot file; those that no torque depends on count as 0.

    So does a stiffness that the file does not give: the torque with the spring eliminated is predicted without it.

    Raises
    ------
    RobotError
        A base parameter contains another parameter that the file does not give.
    """
    leaders = base.leaders[~np.isfinite(base.values(robot.reference()))]
    unknown = [base.parameters[k] for k in leaders if base.parameters[k].kind != "K"]
    if unknown:
        raise RobotError(
            f"{robot.name}: the robot file does not give {len(unknown)} of {base.count} base parameters",
            detail=f"not known: those led by {first_of(unknown, 8)}",
            hint=shlex.join(
                [
                    "elid",
                    "identify",
                    "LOG",
                    "--robot",
                    robot.given or robot.name,
                    "--write-robot",
                    f"{robot.name}-identified.yaml",
                ]
            ),
        )
    return np.nan_to_num(robot.reference())


def _errors(
    robot: Robot, observation: Observation, residual: Mapping[EstimationRow, Array], chosen: NDArray[np.bool_] | None
) -> dict[str, JointError]:
    use = {g.row: g.use if chosen is None else g.use & chosen for g in observation.groups if g.row in residual}

    def rms(row: EstimationRow) -> float | None:
        if row not in use or not use[row].any():
            return None
        return float(np.sqrt(np.mean(residual[row][use[row]] ** 2)))

    def size(row: EstimationRow) -> float:
        torque = observation.tau[row.joint] if row.kind == "sum" else observation.group(row).target
        return float(np.sqrt(np.mean(torque[use[row]] ** 2)))

    return errors_of_rows(robot, rms, size)


@dataclass(frozen=True)
class ByLog:
    """Error of the predicted motor torques on one of several logs."""

    file: str
    error: Mapping[str, JointError]
    shown: str = ""
    """What a report calls it, where that is not the file."""

    @property
    def label(self) -> str:
        """What a report calls it."""
        return self.shown or self.file


def errors_by_log(
    robot: Robot, signals: Signals, files: Sequence[str], chosen: NDArray[np.bool_] | None = None
) -> tuple[ByLog, ...]:
    """Return each log's error, predicted by one robot description; nothing where there is only one log.

    Parameters
    ----------
    robot
        Description that holds what was identified from all logs together.
    signals
        The joined logs; `Segment.source` counts the files.
    files
        Names of the logs.
    chosen
        Instants to judge, (M,), default all.

    """
    if len(files) < 2:
        return ()
    observation = observe(Regressor(as_posed(as_observed(robot, signals))), signals)
    sources = np.array([segment.source for segment in signals.segments], dtype=np.intp)[observation.segment]
    judged = []
    for number, file in enumerate(files):
        here = (sources == number) & (True if chosen is None else chosen)
        if here.any():
            judged.append(ByLog(file, validate(robot, signals, here, observation=observation).error))
    return tuple(judged)
