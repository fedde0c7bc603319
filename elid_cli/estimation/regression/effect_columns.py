"""Effects against a log: the scene that they are computed from, and their columns in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation, pair
from elid_cli.estimation.regression.own_columns import beside_own
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles, to_triangles
from elid_cli.memory import Recent
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects.declared import Declared, amplitude_prior
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene, direction_widths
from elid_cli.model.program import Program
from elid_cli.model.regressor import EstimationRow, Regressor, inputs_of
from elid_cli.robot.parameter import MOTOR_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion, joined_motion
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals

NO_ROTORS: Mapping[int, float] = MappingProxyType({})
SHARP, SHARPEST = 4.0, 1e-5
"""Part of the slowest speed at which an instant counts over which the sign of velocity is rounded, and least, rad/s."""
_CHUNK = 8192
"""Samples whose full-rate regressor is held at a time."""
_KEPT, _KEPT_SAMPLES = 32_000_000, 16384
"""Bytes of a motion's full-rate regressor that are kept for further parameters, and samples of that motion."""


@dataclass(frozen=True)
class FittedEffects:
    """Declared effects at their fitted shapes, their columns, and the columns of their shapes' derivatives."""

    effects: tuple[Declared, ...]
    extras: tuple[ExtraColumns, ...]
    scene: Scene
    others: tuple[Mapping[int, Effect], ...] = ()
    """One joint's effects, by place in `effects`, in shapes of another valley of the cost that explain the log
    about as well."""

    @property
    def certain(self) -> bool:
        """Whether no columns but those of gains hang on the fit, and none hold noise of a deflection."""
        kinds = [item.effect for item in self.effects if item.effect.of_drive != "gain"]
        on_fit = any(effect.from_model or effect.memory or effect.corrects == "position" for effect in kinds)
        return not on_fit and not any(effect.strains_spring or effect.place == "spring" for effect in kinds)

    def has(self, effect: Effect) -> bool:
        """Whether an effect of the same kind is at the same joint."""
        return any(type(item.effect) is type(effect) and item.effect.joint == effect.joint for item in self.effects)

    @classmethod
    def of(cls, effects: Sequence[Declared], scene: Scene, signals: Signals) -> FittedEffects:
        """Return effects with their columns computed from a scene of the signals."""
        return cls(tuple(effects), tuple(extra_of(item.effect, scene, signals) for item in effects), scene)


def triangles_with_effects(
    observation: Observation,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    fold: NDArray[np.intp] | None = None,
) -> Triangles:
    """Return triangles with the columns of nuisances and effects, and what is known of the effects' amplitudes."""
    extras = (*nuisances, *(effects.extras if effects else ()))
    triangles = beside_own(observation, extras, fold) or to_triangles(observation, extras, fold)
    first = triangles.parameters + sum(extra.width for extra in nuisances)
    prior = None if effects is None else amplitude_prior(effects.effects, first, triangles.width)
    return triangles if prior is None else replace(triangles, prior=prior)


