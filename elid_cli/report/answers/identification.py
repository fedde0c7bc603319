"""The answer of ``elid identify``: base parameters with their errors, and how well they predict the torque."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from math import isnan
from typing import Any

from elid_cli.estimation.refined_robot import impossible_words
from elid_cli.estimation.result import BaseEstimate, FittedEffect, Identification, Insufficient, JointError, RowNoise
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.report.answers.classification import class_payload, folded, reasons_table, verdict_mark
from elid_cli.report.answers.drive_gains import gains_payload, gains_table
from elid_cli.report.answers.inputs import (
    Items,
    command,
    effect_text,
    heading,
    keeping,
    log_payload,
    nuisance_items,
    nuisance_payload,
    recorded_items,
    robot_payload,
    used_items,
)
from elid_cli.report.answers.motor_side import motor_side_payload, motor_side_sections, stiffness_record
from elid_cli.report.answers.summary import (
    JOINT_KINDS,
    answers,
    by_kind,
    light,
    missing_words,
    parameter_words,
    record_sections,
    share_text,
    trust_words,
)
from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    number_text,
    percent,
)
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording

TITLE = "torque of each joint on stretches that the fit never saw"
ODD = 1.5
"""A log whose error is this many times the next worst one's fits worse than the others."""
LIGHTS = (
    "good: only the sensors' noise is left (1 % of the torque where that is not known); fair: within 5 % of the torque;"
    " poor: worse. × noise: error over what the sensors' noise alone would leave"
)
SIDES = "motor side alone: the same, of the motor's equation, with the spring's torque from the deflection"
SHOWN = 20
"""Base parameters printed without --all."""


def identification_report(
    found: Identification,
    recording: Recording,
    robot_argument: str,
    logs: Sequence[ByLog] = (),
    written: Sequence[str] = (),
) -> Report:
    """Return the report of one identification.

    Parameters
    ----------
    found, recording
        The result and what it was found from.
    robot_argument
        What ``--robot`` was given.
    logs
        The result's error on each of several logs.
    written
        The robot files that were written.
    """
    facts = (*recorded_items(found.robot, recording), *used_items(found.settings), *result_items(found))
    predicts = "" if impossible_words(found) else ", which predicts as this result does"
    for path in written:
        foreign = path.lower().endswith((".urdf", ".xml", ".mjcf"))
        facts += (("written", path if foreign else f"{path}{predicts}"),)
    record, further = record_sections(found, (), (recording.files[0], robot_argument))
    lacking = {item.joint for item in found.insufficient}
    moved = [item.leader for item in found.parameters if item.bias_possible]
    missing = missing_words(found.model, found.insufficient, found.noise, moved)
    sections: list[Section] = [
        heading(found.robot, recording),
        answers(trust_words(found.robot, found.error, lacking), missing, parameter_words(found), record),
        *(Text(f"warning{k}", line, "warning") for k, line in enumerate((*recording.warnings, *found.warnings))),
        error_table("error", found.robot, found.error, TITLE, lacking=lacking),
        *gains_table(found.drive_gains),
        *sensor_table("sensors", found.robot, found.error),
        *log_table(found.robot, logs),
        *base_tables(found),
        *motor_side_sections(found),
        *reasons_table(found),
        *further,
        KeyValues("inputs", facts, "how it was computed"),
        Text("next", _next(found, recording, robot_argument, written), "next"),
    ]
    payload = identification_payload(found, recording)
    if logs:
        payload["error_by_log"] = [{"file": log.file, "error": error_payload(log.error)} for log in logs]
    return Report("identify", payload, tuple(sections))


def identification_payload(found: Identification, recording: Recording | None = None) -> dict[str, Any]:
    """Return the JSON object of an identification (docs/reference/json.md), without a log where that is not at hand."""
    listed = base_payload(found)
    return {
        **robot_payload(found.robot),
        **({} if recording is None else {"log": log_payload(recording)}),
        "estimator": found.estimator,
        "settings": dict(found.settings),
        **class_payload(found.base, found),
        "condition": found.condition,
        "rank": found.rank,
        "rank_margin": found.rank_margin,
        "base_parameters": listed,
        "covariance": covariance_payload(found, len(listed)),
        "error": error_payload(found.error),
        **model_payload(found.model, found.noise, found.insufficient),
        **motor_side_payload(found),
        "nuisances": nuisance_payload(found.nuisances),
        "effects": nuisance_payload(found.effects),
        **gains_payload(found.drive_gains),
        "notes": list(found.notes),
        "warnings": list(found.warnings),
    }


