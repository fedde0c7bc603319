"""Several logs and triangle files: who reads them, and from what was typed to what the core is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from elid_cli.cli import options
from elid_cli.cli.inputs import load_recording, load_signals, mapping_of
from elid_cli.cli.options import Output, Source, Spread
from elid_cli.cli.output import note

if TYPE_CHECKING:
    from elid_cli._types import Progress
    from elid_cli.estimation.request import LogRequest
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
        note(repeated([f for r in every for f in r.files], [d for r in every for d in r.sha256]), output, "warning")

    return LogRequest(
        source.logs, robot, source.conditioning, mapping_of(source.reading), source.reading.strict,
        source.reading.time, spread.jobs, spread.scheduler, on_read, progress,
    )  # fmt: skip


def samples_of(source: Source, robot: Robot, output: Output, progress: Progress | None) -> Signals | None:
    """Return the signals of the logs for figures, or None (and say so) where only their triangles are at hand."""
    from elid_cli.estimation.streaming.files import is_triangle_file

    if any(is_triangle_file(log) for log in source.logs):
        note(["no figures of torques: reduced logs hold no samples"], output)
        return None
    quiet, options = replace(output, quiet=True), source.conditioning
    recording = load_recording(source.logs, robot, source.reading, quiet, options.rate)
    return load_signals(recording, robot, options, progress)