def scene_of(
    model: Regressor,
    signals: Signals,
    standard: Array,
    rotors: Mapping[int, float] = NO_ROTORS,
    late: Array | None = None,
) -> Scene:
    """Return what effects are computed from: all samples of all segments, one after the other.

    Parameters
    ----------
    model, signals
        The robot's model and a log's signals.
    standard
        Standard parameters (p,), any representative of the base parameters; K of 0 or NaN counts as unknown.
    rotors
        Rotor inertias at joints, kg·m² (kg), where only sums of them and of the bodies' show (`rotor_shares`).
    late
        Delays of the torque channels, s, (n,), that are corrected beside the parameters.
    """
    robot = model.robot
    played = _played(signals, model.estimation.program.distinct[0])
    motion = played.motion
    stiffness = np.full(robot.n, np.nan)
    for k, joint in enumerate(robot.joints):
        if joint.elastic:
            value = float(standard[model.index[StandardParameter("K", k)]])
            if np.isfinite(value) and value > 0:
                stiffness[k] = value
    springs = np.isfinite(stiffness)
    open_rotors = _open_rotors(model, standard, np.flatnonzero(~springs)) | dict(rotors)
    of_rotors = _rotors_in_sums(model) if not springs.all() else {}
    for number, inertia in open_rotors.items():
        if number in rotors or number not in of_rotors:  # that of the file stands as it is, without rounding
            ratio = robot.joints[number].gear_ratio or 1.0
            of_rotors[number] = model.index[robot.rotor_names[number]], inertia / ratio**2
    predicted, link = _torques(model, played, standard, np.flatnonzero(~springs), of_rotors)
    load = np.empty((motion.samples, robot.n))
    load[:, ~springs] = link
    for k in np.flatnonzero(springs).tolist():
        load[:, k] = stiffness[k] * (motion.theta[:, k] - motion.q[:, k])
    tau = _joined_rows(signals.tau, signals.segments)
    lengths = [len(segment) for segment in signals.segments]
    temperature = None if signals.temperature is None else _joined_rows(signals.temperature, signals.segments)
    return Scene(
        robot=robot,
        motion=motion,
        dt=signals.dt,
        tau=np.where(np.isfinite(tau), tau, predicted),
        command_torque=None
        if signals.command_torque is None
        else _joined_rows(signals.command_torque, signals.segments),
        error_integral=None
        if signals.error_integrals is None
        else _joined_rows(signals.error_integrals[0], signals.segments),
        load=load,
        predicted=predicted,
        parameters=np.nan_to_num(standard),
        duration=signals.duration,
        cutoff=signals.filter.cutoff,
        stiffness=stiffness,
        rotors=open_rotors,
        with_bodies={
            k: (inertia - float(np.nan_to_num(standard[column]))) * (robot.joints[k].gear_ratio or 1.0) ** 2
            for k, (column, inertia) in of_rotors.items()
        },
        starts=tuple(int(k) for k in np.concatenate([[0], np.cumsum(lengths)[:-1]])),
        temperature=temperature,
        rounding=_rounding(robot, signals),
        late=late,
        **_optional(signals),
    )


def _rounding(robot: Robot, signals: Signals) -> Array:
    """Return the speed over which the sign of a motor's velocity is rounded: where instants count, it is sharp."""
    if signals.rounded:
        return direction_widths(robot)
    slowest = np.maximum(signals.min_velocity / SHARP, SHARPEST)
    return np.asarray(np.minimum(direction_widths(robot), slowest))


def _optional(signals: Signals) -> dict[str, Any]:
    """Return the readings of the joint torque sensors that are used, where there are any; NaN at the other joints."""
    if signals.tau_link is None or not signals.sensed.any():
        return {}
    return {"tau_link": np.where(signals.sensed, _joined_rows(signals.tau_link, signals.segments), np.nan)}


def _whole(segments: Sequence[Segment], samples: int) -> bool:
    return len(segments) == 1 and segments[0].start == 0 and segments[0].stop == samples


def _joined_rows(values: Array, segments: Sequence[Segment]) -> Array:
    if _whole(segments, len(values)):
        return values
    return np.concatenate([values[s.start : s.stop] for s in segments])


def _joined(motion: Motion, segments: Sequence[Segment]) -> Motion:
    if _whole(segments, motion.samples):
        return motion
    return joined_motion([motion[s.start : s.stop] for s in segments])  # of splines, no more than these are evaluated


def _torques(
    model: Regressor,
    played: _Played,
    standard: Array,
    of_links: NDArray[np.intp],
    rotors: Mapping[int, tuple[int, float]],
) -> tuple[Array, Array]:
    """Return predicted motor torque, (N, n), and the link's share of it (what passes the transmission) of some joints.

    The share is (N, k). Where a rotor's inertia shows only in sums with the bodies', which any representative of the
    parameters divides as it likes, the rotor is the one told.
    """
    plan, n, motion = model.estimation, model.robot.n, played.motion
    program, place = plan.program.distinct
    known = np.nan_to_num(standard)
    weights = np.zeros((n + len(of_links), program.outputs))
    shares = {int(joint): n + number for number, joint in enumerate(of_links)}
    for item in plan.rows:
        if item.row.kind == "sum":
            k = item.row.joint
            np.add.at(weights[k], place[item.slots], known[item.columns])
            if k in shares:
                own = [model.names[c].joint == k and model.names[c].kind in MOTOR_PARAMETERS for c in item.columns]
                share = np.where(own, 0.0, known[item.columns])
                if k in rotors:
                    column, inertia = rotors[k]
                    share = np.where(item.columns == column, known[column] - inertia, share)
                np.add.at(weights[shares[k]], place[item.slots], share)
    torque = np.empty((motion.samples, len(weights)))
    for start in range(0, motion.samples, _CHUNK):
        part = slice(start, start + _CHUNK)
        rows = _run(program, motion[part]) if played.rows is None else played.rows[:, part]
        torque[part] = (weights @ rows).T
    return torque[:, :n], torque[:, n:]