def base_payload(found: Identification) -> list[dict[str, Any]]:
    """Return the list ``base_parameters`` of JSON; the estimate of a refused one is null."""
    relative = found.relative_error()
    units: dict[str, str] = dict(zip(found.robot.parameter_names(), found.robot.parameter_units(), strict=True))
    leaders = {found.base.parameters[leader] for leader in found.base.leaders}
    side = found.motor_side.joints if found.motor_side else ()
    stiffnesses = {joint.parameter: stiffness_record(found, joint) for joint in side}
    unseen = [
        {
            "name": name, "terms": {name: 1}, "unit": units.get(name, ""), "class": "unidentifiable", "estimate": None,
            "std_error": None, "reference": None, "relative_error": None, "verdict": "refused",
        }
        for name in found.hidden
        if name not in leaders and name not in stiffnesses
    ]  # fmt: skip
    return [
        {
            "name": found.base.names[k],
            "terms": dict(found.base.terms[k]),
            "unit": found.base.units[k],
            "class": found.base.classes[found.base.parameters[found.base.leaders[k]]],
            "estimate": found.estimate[k],
            "std_error": found.std_error[k],
            "reference": found.reference[k],
            "relative_error": relative[k],
            "verdict": found.verdict[k],
            "bias_possible": found.parameters[k].bias_possible,
        }
        for k in range(found.base.count)
    ] + [*stiffnesses.values(), *unseen]


def covariance_payload(found: Identification, count: int) -> list[list[float | None]]:
    """Return the matrix ``covariance`` of JSON, a row and a column for each of the `count` listed base parameters."""
    shown: list[list[float | None]] = found.joint_covariance.tolist()
    unseen: list[float | None] = [None] * (count - len(shown))
    rows = [[*row, *unseen] for row in shown] + [[None] * count for _ in unseen]
    side = found.motor_side.joints if found.motor_side else ()
    for k, joint in enumerate(side, start=len(shown)):  # found by itself: no correlation is known
        if joint.verdict != "refused":
            rows[k][k] = joint.std_error**2
    return rows


def model_payload(model: str, noise: Sequence[RowNoise], insufficient: Sequence[Insufficient]) -> dict[str, Any]:
    """Return what JSON says of the model: ``model``, ``noise`` and ``insufficient``."""
    return {"model": model, "noise": noise_payload(noise), "insufficient": [asdict(item) for item in insufficient]}


def noise_payload(noise: Sequence[RowNoise]) -> dict[str, Any]:
    """Return the object ``noise`` of JSON: by joint and row."""
    joints: dict[str, dict[str, Any]] = {}
    for item in noise:
        entry = {"floor": item.floor, "ratio": item.ratio, "correlation": item.correlation}
        joints.setdefault(item.joint, {})[item.rows] = entry
    return joints


def error_payload(error: Mapping[str, JointError]) -> dict[str, Any]:
    """Return an object ``error`` of JSON."""
    return {
        joint: {
            "rms": e.rms,
            "relative": e.relative,
            "spring_rms": e.spring_rms,
            "spring_relative": e.spring_relative,
            "torque_rms": e.torque_rms,
            "floor": e.floor,
            "spring_floor": e.spring_floor,
            **({} if e.sensor is None else {"sensor": asdict(e.sensor)}),
        }
        for joint, e in error.items()
    }


def result_items(found: Identification) -> Items:
    """Return the numbers that say how far the result can be trusted."""
    counts = found.base.counts
    verdicts = [(word, found.verdict.count(word)) for word in ("supported", "weak", "refused")]
    judged = ", ".join(f"{count} {word}" for word, count in verdicts if count)
    return (
        ("parameters", f"{counts['parameters']} standard, {counts['base']} base; {judged}"),
        ("condition", f"{number_text(found.condition, 2)}, rank margin {number_text(found.rank_margin, 2)}"),
        *nuisance_items(found.robot, found.nuisances),
        *(_effect_item(found.robot, effect) for effect in found.effects),
        *(("note", sentence) for sentence in found.notes),
    )


def _effect_item(robot: Robot, found: FittedEffect) -> tuple[str, Cell]:
    """Return a declared effect with the values that this log gives it."""
    values = effect_text(robot, found.effect, found.joint, found.parameters, found.std_error)
    return (found.effect.replace("_", " "), f"{found.joint or 'robot'} {values}")


def base_tables(found: Identification, note: str = "") -> list[Table]:
    """Return the base parameters with errors, and with references where the robot file has any.

    Those of drives and transmissions are a table of their own, which comes first; the `note` is under the last.
    """
    ordered = by_kind([item.leader for item in found.parameters])
    drives = [k for k in ordered if found.parameters[k].leader.kind in JOINT_KINDS]
    bodies = [k for k in ordered if k not in drives]
    parts = [
        ("joint_parameters", "parameters of drives and transmissions, with standard errors", drives),
        ("base_parameters", "parameters of the bodies, with standard errors", bodies),
    ]
    tables = [_base_table(found, key, title, members) for key, title, members in parts if members]
    note = note or _verdict_note(found)
    return [*tables[:-1], *(replace(table, note=note) for table in tables[-1:])]


