"""From what the user typed to what the core takes: robot, logs, signals; with what must be said on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from elid_cli.cli.options import LOCK, TIP, Output, Reading, Source, Spread
from elid_cli.cli.output import note
from elid_cli.signals.options import SignalOptions

if TYPE_CHECKING:
    from elid_cli._types import Progress
    from elid_cli.estimation.request import LogRequest
    from elid_cli.robot.robot import Robot
    from elid_cli.signals.recording import Recording
    from elid_cli.signals.signals import Signals


def load_robot(source: str, *, any_size: bool = False) -> Robot:
    """Return the robot that ``--robot`` names, its declared effects known to the library.

    What its description leaves open is decided by ``--tip``, ``--lock`` and the logs of the command, and told. A robot
    of more joints than can be identified together is refused, unless it may be of `any_size`.
    """
    from elid_cli.logs import read_map_options, robot_as_logged
    from elid_cli.logs.mapping.language import parse_mapping
    from elid_cli.model.effects.declared import check_effects
    from elid_cli.robot.built import check_size
    from elid_cli.robot.files import read_robot
    from elid_cli.robot.locking import beside_chain

    context = click.get_current_context()
    given, meta = context.params, context.meta
    robot = check_effects(read_robot(source))
    parse_mapping(robot.log, robot, f"{source}: log")
    tip = meta.get(TIP)
    held = dict.fromkeys(beside_chain(robot, tip) if tip else (), 0.0) | dict(meta.get(LOCK) or ())
    logs = [str(log) for log in (*(given.get("logs") or given.get("recordings") or ()), given.get("after")) if log]
    held = dict.fromkeys(_not_reduced(robot, logs), 0.0) | held
    robot = robot_as_logged(robot, logs, read_map_options(given.get("maps") or ()) or None, held)
    if not any_size:
        check_size(robot, source)
    note(robot.notes, Output(json=bool(given.get("json")), quiet=bool(given.get("quiet"))))
    return robot


def _not_reduced(robot: Robot, logs: Sequence[str]) -> list[str]:
    """Return the joints that reduced logs were made without, where there are no others: they were locked then."""
    from elid_cli.estimation.streaming.stored import is_triangle_file

    if not (robot.source and logs and all(is_triangle_file(log) for log in logs)):
        return []
    from elid_cli.estimation.streaming.files import read_triangles

    known = {joint for log in logs for part in read_triangles(log) for joint in part.recording.joints}
    absent = [name for name in robot.joint_names if name not in known]
    return absent if len(absent) < robot.n else []


def mapping_of(reading: Reading, *, others: bool = False) -> dict[str, Any] | None:
    """Return where the log keeps its signals and what is left out of it, as the options say; None: they say nothing.

    Of `others` than the command's own logs nothing is left out.
    """
    from elid_cli.logs import read_map_options
    from elid_cli.logs.mapping.left_out import KEY, left_out_of

    gains = {name: {"value": value} for name, value in (("kp", reading.kp), ("kd", reading.kd)) if value is not None}
    mapping = read_map_options(reading.maps) | gains
    if others:
        mapping.pop(KEY, None)
    elif reading.leave_out:
        mapping[KEY] = list(map(list, (*left_out_of(mapping, 1), *reading.leave_out)))
    given = click.get_current_context().params
    left_out_of(mapping, len(given.get("logs") or given.get("recordings") or ()))
    return mapping or None


def load_recording(
    logs: Sequence[str],
    robot: Robot,
    reading: Reading,
    output: Output,
    rate: float | None = None,
    progress: Progress | None = None,
    label: str = "",
    *,
    others: bool = False,
) -> Recording:
    """Read the logs as the robot's signals; `rate` (Hz) is for one that holds no time.

    What was repaired and what looks wrong goes to stderr, after a `label` where there is one. `others` are not the
    command's own logs: what is left out of those is not left out of them.
    """
    from elid_cli.logs import read_recording
    from elid_cli.memory import keep_freed_memory
    from elid_cli.model.effects.declared import with_lost_effects
    from elid_cli.signals.recording import unique_notices

    keep_freed_memory()
    recording = read_recording(
        logs, robot, mapping_of(reading, others=others), strict=reading.strict, rate=rate, time_source=reading.time,
        progress=None if progress is None else lambda share: progress("reading", share),
    )  # fmt: skip
    recording = with_lost_effects(recording, robot)
    note(unique_notices([(label, recording.repairs)]), output, "repaired")
    note(unique_notices([(label, recording.warnings)]), output, "warning")
    _tell_unused_gains(reading, [recording], output)
    return recording


def _tell_unused_gains(reading: Reading, recordings: Sequence[Recording], output: Output) -> None:
    """Note that gains are not used where no log holds commands that they could act on."""
    if (reading.kp or reading.kd) and recordings and not any(_commanded(one) for one in recordings):
        note(["--kp and --kd are not used: no log holds commanded positions (q_des)"], output)


def _commanded(recording: Recording) -> bool:
    """Whether a log held commanded positions; of a reduced one its torques say so."""
    from elid_cli.signals.recording import joints_computed

    torque = recording.sources.get("tau", "")
    return "q_des" in recording.commands or bool(joints_computed(torque, recording.joints).any())


def read_source(source: Source, robot: Robot, output: Output, progress: Progress | None) -> tuple[Recording, Signals]:
    """Read the logs, and filter and decimate them as a diagnosis needs it."""
    recording = load_recording(source.logs, robot, source.reading, output, source.conditioning.rate, progress)
    signals = load_signals(recording, robot, sharp(source.conditioning, recording), progress)
    return signals.recording or recording, signals


def load_signals(recording: Recording, robot: Robot, options: SignalOptions, progress: Progress | None) -> Signals:
    """Filter and decimate a recording as the options say."""
    from elid_cli.estimation.smooth_commands import as_told
    from elid_cli.signals.signals import prepare

    if progress is not None:
        progress("smoothing", 0.0)
    return as_told(robot, prepare(recording, robot, options.of_log(recording.rate)))


def sharp(options: SignalOptions, recording: Recording) -> SignalOptions:
    """Return the options that diagnose and validate share; a cut-off that the user chose stands."""
    shared = SignalOptions.for_diagnosis(recording.rate)
    cutoff = shared.cutoff if options.cutoff is None else options.cutoff
    return replace(options, cutoff=cutoff, slow_motion=shared.slow_motion)


def log_request(source: Source, robot: Robot, spread: Spread, output: Output, progress: Progress | None) -> LogRequest:
    """Return the request for what was typed; what was repaired and what looks wrong goes to stderr as logs are read."""
    from elid_cli.estimation.request import LogRequest
    from elid_cli.memory import keep_freed_memory
    from elid_cli.signals.recording import notices_of, repeated, unique_notices

    keep_freed_memory()

    def on_read(read: Sequence[Recording], every: Sequence[Recording]) -> None:
        for word, kind in (("repaired", "repairs"), ("warning", "warnings")):
            together = len(every) > 1
            said = notices_of(read, kind) if together else unique_notices(("", getattr(part, kind)) for part in read)
            note(said, output, word)
        _tell_unused_gains(source.reading, every or read, output)
        note(repeated([f for r in every for f in r.files], [d for r in every for d in r.sha256]), output, "warning")

    return LogRequest(
        source.logs, robot, source.conditioning, mapping_of(source.reading), source.reading.strict,
        source.reading.time, spread.jobs, spread.scheduler, on_read, progress,
    )  # fmt: skip


def samples_of(source: Source, robot: Robot, output: Output, progress: Progress | None) -> Signals | None:
    """Return the signals of the logs for figures, or None (and say so) where only their triangles are at hand."""
    from elid_cli.estimation.streaming.stored import is_triangle_file

    if any(is_triangle_file(log) for log in source.logs):
        note(["no figures of torques: reduced logs hold no samples"], output)
        return None
    quiet, options = replace(output, quiet=True), source.conditioning
    recording = load_recording(source.logs, robot, source.reading, quiet, options.rate)
    return load_signals(recording, robot, options, progress)


def check_effects(names: Sequence[str]) -> None:
    """Refuse the name of an effect that elid does not know (UsageError)."""
    from elid_cli.errors import UsageError, did_you_mean
    from elid_cli.model.effects import effect_classes
    from elid_cli.model.effects.kinds import CurveEffect

    for name in names:
        if name not in effect_classes():
            raise UsageError(f"--only: no effect {name!r}", hint=did_you_mean(name, effect_classes()))
        kind = effect_classes()[name]
        if not (kind.searched or kind.moves_zero or kind.of_drive):
            smooth = issubclass(kind, CurveEffect)
            hint = f"use --{name}" if smooth else "elid friction compares it with other forms of friction"
            raise UsageError(f"{name} is a curve, not an effect to search for", hint=hint)
