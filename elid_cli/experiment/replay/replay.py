"""Replay of a log: simulated under its commands, or its torque, from its first pose or restarted every few seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, number, optional, options_given, path, word
from elid_cli.errors import LogError, RobotError, UsageError
from elid_cli.estimation.trajectory.acting import (
    acting,
    can_act,
    declared,
    declared_fading,
    resisting,
    scene_along,
)
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.experiment.replay.errors import FARTHEST, PositionError, overall, position_errors
from elid_cli.model.drives import Joints
from elid_cli.model.effects.declared import is_soft_in_mjcf, resolve
from elid_cli.model.effects.of_drives import (
    LOOPS,
    declared_filters,
    declared_gains,
    declared_integrals,
    declared_loop_gains,
    declared_steps,
    holding,
)
from elid_cli.model.effects.posed import posed
from elid_cli.model.effects.shifts import declared_shifts
from elid_cli.model.linearised import Linearised, Local
from elid_cli.model.rollout import Added, Along, motion_of
from elid_cli.model.runs import Run, runs_of
from elid_cli.robot.mjcf.held import is_held
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.fitting_robot import check_fits
from elid_cli.signals.recording import Recording, with_commands
from elid_cli.tables import Shown

TORQUE_HORIZON = 0.5
"""Seconds after which a replay of torques starts again: without feedback the smallest error grows."""


_RULES = {
    "horizon": optional(number(above=0)),
    "engine": word("elid", "mujoco"),
    "mjcf": optional(path),
    "commands": optional(word("held", "smooth")),
}


@dataclass(frozen=True)
class ReplayOptions:
    """How to replay."""

    horizon: float | None = None
    """Seconds after which the simulation starts again from the measured state; None: once for every stretch of the
    log, or every `TORQUE_HORIZON` where torques drive it."""
    engine: Literal["elid", "mujoco"] = "elid"
    mjcf: str | None = None
    """With MuJoCo: an MJCF file that is simulated as it stands, in elid's steps of 1 ms, not the exported robot."""
    commands: Literal["held", "smooth"] | None = None
    """Whether commands are held for their sample, or change smoothly from one to the next; None: as the recording says,
    else held."""

    def __post_init__(self) -> None:
        """Refuse words that say nothing, and a horizon that is none (UsageError)."""
        check_fields(self, _RULES)


@dataclass(frozen=True, repr=False)
class Replay(Shown):
    """Simulated and measured motion of a log."""

    robot: Robot
    recording: Recording
    error: Mapping[str, PositionError]
    """Error of the measured positions by joint."""
    t: Array
    """Time of every replayed sample, s, (M,)."""
    measured: Array
    """Measured positions, rad (m), (M, n); NaN where a joint has none."""
    simulated: Array
    """Simulated positions, rad (m), (M, n); infinite where the simulation ran away."""
    horizon: float | None
    driven_by: Literal["commands", "torque"]
    engine: str
    left_out: tuple[str, ...] = ()
    """Declared effects that the replay does not hold."""
    mjcf: str | None = None
    """The file that MuJoCo simulated, where it did not simulate the exported robot."""

    @property
    def commands(self) -> Literal["held", "smooth", "interpolated"] | None:
        """What commands are taken to do between samples; None where torques drive the robot."""
        if self.driven_by == "torque" or self.recording.interpolated:
            return None if self.driven_by == "torque" else "interpolated"
        return "smooth" if self.recording.smooth else "held"

    @property
    def difference(self) -> Array:
        """Simulated minus measured positions, rad (m), (M, n)."""
        return self.simulated - self.measured

    @property
    def mean_abs(self) -> float:
        """Mean absolute error over all joints, rad (m)."""
        return overall(self.error)

    @property
    def lost(self) -> tuple[str, ...]:
        """Joints whose rms error is larger than what their measured motion is away from its mean.

        Those that ran away are among them: their errors are infinite.
        """
        spread = dict(zip(self.robot.joint_names, np.nanstd(self.measured, axis=0).tolist(), strict=True))
        return tuple(name for name, e in self.error.items() if not e.rms <= spread[name])


