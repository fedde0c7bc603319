"""Which logs are to be identified, and how they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from elid_cli._types import Progress
from elid_cli.checks import check_fields, flag, of_kind, optional, options_given, path, several, text, whole, word
from elid_cli.errors import UsageError
from elid_cli.estimation.result import EstimateOptions
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import is_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording

_RULES = {
    "logs": several(path, "logs"),
    "robot": is_robot,
    "signals": of_kind(SignalOptions, "SignalOptions(...), or leave it out"),
    "mapping": optional(of_kind(Mapping, "read_map_options makes one of what --map takes")),
    "strict": flag,
    "time": word("auto", "header", "log"),
    "jobs": whole(1),
    "scheduler": optional(text),
}


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

    def __post_init__(self) -> None:
        """Refuse what names no logs, robot or way of reading (UsageError)."""
        check_fields(self, _RULES)

    def told_as(self, recording: Recording) -> LogRequest:
        """Return a request for the same logs that takes commands as they were taken in what was read of it."""
        decided: Literal["held", "smooth"] = "smooth" if recording.smooth else "held"
        signals = self.signals if recording.smooth is None else replace(self.signals, commands=decided)
        rates = recording.sources.get("dq_des") == RATE
        mapping = {**(self.mapping or {}), "dq_des": {"from": RATE}} if rates else self.mapping
        return replace(self, signals=signals, mapping=mapping)


def estimate_options(where: str, options: EstimateOptions | None, robot: Robot) -> EstimateOptions:
    """Return how to estimate, as `options_given`; of joints that the robot has (UsageError)."""
    options = options_given(where, options, EstimateOptions)
    beyond = next((joint for joint in options.declared_late if joint >= robot.n), None)
    if beyond is not None:
        raise UsageError(
            f"EstimateOptions: declared_late: {robot.name!r} has no joint {beyond}",
            hint=f"joints are counted from 0: 0 to {robot.n - 1}",
        )
    return options
