"""A robot by itself: its joints, what is known of them, and the effects that it declares."""

from __future__ import annotations

from typing import Any

from elid_cli.report.answers.inputs import effect_text, note_items, robot_payload
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Section, Table, Text, number_text
from elid_cli.robot.robot import Joint, Robot

NOTE = "reference values: how many of the joint's standard parameters the description gives; –: unknown"


def robot_sections(robot: Robot) -> list[Section]:
    """Return a robot as facts and a table of its joints."""
    facts: list[tuple[str, Cell]] = [("gravity", f"{' '.join(number_text(g, 4) for g in robot.gravity)} m/s²")]
    facts += [("file", robot.source)] if robot.source else []
    facts += [
        ("effect", f"{e.effect} {e.joint or ''} {effect_text(robot, e.effect, e.joint, e.parameters, {})}".rstrip())
        for e in robot.effects
    ]
    return [Text("title", robot.name, "heading"), KeyValues("inputs", (*facts, *note_items(robot))), _table(robot)]


def robot_values(robot: Robot) -> dict[str, Any]:
    """Return a robot in JSON's types: its joints with their reference values, SI, and the effects that it declares."""
    effects = [{"effect": e.effect, "joint": e.joint, "parameters": dict(e.parameters)} for e in robot.effects]
    described = [{**_facts(joint), "parameters": dict(joint.parameters)} for joint in robot.joints]
    return {**robot_payload(robot), "gravity": list(robot.gravity), "effects": effects, "described": described}


def robot_rows(robot: Robot) -> list[dict[str, Any]]:
    """Return one row per joint, its reference values by their names."""
    return [{**_facts(joint), **joint.parameters} for joint in robot.joints]


def _facts(joint: Joint) -> dict[str, Any]:
    return {
        "joint": joint.name,
        "type": joint.type,
        "transmission": joint.transmission,
        "gear_ratio": joint.gear_ratio,
        "torque_at": joint.torque_at,
    }


def _table(robot: Robot) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            joint.name, joint.type, joint.transmission, Quantity(joint.gear_ratio),
            f"{sum(kind in joint.parameters for kind in joint.kinds)} of {len(joint.kinds)}",
        )
        for joint in robot.joints
    ]  # fmt: skip
    columns = (
        *Column.texts(joint="joint", type="type", transmission="transmission"),
        *Column.numbers(gear_ratio="gear ratio", known="reference values"),
    )
    return Table("joints", columns, tuple(rows), note=NOTE)