def pooled(replays: Sequence[Replay]) -> Mapping[str, PositionError]:
    """Return the errors of one robot over several logs together."""
    return position_errors(replays[0].robot, np.concatenate([item.difference for item in replays]))


def replay(robot: Robot, recording: Recording, options: ReplayOptions | None = None) -> Replay:
    """Replay a log with a described robot.

    Parameters
    ----------
    robot
        Its parameters must be known. Its offsets and delays of the drives take part, and the effects whose torque
        follows from the motion alone.
    recording
        A log with commands and gains, or with torques.
    options
        How.

    Raises
    ------
    RobotError
        Parameters that the motion depends on are unknown.
    LogError
        The log holds neither commands with gains nor torques, or no position of a joint.
    UsageError
        A horizon shorter than a few samples, MuJoCo is not installed, or an argument of another kind.
    """
    check_fits(recording, robot)
    options, robot = options_given("replay", options, ReplayOptions), posed(robot)
    by_commands = not np.isnan(recording.commands.get("q_des", np.full((1, robot.n), np.nan))).all(axis=0).any()
    horizon = options.horizon or (None if by_commands else TORQUE_HORIZON)
    if horizon is not None and horizon < 5 * recording.dt:
        raise UsageError(f"--horizon {horizon:g}: shorter than five samples of {recording.dt:g} s")
    _no_driving_friction(robot)
    offsets, left_out = _of_channels(robot, recording.dt)
    delays, gains, rates = declared_shifts(robot).torque, declared_gains(robot), declared_integrals(robot)
    times = declared_filters(robot)
    recording = with_commands(recording, options.commands, commanded=by_commands)
    runs = runs_of(recording, robot, horizon, delays, commanded=by_commands)
    if by_commands and rates.any():
        runs = [run.integrating(rates, delays) for run in runs]
    runs = [run.filtered(times) for run in runs] if by_commands and times.any() else runs
    often, steps = holding(robot, recording.dt), declared_steps(robot, recording.dt)
    runs = [run.stepping(*steps, delays) for run in runs] if by_commands and steps is not None else runs
    runs = [run.holding(often, delays) for run in runs] if by_commands and often.any() else runs
    tuned = declared_loop_gains(robot)
    runs = [run.tuned(tuned[0], tuned[1], delays) for run in runs] if by_commands and np.any(tuned != 1.0) else runs
    runs = [run.delivering(gains) for run in runs] if np.any(gains != 1.0) else runs
    if not runs:
        raise LogError("the log has no stretch that is long enough to be replayed")
    if options.engine == "mujoco":
        from elid_cli.experiment.replay.engine import mujoco_motion

        found = mujoco_motion(robot, runs, offsets, options.mjcf)
        left_out = _beyond_mujoco(robot, left_out)
    else:
        found = _motion(robot, runs, offsets)
    t = np.concatenate([run.t for run in runs])
    measured = np.concatenate([run.measured for run in runs])
    simulated = np.concatenate(found)
    simulated = np.where(
        np.abs(simulated - measured) < FARTHEST, simulated, np.where(np.isnan(measured), simulated, np.inf)
    )
    order = np.argsort(t, kind="stable")
    error = position_errors(robot, simulated[order] - measured[order])
    return Replay(
        robot, recording, error, t[order], measured[order], simulated[order], horizon,
        "commands" if by_commands else "torque", options.engine, left_out,
        options.mjcf if options.engine == "mujoco" else None,
    )  # fmt: skip


def _beyond_mujoco(robot: Robot, left_out: Sequence[str]) -> tuple[str, ...]:
    """Return the effects that MuJoCo's replay does not hold, from those that elid's does not: some are the model's."""
    held = [spec for spec in robot.effects if is_held(robot, spec) or is_soft_in_mjcf(robot, spec)]
    acting_here = (spec for spec in robot.effects if spec not in held and can_act(resolve(robot, spec)[0]))
    names = {_named(spec) for spec in held}
    return (*(name for name in left_out if name not in names), *map(_named, acting_here))


