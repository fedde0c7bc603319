"""Which logs are to be identified, and how they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from elid_cli._types import Progress
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording


@dataclass(frozen=True)
class LogRequest:
    """Logs to read, and how."""

    logs: Sequence[str]
    """Log files, folders, triangle files, or ``-`` for CSV on standard input."""
    robot: Robot
    signals: SignalOptions = field(default_factory=SignalOptions)
    mapping: Mapping[str, Any] | None = None
    strict: bool = False
    """Refuse a damaged log instead of using what is whole."""
    time: str = "auto"
    """Clock of an MCAP log: auto, header or log."""
    jobs: int = 1
    """Processes that read several logs at once."""
    scheduler: str | None = None
    """Dask scheduler whose workers read the logs."""
    on_read: Callable[[Sequence[Recording], Sequence[Recording]], None] | None = None
    """Told what was read, and all logs with those of triangle files, before anything is estimated."""
    progress: Progress | None = None

    def told_as(self, recording: Recording) -> LogRequest:
        """Return a request for the same logs that takes commands as they were taken in what was read of it."""
        decided: Literal["held", "smooth"] = "smooth" if recording.smooth else "held"
        signals = self.signals if recording.smooth is None else replace(self.signals, commands=decided)
        rates = recording.sources.get("dq_des") == RATE
        mapping = {**(self.mapping or {}), "dq_des": {"from": RATE}} if rates else self.mapping
        return replace(self, signals=signals, mapping=mapping)
