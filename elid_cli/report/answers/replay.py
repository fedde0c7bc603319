"""The answer of ``elid replay``: how far the simulated robot moves from the measured one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from elid_cli.experiment.replay.errors import PositionError, overall, runaways
from elid_cli.experiment.replay.replay import TORQUE_HORIZON, Replay, pooled
from elid_cli.report import tree
from elid_cli.report.answers.inputs import log_payload, robot_payload
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, picked
from elid_cli.robot.position_words import mean_words, small_unit
from elid_cli.robot.robot import Robot

SHORT_HORIZON = 0.1
"""s; where even this short a replay runs away, the robot file is wrong."""


def replay_report(replays: Sequence[Replay], against: Sequence[Replay] = (), names: Sequence[str] = ("", "")) -> Report:
    """Return the report of a replay of several logs.

    Parameters
    ----------
    replays
        One per log.
    against
        The same logs with another robot, if any.
    names
        Both robots as the user named them.
    """
    first, error = replays[0], pooled(replays)
    before = pooled(against) if against else None
    robot = first.robot
    sections: list[Section] = [
        Text("title", f"{robot.name} · {', '.join(item.recording.files[0] for item in replays)}", "heading"),
        KeyValues("answers", (("how far off?", _sentence(robot, error, before, names, first.horizon)),)),
        *tree.warned(_warnings(first)),
        _table(robot, error, before),
    ]
    if len(replays) > 1:
        sections.append(_by_log(robot, replays, against))
    sections.append(KeyValues("inputs", _facts(replays), "how it was computed"))
    return Report("replay", replay_payload(replays, against), tuple(sections))


def replay_payload(replays: Sequence[Replay], against: Sequence[Replay] = ()) -> dict[str, Any]:
    """Return the JSON object of a replay."""
    first, error = replays[0], pooled(replays)
    payload = {
        **robot_payload(first.robot),
        "log": _logs(replays),
        **picked(first, "driven_by engine horizon left_out"),
        "error": error,
        "mean_abs": overall(error),
        "error_by_log": [{"file": item.recording.files[0], "error": item.error} for item in replays],
    }
    if against:
        other = pooled(against)
        payload |= {
            "against": against[0].robot.name,
            "before": {"error": error, "mean_abs": overall(error)},
            "after": {"error": other, "mean_abs": overall(other)},
        }
    return payload


def _logs(replays: Sequence[Replay]) -> dict[str, Any]:
    logs = [log_payload(item.recording) for item in replays]
    return {
        **logs[0],
        "files": [file for log in logs for file in log["files"]],
        "sha256": [mark for log in logs for mark in log["sha256"]],
        "samples": sum(log["samples"] for log in logs),
        "duration": sum(log["duration"] for log in logs),
    }


def _sentence(
    robot: Robot, error: Mapping[str, PositionError], before: Mapping[str, PositionError] | None, names: Sequence[str],
    horizon: float | None,
) -> str:  # fmt: skip
    away = runaways(error)
    if away:
        shorter = TORQUE_HORIZON if horizon is None else SHORT_HORIZON
        which = "every joint" if len(away) == len(error) else ", ".join(away)
        said = f"The simulated motion of {which} runs away: no replay with this robot"
        said += f". Try --horizon {shorter:g}" if horizon is None or shorter < horizon else ""
    else:
        worst = max(error, key=lambda name: error[name].mean_abs)
        said = f"{_average(robot, error)} on average"
        if len({small_unit(robot, name) for name in error}) == 1:
            said += f"; {worst} is worst with {number_text(1e3 * error[worst].mean_abs, 3)} {small_unit(robot, worst)}"
    if before is not None:
        of = ", ".join(runaways(before))
        said += f". {names[1]}: {f'{of} ran away' if of else f'{_average(robot, before)} on average'}"
    return f"{said}."


def _size(value: float, unit: str) -> Cell:
    """Return an error, rad (m), as it prints, in mrad (mm): no number where the simulated motion ran away."""
    return Quantity(1e3 * value, unit, 3) if isfinite(value) else "ran away"


def _average(robot: Robot, error: Mapping[str, PositionError]) -> str:
    return mean_words(robot, {name: e.mean_abs for name, e in error.items()}, 3)


def _table(robot: Robot, error: Mapping[str, PositionError], other: Mapping[str, PositionError] | None) -> Table:
    columns = [
        Column("joint", "joint"),
        *Column.numbers(mean_abs="mean absolute error", rms="rms", offset="constant part"),
        *((Column("against", "mean absolute error of the other robot", align="right"),) if other else ()),
    ]
    rows: list[tuple[Cell, ...]] = []
    for name, e in error.items():
        unit = small_unit(robot, name)
        row: list[Cell] = [name, *(_size(v, unit) for v in (e.mean_abs, e.rms, e.offset))]
        if other:
            row.append(_size(other[name].mean_abs, unit) if name in other else None)
        rows.append(tuple(row))
    return Table("error", tuple(columns), tuple(rows), title="simulated minus measured position")


def _by_log(robot: Robot, replays: Sequence[Replay], against: Sequence[Replay]) -> Table:
    columns = [
        Column("file", "log"), Column("mean_abs", "mean absolute error", align="right"),
        *((Column("against", "of the other robot", align="right"),) if against else ()),
    ]  # fmt: skip
    unit = small_unit(robot, robot.joint_names[0])
    rows: list[tuple[Cell, ...]] = [
        (item.recording.files[0], _size(item.mean_abs, unit),
         *((_size(against[k].mean_abs, unit),) if against else ()))
        for k, item in enumerate(replays)
    ]  # fmt: skip
    return Table("by_log", tuple(columns), tuple(rows), title="of each log")


def _facts(replays: Sequence[Replay]) -> tuple[tuple[str, Cell], ...]:
    first = replays[0]
    seconds = sum(item.recording.duration for item in replays)
    ways = {item.commands for item in replays}
    between = "in some logs held for their sample, in others smooth between samples or interpolated by the drives"
    if len(ways) == 1:
        words = {"smooth": "smooth between its samples", "interpolated": "interpolated by the drives over its period"}
        between = words.get(next(iter(ways)) or "", "held for its sample")
    drive = f"what the log commanded, {between}" if first.driven_by == "commands" else "the log's torque"
    restart = "the first pose of every stretch" if first.horizon is None else (
        f"the measured state, every {number_text(first.horizon)} s")  # fmt: skip
    return (
        ("replayed", f"{number_text(seconds, 3)} s, {sum(len(item.t) for item in replays)} samples"),
        ("driven by", drive),
        ("started from", restart),
        ("simulated by", _engine(first)),
    )


def _engine(first: Replay) -> str:
    if first.engine != "mujoco":
        return "elid"
    return f"MuJoCo, {first.mjcf} itself in steps of 1 ms" if first.mjcf else "MuJoCo, with the exported model"


def _warnings(first: Replay) -> list[str]:
    said = list(first.recording.warnings)
    if first.left_out:
        said.append(f"the replay does not hold {', '.join(first.left_out)}, which the robot file declares")
    away = runaways(first.error)
    if away:
        said.append(
            f"{', '.join(away)}: the simulated motion runs away: a value in the robot file is wrong or was not shown "
            "by its log (stiffness, inertia), or a unit or sign of what drives it is wrong"
        )
    lost = [name for name in first.lost if name not in away]
    if lost:
        said.append(
            f"{', '.join(lost)}: farther off than a joint that stands still would be; look at units and signs of "
            "positions and commands, gains, gravity, and at the values of the robot file"
        )
    if first.driven_by == "torque":
        said.append("no commands in the log: its torque drives the robot, and without feedback every error grows")
    return said