def _rotors_in_sums(model: Regressor) -> dict[int, tuple[int, float]]:
    """Return column and inertia of the rotors that show only in sums, by joint, as far as the robot file knows them."""
    base, reference = find_base(model), model.robot.reference()
    found = {}
    for name in model.robot.rotor_names:
        column = model.index.get(name)
        if column is not None and base.classes.get(name) == "combined" and reference[column] > 0:
            found[name.joint] = (column, float(reference[column]))
    return found


def _open_rotors(model: Regressor, standard: Array, joints: NDArray[np.intp]) -> dict[int, float]:
    """Return the inertias at some joints where motion shows only sums: the robot file's, or else what is here."""
    base, reference, found = find_base(model), model.robot.reference(), dict[int, float]()
    for joint in joints.tolist():
        name = model.robot.rotor_names[joint]
        column = model.index.get(name)
        if column is not None and base.classes.get(name) == "combined":
            own = reference[column] if reference[column] > 0 else standard[column]
            found[joint] = float(own) * (model.robot.joints[joint].gear_ratio or 1.0) ** 2
    return found


class _Played(NamedTuple):
    """The motion of all segments of a log, one after the other, and the rows of a program along it, (rows, N)."""

    motion: Motion
    rows: Array | None
    """None where they are too large to be kept."""
    of: tuple[Signals, Program]


_PLAYED: Recent[_Played] = Recent(1)
"""What was asked for last: a search asks for the torques of many parameters in one motion."""


def _played(signals: Signals, program: Program) -> _Played:
    def made() -> _Played:
        motion = _joined(signals.motion, signals.segments)
        kept = motion.samples <= _KEPT_SAMPLES and program.outputs * motion.samples * 8 <= _KEPT
        return _Played(motion, _run(program, motion) if kept else None, (signals, program))

    return _PLAYED.of((id(signals), id(program)), made)


def _run(program: Program, motion: Motion) -> Array:
    rows = np.empty((program.outputs, motion.samples))
    program.run(inputs_of(motion, program), rows)
    return rows


def full_rate(effect: Effect, scene: Scene) -> dict[EstimationRow, Array]:
    """Return an effect's columns in the rows of estimation at the scene's instants, each (d, N)."""
    columns = {(str(key.side), key.joint): values for key, values in effect.columns(scene).items()}
    sensed: NDArray[np.bool_] | None = None
    if scene.tau_link is not None:
        sensed = np.array([np.isfinite(reading).any() for reading in scene.tau_link.T])
    return pair(columns, scene.robot, sensed, reading=effect.place == "sensor")


def extra_of(effect: Effect, scene: Scene, signals: Signals) -> ExtraColumns:
    """Return an effect's columns filtered and decimated as the equations are."""
    return _reduced(effect.name, full_rate(effect, scene), signals, tuple(p.unit for p in effect.amplitudes))


def _reduced(name: str, rows: Mapping[EstimationRow, Array], signals: Signals, units: tuple[str, ...]) -> ExtraColumns:
    samples = signals.motion.samples
    reduced, known = {}, dict[int, Array]()
    for row, values in rows.items():
        if id(values) in known:
            reduced[row] = known[id(values)]
            continue
        spread = values
        if not _whole(signals.segments, samples):
            spread = np.zeros((values.shape[0], samples))
            place = 0
            for segment in signals.segments:
                spread[:, segment.start : segment.stop] = values[:, place : place + len(segment)]
                place += len(segment)
        reduced[row] = known[id(values)] = signals.decimate(spread)
    return ExtraColumns(name, reduced, units)