def _base_table(found: Identification, key: str, title: str, members: Sequence[int]) -> Table:
    relative = found.relative_error()
    known = any(value == value for value in found.reference)
    doubtful = any(_mark(found.parameters[k]) for k in members)
    columns = [
        Column("name", "base parameter", span=True),
        Column("estimate", "value", align="right"),
        Column("std_error", "± sd", align="right"),
        Column("relative", "± sd", "%", align="right"),
        Column("unit", "unit"),
        *((Column("reference", "ref", align="right"), Column("off", "off", "%", align="right")) if known else ()),
        *((Column("verdict", "verdict"),) if doubtful else ()),
    ]
    rows: list[tuple[Cell, ...]] = []
    for k in members:
        value, deviation = float(found.estimate[k]), float(found.std_error[k])
        reference: tuple[Cell, ...] = (Quantity(float(found.reference[k])), _small(float(relative[k]))) if known else ()
        verdict: tuple[Cell, ...] = (_mark(found.parameters[k]),) if doubtful else ()
        rows.append(
            (
                folded(found.base.names[k], found.base.terms[k]),
                Quantity(value, resolution=deviation),
                Quantity(deviation, resolution=deviation),
                _small(deviation / abs(value) if value else None),
                found.base.units[k],
                *reference,
                *verdict,
            )
        )
    return Table(key, tuple(columns), tuple(rows), title, SHOWN)


def _small(fraction: float | None) -> str:
    """Return a share in percent, its unit in the column's head."""
    return "–" if fraction is None else share_text(fraction).removesuffix(" %")


def _mark(item: BaseEstimate) -> Cell:
    if item.verdict != "supported":
        return verdict_mark(item.verdict)
    return Mark("bias possible", "warn") if item.bias_possible else ""


def _verdict_note(found: Identification) -> str:
    if any(item.bias_possible for item in found.parameters):
        return "bias possible: what the model lacks can move it by more than ± sd says"
    if all(verdict == "supported" for verdict in found.verdict):
        return "this log tells every one of them"
    return "weak: known only roughly, to worse than 30 %; refused: not known from this log; the others are known"


def error_table(
    key: str,
    robot: Robot,
    error: Mapping[str, JointError],
    title: str = "",
    *,
    fitted: bool = True,
    lacking: Collection[str] = (),
) -> Table:
    """Return how well each joint's torque is predicted, on data that the fit (if any) never saw.

    `lacking` are joints whose residual follows the motion.
    """
    columns = [
        Column("joint", "joint"),
        Column("trust", "model"),
        Column("torque_rms", "torque rms", align="right"),
        Column("rms", "held-out error" if fitted else "error", align="right"),
        Column("relative", "of torque", align="right"),
    ]
    with_floor = any(e.floor is not None for e in error.values())
    with_spring = any(e.spring_rms is not None for e in error.values())
    if with_floor:
        columns.append(Column("floor", "× noise", align="right"))
    if with_spring:
        columns.append(Column("spring_relative", "motor side alone", align="right"))
    rows = []
    for name, e in error.items():
        unit, mark = torque_unit(robot, name), light(e, lacking=name in lacking)
        row: list[Cell] = [
            name,
            mark,
            Quantity(e.torque_rms, unit, 3),
            Quantity(e.rms, unit, 3),
        ]
        row.append(share_text(e.relative))
        if with_floor:
            row.append(Quantity(e.rms / e.floor, digits=2, tone=mark.tone) if e.floor else None)
        if with_spring:
            row.append(None if e.spring_relative is None else share_text(e.spring_relative))
        rows.append(tuple(row))
    return Table(key, tuple(columns), tuple(rows), title=title, note=f"{LIGHTS}; {SIDES}" if with_spring else LIGHTS)


def sensor_table(key: str, robot: Robot, error: Mapping[str, JointError]) -> list[Section]:
    """Return how well each joint torque sensor is predicted, side by side; nothing without sensors."""
    columns = (
        Column("joint", "joint"),
        Column("reading_rms", "sensor rms", align="right"),
        Column("load_rms", "bodies", align="right"),
        Column("load_share", "share", align="right"),
        Column("spring_rms", "spring", align="right"),
        Column("spring_share", "share", align="right"),
        Column("drive_rms", "motor side", align="right"),
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
    return [Table(key, columns, tuple(rows), title=title)] if rows else []


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
        cells: list[Cell] = [log.file]
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
            return f"{ranked[-1].file} fits worse than the others at {joint}"
    return ""


def torque_unit(robot: Robot, joint: str) -> str:
    """Return the unit of a joint's torque (or force)."""
    return "N·m" if robot.joints[robot.joint_names.index(joint)].revolute else "N"


def _next(found: Identification, recording: Recording, robot_argument: str, written: Sequence[str]) -> str:
    if found.drive_gains:
        first = replace(recording, files=recording.files[:1])  # the other one has the payload
        if found.gain_map:
            return command("identify", first, robot_argument, "--map", found.gain_map)
        return shlex.join(["elid", "excite", "--robot", robot_argument, "-o", "exciting.csv"])
    if found.model != "sufficient":
        return command("diagnose", recording, robot_argument)
    if written:
        return command("validate", recording, written[0])
    return command("identify", recording, robot_argument, *keeping(found.robot, "identified", _declared(found.robot)))


def _declared(robot: Robot) -> list[str]:
    return [spec.effect for spec in robot.effects]
