"""Logs as they are identified: read together, and their signals prepared."""

from __future__ import annotations

from elid_cli.estimation.request import LogRequest
from elid_cli.model.effects.declared import with_lost_effects
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare


def read_signals(request: LogRequest) -> tuple[Recording, Signals]:
    """Read logs together and prepare their signals.

    Raises
    ------
    LogError
        A log that cannot be used.
    DataError
        If no joint moves.
    """
    from elid_cli.logs import read_recording

    progress = request.progress
    recording = read_recording(
        request.logs, request.robot, request.mapping, strict=request.strict, rate=request.signals.rate,
        time_source=request.time,
        progress=None if progress is None else lambda share: progress("reading", share),
    )  # fmt: skip
    recording = with_lost_effects(recording, request.robot)
    if request.on_read is not None:
        request.on_read([recording], ())
    if progress is not None:
        progress("smoothing", 0.0)
    signals = prepare(recording, request.robot, request.signals.of_log(recording.rate))
    return signals.recording or recording, signals
