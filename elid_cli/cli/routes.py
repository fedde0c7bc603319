"""Logs and triangle files, in any mixture, as reduced logs; and when identification goes that way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import click

from elid_cli.cli import options
from elid_cli.cli.inputs import load_recording, load_signals
from elid_cli.cli.options import Conditioning, FitOptions, Output, Reading, Spread
from elid_cli.cli.output import note, pictures_wanted
from elid_cli.errors import UsageError

if TYPE_CHECKING:
    from elid_cli._types import Progress
    from elid_cli.estimation.result import Identification
    from elid_cli.estimation.streaming.reduced_log import ReducedLog
    from elid_cli.estimation.validation.prediction import ByLog
    from elid_cli.robot.robot import Robot
    from elid_cli.signals.recording import Recording
    from elid_cli.signals.signals import Signals

spread = options.gathered(
    "spread", Spread,
    options.option(options.INPUT, "--jobs", type=click.IntRange(min=1), default=1, metavar="N",
                   help="Processes that read several logs at once."),
    options.option(options.INPUT, "--scheduler", metavar="ADDRESS",
                   help="Dask scheduler whose workers read the logs: tcp://host:8786."),
)  # fmt: skip


def reduced_logs(
    logs: Sequence[str],
    robot: Robot,
    reading: Reading,
    conditioning: Conditioning,
    spread: Spread,
    output: Output,
    progress: Progress | None,
) -> list[ReducedLog]:
    """Return the logs reduced, those of triangle files as they are; what was repaired goes to stderr."""
    from elid_cli.estimation.streaming.files import is_triangle_file, read_triangles
    from elid_cli.estimation.streaming.fleet import Job, reduce_jobs
    from elid_cli.logs import read_map_options
    from elid_cli.memory import keep_freed_memory
    from elid_cli.robot.text import text_of
    from elid_cli.signals.recording import notices_of, repeated

    keep_freed_memory()
    mapping = read_map_options(reading.maps) or None
    wish = asdict(conditioning)
    text = text_of(robot)
    stored = {log: read_triangles(log) for log in logs if is_triangle_file(log)}
    jobs = [
        Job(log, text, robot.name, mapping, reading.strict, reading.time, wish) for log in logs if log not in stored
    ]
    tell = None if progress is None else lambda share: progress("reducing", share)
    made = iter(reduce_jobs(jobs, spread.jobs, spread.scheduler, tell))
    found: list[ReducedLog] = []
    for log in logs:
        found += stored[log] if log in stored else [next(made)]
    _check_options(found, conditioning)
    read = [log_.recording for log_ in found if not all(f in stored for f in log_.recording.files)]
    for word, kind in (("repaired", "repairs"), ("warning", "warnings")):
        named = notices_of(read, kind) if len(found) > 1 else [line for part in read for line in getattr(part, kind)]
        note(named, output, word)
    every = [log.recording for log in found]
    note(repeated([f for r in every for f in r.files], [d for r in every for d in r.sha256]), output, "warning")
    return found


@dataclass(frozen=True)
class IdentifyRequest:
    """What the user asked to be identified, and how."""

    logs: Sequence[str]
    robot: Robot
    reading: Reading
    conditioning: Conditioning
    fit: FitOptions
    spread: Spread
    output: Output
    progress: Progress | None


class Identified(NamedTuple):
    """What was found, from what, how it fits each log, and the signals where they are at hand."""

    found: Identification
    recording: Recording
    apart: tuple[ByLog, ...]
    signals: Signals | None


def from_triangles(asked: IdentifyRequest) -> Identified:
    """Identify from logs reduced one by one."""
    from elid_cli.estimation.streaming.merge import identify_reduced, joined_recording

    logs = reduced_logs(
        asked.logs, asked.robot, asked.reading, asked.conditioning, asked.spread, asked.output, asked.progress
    )
    found, apart = identify_reduced(asked.robot, logs)
    return Identified(found, joined_recording(logs), apart, None)


def from_samples(asked: IdentifyRequest) -> Identified:
    """Identify from all logs read at once; a long one is reduced block by block."""
    from elid_cli.estimation.identify import EstimateOptions, identify
    from elid_cli.estimation.refined_robot import identified_robot
    from elid_cli.estimation.validation.prediction import errors_by_log

    recording = load_recording(
        asked.logs, asked.robot, asked.reading, asked.output, asked.conditioning.rate, asked.progress
    )
    signals = load_signals(recording, asked.robot, asked.conditioning, asked.progress)
    if not whole_log_needed(asked.robot, asked.fit) and is_long(signals, asked.robot):
        from elid_cli.estimation.streaming.merge import identify_reduced
        from elid_cli.estimation.streaming.reduced_log import without_positions

        shown = pictures_wanted(asked.output)
        if not shown:
            recording = without_positions(recording)
            signals = replace(signals, recording=recording)
        reduced = reduced_signals(signals, recording, asked.robot, asked.conditioning, asked.progress)
        found, _ = identify_reduced(asked.robot, [reduced])
        return Identified(found, reduced.recording, (), signals if shown else None)
    found = identify(asked.robot, signals, EstimateOptions(estimator=asked.fit.estimator, accurate=asked.fit.accurate))
    apart = errors_by_log(identified_robot(found), signals, recording.files)
    return Identified(found, recording, apart, signals)


def samples_of(asked: IdentifyRequest) -> Signals | None:
    """Return the signals of the logs for figures, or None (and say so) where only their triangles are at hand."""
    from elid_cli.estimation.streaming.files import is_triangle_file

    if any(is_triangle_file(log) for log in asked.logs):
        note(["no figures of torques: triangles hold no samples"], asked.output)
        return None
    quiet = replace(asked.output, quiet=True)
    recording = load_recording(asked.logs, asked.robot, asked.reading, quiet, asked.conditioning.rate)
    return load_signals(recording, asked.robot, asked.conditioning, asked.progress)


def whole_log_needed(robot: Robot, fit: FitOptions) -> str:
    """Return why triangles do not suffice for what was asked, or nothing where they do."""
    if fit.accurate:
        return "--accurate estimates the trajectory from the samples"
    if fit.estimator != "default":
        return f"--estimator {fit.estimator} starts from the samples"
    if robot.effects:
        return f"{robot.name} declares effects, whose shapes are fitted to the samples"
    return ""


def merges(logs: Sequence[str], robot: Robot, fit: FitOptions) -> bool:
    """Return whether these logs are reduced one by one and merged: several of them, or triangle files among them.

    Raises
    ------
    UsageError
        A triangle file where the samples are needed.
    """
    from elid_cli.estimation.streaming.files import is_triangle_file

    reason = whole_log_needed(robot, fit)
    stored = [log for log in logs if is_triangle_file(log)]
    if stored and reason:
        raise UsageError(f"{stored[0]}: triangles do not suffice", detail=reason, hint="name the logs themselves")
    return not reason and (len(logs) > 1 or bool(stored))


LONG = 64 << 20
"""Bytes of filtered columns above which one log, too, is reduced block by block."""


def is_long(signals: Signals, robot: Robot) -> bool:
    """Return whether a log's filtered columns would take much memory."""
    from elid_cli.model.regressor import Regressor

    return len(signals.outputs) * Regressor(robot).estimation.program.outputs * 8 > LONG


def reduced_signals(
    signals: Signals, recording: Recording, robot: Robot, conditioning: Conditioning, progress: Progress | None
) -> ReducedLog:
    """Return one log reduced, whose signals are at hand."""
    from elid_cli.estimation.streaming.reduce import reduce_log

    tell = None if progress is None else lambda share: progress("reducing", share)
    return reduce_log(robot, signals, recording, asdict(conditioning), tell)


def _check_options(found: Sequence[ReducedLog], conditioning: Conditioning) -> None:
    """Refuse options on the command line that stored triangles were not made with (UsageError)."""
    for key, value in asdict(replace(conditioning)).items():
        if value == getattr(Conditioning(), key):
            continue
        for log in found:
            if log.options.get(key) != value:
                made = log.options.get(key)
                raise UsageError(
                    f"{log.name}: reduced with another {key.replace('_', '-')}",
                    detail=f"{'chosen from the log' if made is None else made} when it was reduced, {value} now",
                    hint="reduce the log again, or leave the option out",
                )
