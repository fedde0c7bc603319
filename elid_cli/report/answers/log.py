"""The answer of ``elid plot``: what a log looks like before anything is fitted to it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from elid_cli.report.answers.inputs import command, heading, log_payload, recorded_items, robot_payload
from elid_cli.report.answers.summary import listed
from elid_cli.report.figures.plots.signals import gaps, sizes
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, warned
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording


def log_report(recording: Recording, robot: Robot, robot_argument: str | None) -> Report:
    """Return the report on a recording; `robot_argument` is what ``--robot`` was given, None for a guessed robot."""
    moved = {joint.name: sizes(recording, joint, k) for k, joint in enumerate(robot.joints)}
    payload: dict[str, Any] = {
        **robot_payload(robot),
        "log": log_payload(recording),
        "moved": moved,
        "gaps": gaps(recording),
    }
    if robot_argument is None:
        payload |= {"robot": None, "robot_fingerprint": None}
    line = shlex.join(["elid", "info", *recording.files])
    if robot_argument is not None:
        line = command("identify", recording, robot_argument)
    sections: list[Section] = [
        heading(robot, recording),
        Text("answer", _answer(recording, robot, moved)),
        KeyValues("inputs", recorded_items(robot, recording)),
        *warned(recording.warnings),
        _table(robot, moved),
        Text("next", line, "next"),
    ]
    return Report("plot", payload, tuple(sections))


STILL = 1e-3
"""rad (m) of range below which a joint stands still."""


def _answer(recording: Recording, robot: Robot, moved: Mapping[str, Mapping[str, Any]]) -> str:
    """Return which joints move, and how much of the log is missing or was repaired, in a sentence."""
    still = [name for name, size in moved.items() if size["most"] - size["least"] < STILL]
    move = f"{listed(still)} {'stands' if len(still) == 1 else 'stand'} still; the others move" if still else (
        f"All {robot.n} joints move" if robot.n > 1 else "The joint moves")  # fmt: skip
    holes, repairs = len(gaps(recording)), len(recording.repairs)
    gap = f"{holes} gap{'s' * (holes > 1)}" if holes else "no gap"
    mended = f"{repairs} repair{'s' * (repairs > 1)}, listed below" if repairs else "nothing was repaired"
    return f"{move}. The log of {number_text(recording.duration, 3)} s has {gap}; {mended}."


def _table(robot: Robot, moved: dict[str, dict[str, Any]]) -> Table:
    columns = (
        Column("joint", "joint"),
        *Column.numbers(least="from", most="to", speed="speed, 99 %", torque="torque rms", deflection="deflection rms"),
    )
    rows: list[tuple[Cell, ...]] = []
    for joint in robot.joints:
        unit, torque = joint.units
        size = moved[joint.name]
        deflection = None if size["deflection"] is None else 1e3 * size["deflection"]
        rows.append(
            (
                joint.name,
                Quantity(size["least"], unit, 3),
                Quantity(size["most"], unit, 3),
                Quantity(size["speed"], f"{unit}/s", 3),
                Quantity(size["torque"], torque, 3),
                Quantity(deflection, f"m{unit}", 3),
            )
        )
    return Table("moved", columns, tuple(rows), title="how the joints moved")