def _named(spec: EffectSpec) -> str:
    return f"{spec.effect} of {spec.joint}" if spec.joint else spec.effect


def _no_driving_friction(robot: Robot) -> None:
    """Refuse Coulomb friction that pushes (RobotError): no joint comes to rest under it."""
    for place, joint in enumerate(robot.joints, start=1):
        if joint.parameters.get("fs", 0.0) < 0:
            raise RobotError(f"{robot.name}: fs{place} of {joint.name} is {joint.parameters['fs']:g}: friction brakes",
                             hint="it must not be negative to be simulated")  # fmt: skip


def _motion(robot: Robot, runs: list[Run], offsets: Array) -> list[Array]:
    """Return the simulated positions of the runs, those of one length side by side."""
    equations = Linearised(robot, without=PARAMETERS)  # what a rotor needs is no load of its transmission
    own = robot.reference()
    names = robot.parameter_names()

    def of(kind: str) -> Array:
        values = {name.joint: float(v) for name, v in zip(names, own, strict=True) if name.kind == kind}
        return np.nan_to_num([[values.get(k, 0.0) for k in range(robot.n)]])

    fading = declared_fading(robot)
    coulomb = of("fs") if fading is None else np.maximum(of("fs") - fading.friction, 0.0)
    joints = Joints(of("Ja"), coulomb, of("fv"), offsets[None], fading=fading)
    found: dict[int, Array] = {}
    lengths: dict[int, list[int]] = {}
    for k, run in enumerate(runs):
        lengths.setdefault(len(run.t), []).append(k)
    for numbers in lengths.values():
        together = Run.together([runs[k] for k in numbers])
        x, _ = motion_of(
            equations, together.start, together.near, together.drives, joints, together.dt,
            _along(robot, together.dt / together.finer, len(together.t) * together.finer), together.finer,
        )  # fmt: skip
        for place, k in enumerate(numbers):
            found[k] = x[:, place][:, : robot.n]
    return [found[k] for k in range(len(runs))]


def _along(robot: Robot, dt: float, samples: int) -> Along | None:
    """Return what the robot's effects add along a motion; None where it declares none that a motion can hold."""
    kinds = ((spec, resolve(robot, spec)[0]) for spec in robot.effects)
    specs = [spec for spec, kind in kinds if can_act(kind) and not kind.softens]
    if not specs:
        return None
    parameters = robot.reference()

    def total(local: Local, x: Array, v: Array) -> Array:
        """Return push and grip of all stretches, (2, N, S, m)."""
        both = np.zeros((2, *x.shape))
        for k in range(x.shape[1]):
            own = replace(local.stretch(k), finer=1)
            scene = scene_along(robot, x[:, k], v[:, k], own, dt, parameters, samples)
            known = [found for spec in specs if (found := declared(robot, spec, scene)) is not None]
            done = acting([effect for effect, _ in known], scene)
            both[0, :, k], both[1, :, k] = done.total(np.concatenate([amplitudes for _, amplitudes in known]))
        return both

    def added(local: Local, x: Array, v: Array) -> Added:
        here = total(local, x, v)
        push, grip = (0.5 * (part[1:] + part[:-1])[:, None] for part in here)
        return Added(push, grip, *resisting(lambda *moved: total(local, *moved)[0], x, v))

    return added


def _of_channels(robot: Robot, dt: float) -> tuple[Array, tuple[str, ...]]:
    """Return the torque offsets that the robot declares, N·m (N), (n,), and effects left out."""
    offsets, left, holds = np.zeros(robot.n), [], holding(robot, dt)
    stepping = declared_steps(robot, dt) is not None
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        other = (kind.of_drive == "hold" and not holds[joint]) or (kind.of_drive == "step" and not stepping)
        if other:  # of a time that is no part of the log's samples
            left.append(_named(spec))
        if kind.nuisance == "offset":
            offsets[joint] = next(iter(spec.parameters.values()))
        elif not (kind.of_drive in ("gain", *LOOPS) or kind.corrects or kind.of_channel or can_act(kind)):
            left.append(_named(spec))
    return offsets, tuple(left)
