"""The answer of ``elid diagnose``: the effects that the model lacks, the error before and after, what stays open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from elid_cli.diagnosis import Diagnosis, FoundEffect, Unexplained
from elid_cli.identification import Identification, JointError
from elid_cli.recording import Recording
from elid_cli.report import (
    Cell,
    Column,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    Tone,
    number_text,
    percent,
)
from elid_cli.reports.classification import class_payload
from elid_cli.reports.identification import AT_FLOOR, base_payload, error_payload, torque_unit
from elid_cli.reports.inputs import (
    command,
    effect_text,
    heading,
    log_payload,
    nuisance_items,
    nuisance_payload,
    recorded_items,
    robot_payload,
    used_items,
)
from elid_cli.robot import Robot

MOVED = 3.0
"""Shift of a base parameter, in standard deviations, that is worth a word."""
NAMED = 5
"""How many moved base parameters are named."""


@dataclass(frozen=True)
class Check:
    """The models before and after on a log that the search never saw."""

    file: str
    before: Mapping[str, JointError]
    after: Mapping[str, JointError]


def diagnosis_report(
    found: Diagnosis,
    identified: Identification,
    recording: Recording,
    robot_argument: str,
    checks: Sequence[Check] = (),
    written: str | None = None,
) -> Report:
    """Return the report of one diagnosis.

    Parameters
    ----------
    found
        The diagnosis.
    identified
        The refined robot's parameters on the same log: the model after.
    recording, robot_argument
        What was given.
    checks
        Both models on other logs.
    written
        The robot file that was written, if any.
    """
    facts = (
        *recorded_items(found.robot, recording),
        *used_items(identified.settings),
        *nuisance_items(found.robot, found.nuisances),
        *(("residual", line) for line in found.triage),
        ("tried", f"{found.tried} effects, judged on {len(found.held_out)} stretches held out of the search"),
    )
    sections: list[Section] = [
        heading(found.robot, recording),
        KeyValues("inputs", facts),
        *_effects(found),
        _before_after("before_after", found.robot, found.before, found.after, "error on the held-out stretches"),
        *_also_possible(found),
        *_unexplained(found.unexplained),
        *(
            _before_after(f"check{k}", found.robot, check.before, check.after, f"error on {check.file}")
            for k, check in enumerate(checks)
        ),
        *(Text(f"warning{k}", line, "warning") for k, line in enumerate((*recording.warnings, *identified.warnings))),
        *_meaning(found, recording, robot_argument, written),
    ]
    return Report("diagnose", diagnosis_payload(found, identified, recording, checks), tuple(sections))


def diagnosis_payload(
    found: Diagnosis, identified: Identification, recording: Recording, checks: Sequence[Check]
) -> dict[str, Any]:
    """Return the JSON object of a diagnosis (FORMATS: JSON)."""
    return {
        **robot_payload(found.robot),
        "log": log_payload(recording),
        "settings": dict(identified.settings),
        **class_payload(identified.base, identified),
        "base_parameters": base_payload(identified),
        "error": error_payload(found.after),
        "before": {"error": error_payload(found.before)},
        "after": {"error": error_payload(found.after)},
        "effects": [_effect_payload(e) for e in found.effects],
        "curves": [_effect_payload(e) for e in found.curves],
        "nuisances": nuisance_payload(found.nuisances),
        "also_possible": [
            {"effect": r.effect, "joint": r.joint, "gain": r.gain, "instead_of": r.instead_of,
             "parameters": dict(r.parameters), "separate": r.separate}
            for r in found.also_possible
        ],
        "unexplained": [
            {"joint": u.joint, "rows": u.rows, "variable": u.variable, "share": u.share, "rms": u.rms, "ratio": u.ratio,
             "nearest": [{"effect": e, "joint": j, "gain": g} for e, j, g in u.nearest]}
            for u in found.unexplained
        ],
        "triage": list(found.triage),
        "sufficient": found.sufficient,
        "tried": found.tried,
        "held_out": [list(span) for span in found.held_out],
        "moved": [
            {"name": m.name, "before": m.before, "after": m.after, "deviations": m.deviations} for m in found.moved
        ],
        "checks": [
            {"file": c.file, "before": {"error": error_payload(c.before)}, "after": {"error": error_payload(c.after)}}
            for c in checks
        ],
        "warnings": list(identified.warnings),
    }  # fmt: skip


def _effect_payload(effect: FoundEffect) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        "joint": effect.joint,
        "parameters": dict(effect.parameters),
        "std_error": dict(effect.std_error),
        "gain": effect.gain,
        "folds": list(effect.folds),
        "local": effect.local,
    }


def _effects(found: Diagnosis) -> list[Section]:
    named = (*found.effects, *found.curves)
    if not named:
        return [Text("effects", "no effect of the library is missing from the model")]
    columns = (
        Column("effect", "effect"),
        Column("joint", "joint"),
        Column("gain", "gain", align="right"),
        Column("parameters", "parameters"),
        Column("meaning", "what it is"),
    )
    rows = tuple(
        (
            Mark(e.effect, "warn"),
            e.joint or "robot",
            percent(e.gain, 2),
            effect_text(found.robot, e.effect, e.joint, e.parameters, e.std_error),
            e.summary,
        )
        for e in named
    )
    return [Table("effects", columns, rows, title="missing from the model")]


def _before_after(
    key: str, robot: Robot, before: Mapping[str, JointError], after: Mapping[str, JointError], title: str
) -> Table:
    columns = [
        Column("joint", "joint"),
        Column("torque_rms", "torque rms", align="right"),
        Column("before", "before", align="right"),
        Column("after", "after", align="right"),
        Column("relative", "share", align="right"),
    ]
    floors = any(e.floor for e in after.values())
    if floors:
        columns.append(Column("floor", "× floor", align="right"))
    rows = []
    for joint, new in after.items():
        unit, old = torque_unit(robot, joint), before.get(joint)
        row: list[Cell] = [
            joint,
            Quantity(new.torque_rms, unit, 3),
            Quantity(None if old is None else old.rms, unit, 3),
            Quantity(new.rms, unit, 3),
            percent(new.relative),
        ]
        if floors:
            tone: Tone = "warn" if new.floor and new.rms > AT_FLOOR * new.floor else "good"
            row.append(Quantity(new.rms / new.floor, digits=3, tone=tone) if new.floor else None)
        rows.append(tuple(row))
    return Table(key, tuple(columns), tuple(rows), title=title)


def _also_possible(found: Diagnosis) -> list[Section]:
    if not found.also_possible:
        return [Text("also_possible", "not distinguishable here: nothing")] if found.effects else []
    columns = (
        Column("effect", "effect"),
        Column("joint", "joint"),
        Column("instead_of", "instead of"),
        Column("gain", "gain", align="right"),
        Column("separate", "record to tell them apart"),
    )
    rows = tuple(
        (r.effect, r.joint or "robot", r.instead_of, percent(r.gain, 2), r.separate) for r in found.also_possible
    )
    return [Table("also_possible", columns, rows, title="this log cannot rule out")]


def _unexplained(unexplained: Sequence[Unexplained]) -> list[Section]:
    if not unexplained:
        return []
    columns = (
        Column("joint", "joint"),
        Column("rows", "rows"),
        Column("ratio", "× floor", align="right"),
        Column("variable", "follows"),
        Column("share", "share", align="right"),
        Column("nearest", "nearest effects, and what they would take"),
    )
    rows = tuple(
        (
            u.joint,
            u.rows,
            Quantity(u.ratio, digits=3, tone="warn"),
            u.variable,
            percent(u.share, 2),
            ", ".join(f"{e} {number_text(100 * g, 2)} %" for e, _, g in u.nearest) or "none",
        )
        for u in unexplained
    )
    return [Table("unexplained", columns, rows, title="left unexplained")]


def _meaning(found: Diagnosis, recording: Recording, robot_argument: str, written: str | None) -> list[Section]:
    if found.sufficient:
        text = f"The model is sufficient: what it leaves is within {number_text(AT_FLOOR)} of the sensors' noise."
        keep = ("--write-robot", f"{found.robot.name}-identified.yaml")
        return [Text("meaning", text), Text("next", command("identify", recording, robot_argument, *keep), "next")]
    sections: list[Section] = []
    moved = [m for m in found.moved if abs(m.deviations) > MOVED]
    if found.effects and moved:
        words = ", ".join(f"{m.name} {m.deviations:+.0f} sd" for m in moved[:NAMED])
        more = f" and {len(moved) - NAMED} more" if len(moved) > NAMED else ""
        sections.append(Text("moved", f"moved by it: {words}{more}"))
    if written is not None:
        return [*sections, Text("next", command("validate", recording, written, "--held-out"), "next")]
    if not found.effects:
        line = command("diagnose", recording, robot_argument, "--lookup")
        return [*sections, Text("next", line, "next")]
    line = command("diagnose", recording, robot_argument, "--write-robot", f"{found.robot.name}-refined.yaml")
    return [*sections, Text("next", line, "next")]
