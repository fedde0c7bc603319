"""Tables of prediction errors: joints, torque sensors, several logs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import isnan

from elid_cli.estimation.judgement import EQUATIONS, JointError
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.report.answers.summary import light, share_text
from elid_cli.report.tree import Cell, Column, Quantity, Section, Table, percent
from elid_cli.robot.robot import Robot

TITLE = "torque of each joint on stretches that the fit never saw"
ODD = 1.5
"""A log whose error is this many times the next worst one's fits worse than the others."""
LIGHTS = (
    "good: only the sensors' noise is left (where that noise is not known: the error is within 1 % of the torque); "
    "fair: within 5 % of the torque; poor: worse. × noise: error over what the sensors' noise alone would leave"
)
SIDE_NOTES = {
    "sum": "whole joint: motor torque against link and motor together",
    "motor": "motor side: with the transmission's torque from the measured deflection",
}


def small(fraction: float | None) -> str:
    """Return a share in percent, its unit in the column's head."""
    return "–" if fraction is None else share_text(fraction).removesuffix(" %")


def error_table(
    robot: Robot,
    error: Mapping[str, JointError],
    title: str = "",
    *,
    fitted: bool = True,
    lacking: Collection[str] = (),
) -> Table:
    """Return how well each joint's torque is predicted, on data that the fit (if any) never saw.

    An elastic joint has two rows, as it has two equations. `lacking` are joints whose residual follows the motion.
    """
    with_spring = any(e.spring_rms is not None for e in error.values())
    columns = [
        Column("joint", "joint"),
        *((Column("rows", "equation"),) if with_spring else ()),
        Column("trust", "model"),
        *Column.numbers(torque_rms="torque rms", rms="held-out error" if fitted else "error", relative="of torque"),
    ]
    with_floor = any(e.floor is not None for e in error.values())
    if with_floor:
        columns.append(Column("floor", "× noise", align="right"))
    rows = []
    for name, e in error.items():
        unit, mark = torque_unit(robot, name), light(e, lacking=name in lacking)
        sides = [("sum", e.rms, e.relative, e.floor)]
        if e.spring_rms is not None and e.spring_relative is not None:
            sides.append(("motor", e.spring_rms, e.spring_relative, e.spring_floor))
        for kind, rms, share, floor in sides:
            row: list[Cell] = [
                name,
                *((EQUATIONS[kind],) if with_spring else ()),
                mark if kind == "sum" else "",
                Quantity(e.torque_rms, unit, 3) if kind == "sum" else "",
                Quantity(rms, unit, 3),
                share_text(share),
            ]
            if with_floor:
                row.append(Quantity(rms / floor, digits=2, tone=mark.tone) if floor else None)
            rows.append(tuple(row))
    note = "\n".join((LIGHTS, *SIDE_NOTES.values())) if with_spring else LIGHTS
    return Table("error", tuple(columns), tuple(rows), title=title, note=note)


def sensor_table(robot: Robot, error: Mapping[str, JointError]) -> list[Section]:
    """Return how well each joint torque sensor is predicted, side by side; nothing without sensors."""
    columns = (
        Column("joint", "joint"),
        *Column.numbers(
            reading_rms="sensor rms",
            load_rms="bodies",
            load_share="share",
            spring_rms="spring",
            spring_share="share",
            drive_rms="motor side",
        ),
    )
    rows: list[tuple[Cell, ...]] = []
    for name, e in error.items():
        if e.sensor is None:
            continue
        unit, s = torque_unit(robot, name), e.sensor
        row: list[Cell] = [name, Quantity(s.reading_rms, unit, 3)]
        for size in (s.load_rms, s.spring_rms):
            row += [Quantity(size, unit, 3), percent(size / s.reading_rms if s.reading_rms else None)]
        rows.append((*row, Quantity(None if isnan(s.drive_rms) else s.drive_rms, unit, 3)))
    title = "error against the joint torque sensors"
    return [Table("sensors", columns, tuple(rows), title=title)] if rows else []


def log_table(robot: Robot, logs: Sequence[ByLog]) -> list[Section]:
    """Return a table of logs (or robots) by joints; the worst of each joint stands out where it is well above."""
    if not logs:
        return []
    joints = list(dict.fromkeys(joint for log in logs for joint in log.error))
    columns = (
        Column("file", "judged"),
        *(Column(joint, joint, torque_unit(robot, joint), "right") for joint in joints),
    )
    rows: list[tuple[Cell, ...]] = []
    for log in logs:
        cells: list[Cell] = [log.label]
        for joint in joints:
            error = log.error.get(joint)
            others = [o.error[joint].rms for o in logs if o is not log and joint in o.error]
            odd = error is not None and others and error.rms > ODD * max(others)
            cells.append(Quantity(error.rms if error else None, digits=3, tone="warn" if odd else "plain"))
        rows.append(tuple(cells))
    return [Table("by_log", columns, tuple(rows), title="error of each, side by side", note=_odd_note(logs, joints))]


def _odd_note(logs: Sequence[ByLog], joints: Sequence[str]) -> str:
    for joint in joints:
        ranked = sorted((log for log in logs if joint in log.error), key=lambda log: log.error[joint].rms)
        if len(ranked) > 1 and ranked[-1].error[joint].rms > ODD * ranked[-2].error[joint].rms:
            return f"{ranked[-1].label} fits worse than the others at {joint}"
    return ""


def torque_unit(robot: Robot, joint: str) -> str:
    """Return the unit of a joint's torque (or force)."""
    return robot.joint(joint).units[1]
