"""Several logs of one machine: what its drives were told between samples is decided for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from elid_cli.errors import first_of
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.streaming.fleet import reduced_logs
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.logs.mapping.resolve import RATE

NAMED = 6
"""Logs that a note names."""


def told_alike(
    request: LogRequest, logs: list[ReducedLog]
) -> tuple[LogRequest, list[ReducedLog], tuple[str, ...]]:  # fmt: skip
    """Return the request that asks for what was decided of most logs, logs that have it, and a note where they differ.

    Commands are smooth where they are in most logs, and drives are told rates where one log clearly shows that.
    Triangle files stay as they are: what is merged refuses them where they differ.
    """
    told = [log for log in logs if log.facts.computed.all()]
    smooth, rates = [bool(log.recording.smooth) for log in told], [_has_rates(log) for log in told]
    if not (any(smooth) or any(rates)) or any(log.origin for log in logs):
        return request, logs, ()
    notes = []
    if any(smooth):
        most: Literal["held", "smooth"] = "smooth" if 2 * sum(smooth) > len(smooth) else "held"
        request = replace(request, signals=replace(request.signals, commands=most))
        odd = [log for log, own in zip(told, smooth, strict=True) if own != (most == "smooth")]
        if odd:
            notes.append(f"commands are taken as {most} in all logs; by themselves {_named(odd)} would be taken the "
                         "other way (--commands decides)")  # fmt: skip
    if any(rates):
        request = replace(request, mapping={**(request.mapping or {}), "dq_des": {"from": RATE}})
    if notes or (not all(rates) and any(rates)):
        logs = reduced_logs(replace(request, on_read=None))
    return request, logs, tuple(notes)


def _has_rates(log: ReducedLog) -> bool:
    return log.recording.sources.get("dq_des") == RATE


def _named(logs: Sequence[ReducedLog]) -> str:
    return first_of([log.name for log in logs], NAMED)
