"""The gains of the drives that a pair of logs with a known payload tells, as a table and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from elid_cli.estimation.result import DriveGain
from elid_cli.report.answers.classification import verdict_mark
from elid_cli.report.answers.summary import spread_text
from elid_cli.report.tree import Cell, Column, Quantity, Section, Table

NOTE = (
    "torque at the joint, N·m (N), is the torque as the mapping gives it times the gain; not shown: by these two "
    "logs; the joint is then treated as one without torque"
)


def gains_table(gains: Sequence[DriveGain]) -> list[Section]:
    """Return the gains with their intervals; nothing where none was asked for."""
    columns = (
        Column("joint", "joint"),
        *Column.numbers(gain="gain", std_error="± sd"),
        Column("relative", "± sd", "%", align="right"),
        *Column.numbers(low="95 % from", high="to"),
        Column("verdict", "verdict"),
    )
    rows: list[tuple[Cell, ...]] = []
    for item in gains:
        if item.gain is None or item.std_error is None or item.interval is None:
            rows.append((item.joint, None, None, None, None, None, verdict_mark(item.verdict)))
            continue
        gain, deviation, low, high = (
            Quantity(value, resolution=item.std_error) for value in (item.gain, item.std_error, *item.interval)
        )
        share = spread_text(item.std_error, item.gain)
        rows.append((item.joint, gain, deviation, share, low, high, verdict_mark(item.verdict)))
    title = "gains of the drives, with standard errors"
    return [Table("drive_gains", columns, tuple(rows), title, note=NOTE)] if rows else []


def gains_payload(gains: Sequence[DriveGain]) -> dict[str, Any]:
    """Return the key ``drive_gains`` of JSON; nothing where none was asked for."""
    return {"drive_gains": gains} if gains else {}
