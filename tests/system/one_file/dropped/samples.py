"""Logs of a first line ``samples`` and one JSON object per line: ``t`` and signals by joint. Dropped by a test."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from elid_cli.errors import LogError
from elid_cli.logs.contract import Channel, LogFormat, Pick, Stream
from elid_cli.logs.mapping.language import COMMANDS
from elid_cli.logs.source import Source
from elid_cli.signals.recording import INERTIAL, Recording

SIGNALS = ("q", "theta", "tau")


class SampleLines:
    """One text of lines."""

    def __init__(self, source: Source) -> None:
        try:
            self._rows = [_row(line) for line in source.read().decode().splitlines()[1:]]
            first = self._rows[0]
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise LogError(f"{source.name}: its lines are no samples", detail=str(error)) from error
        self.channels = tuple(Channel(s, width=len(first[s]), labels=tuple(first[s])) for s in SIGNALS if s in first)
        self.losses: list[str] = []
        self.notes: list[str] = []

    @property
    def canonical(self) -> Sequence[Mapping[str, Any]]:
        return [{signal: {"from": signal} for signal in SIGNALS}]

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        t = np.array([row["t"] for row in self._rows])
        labels = {channel.source: channel.labels for channel in self.channels}
        named = [[c if isinstance(c, str) else labels[p.source][c] for c in p.columns] for p in picks]
        values = [
            np.array([[row.get(p.source, {}).get(c, np.nan) for c in columns] for row in self._rows])
            for p, columns in zip(picks, named, strict=True)
        ]
        return [Stream(found, {"t": t}) for found in values]


def _row(line: str) -> dict[str, Any]:
    """Return the numbers of a line; a ValueError or the like where it holds others."""
    row = json.loads(line)
    return {"t": float(row["t"]), **{s: {k: float(v) for k, v in row[s].items()} for s in SIGNALS if s in row}}


def write(recording: Recording, name: str) -> bytes:
    lines = ["samples"]
    for k, t in enumerate(recording.t.tolist()):
        signals = {s: getattr(recording, s)[k].tolist() for s in SIGNALS}
        named = {s: dict(zip(recording.joints, values, strict=True)) for s, values in signals.items()}
        lines.append(json.dumps({"t": t, **named}))
    return "\n".join(lines).encode()


FORMAT = LogFormat(
    name="samples",
    suffixes=(".samples",),
    recognise=lambda source: source.head.startswith(b"samples"),
    open=lambda source: [SampleLines(source)],
    write=write,
    lacks=("dq", "dtheta", "tau_link", "temperature", *INERTIAL, *COMMANDS),
)
