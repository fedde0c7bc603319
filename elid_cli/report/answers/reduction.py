"""The answer of ``elid reduce``: what was written of which logs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.report.answers.inputs import heading, log_payload, recorded_items, robot_payload
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Table, Text, number_text
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording


def reduction_report(
    robot: Robot, logs: Sequence[ReducedLog], recording: Recording, robot_argument: str, file: str
) -> Report:
    """Return the report of a reduction.

    Parameters
    ----------
    robot, logs, recording
        What was reduced.
    robot_argument, file
        What ``--robot`` and ``-o`` were given.
    """
    size = Path(file).stat().st_size
    instants = sum(log.facts.instants for log in logs)
    facts: tuple[tuple[str, Cell], ...] = (
        *recorded_items(robot, recording),
        ("reduced", f"{instants} samples at {number_text(logs[0].facts.rate, 4)} Hz, "
                    f"zero-phase low-pass {number_text(logs[0].facts.cutoff, 4)} Hz"),
        ("written", f"{file}, {number_text(size / 1e3, 3)} kB"),
    )  # fmt: skip
    payload = {
        **robot_payload(robot),
        "log": log_payload(recording),
        "file": file,
        "instants": [log.facts.instants for log in logs],
        "options": dict(logs[0].options),
    }
    columns = (
        Column("file", "log"),
        Column("duration", "duration", "s", "right"),
        Column("instants", "samples", align="right"),
    )
    rows: list[tuple[Cell, ...]] = [
        (", ".join(log.recording.files), Quantity(log.recording.duration, digits=4), log.facts.instants) for log in logs
    ]
    following = shlex.join(["elid", "identify", file, "--robot", robot_argument])
    table = (Table("logs", columns, tuple(rows), shown=20),) if len(logs) > 1 else ()
    return Report(
        "reduce",
        payload,
        (heading(robot, recording), KeyValues("facts", facts), *table, Text("next", following, "next")),
    )
