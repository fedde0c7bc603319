"""The answer of ``elid identify``: base parameters with their errors, and how well they predict the torque."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

from elid_cli.estimation.refined_robot import could_be_built, impossible_words
from elid_cli.estimation.result import BaseEstimate, FittedEffect, Identification
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.estimation.validation.verdicts import HELD, IMPOSSIBLE
from elid_cli.model.effects import nuisance_of
from elid_cli.report import tree
from elid_cli.report.answers import inputs, summary
from elid_cli.report.answers.classification import folded, reasons_table, verdict_mark
from elid_cli.report.answers.drive_gains import gains_table
from elid_cli.report.answers.drives import drives_needed, drives_table
from elid_cli.report.answers.error_tables import TITLE, error_table, log_table, sensor_table, small
from elid_cli.report.answers.identification_json import error_payload, identification_payload
from elid_cli.report.answers.known import parameter_words
from elid_cli.report.answers.lacking import (
    is_doubted,
    loud_joints,
    motion_words,
    unlike_motion_first,
    words_of,
    yielding,
)
from elid_cli.report.answers.motor_side import motor_side_sections, stiffness_items
from elid_cli.report.tree import Cell, Column, KeyValues, Mark, Quantity, Report, Section, Table, Text, number_text
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording

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
    facts = (*inputs.recorded_items(found.robot, recording), *inputs.used_items(found.settings), *result_items(found))
    predicts = "" if impossible_words(found) else ", which predicts as this result does"
    for path in written:
        foreign = path.lower().endswith((".urdf", ".xml", ".mjcf"))
        facts += (("written", path if foreign else f"{path}{predicts}"),)
    unclear = is_doubted(found)
    writes = found.model == "sufficient" and not unclear and not found.drive_gains and not yielding(found)
    record, further = summary.record_sections(
        found,
        (*stiffness_items(found, robot_argument), *drives_needed(found)),
        (recording.files[0], robot_argument),
        writes=writes,
        written=writes and bool(written),
        unclear=unclear,
    )
    lacking = {item.joint for item in found.insufficient}
    loud = [] if lacking else loud_joints(found.noise)
    sections: list[Section] = [
        inputs.heading(found.robot, recording),
        summary.answers(
            motion_words(found, recording.warnings)
            or unlike_motion_first(
                found,
                summary.trust_words(found.robot, found.error, lacking, (*recording.warnings, *found.warnings)),
            ),
            words_of(found),
            parameter_words(found, loud),
            record,
        ),
        *tree.warned((*recording.warnings, *found.warnings)),
        error_table(found.robot, found.error, TITLE, lacking=lacking),
        *gains_table(found.drive_gains),
        *sensor_table(found.robot, found.error),
        *log_table(found.robot, logs),
        *base_tables(found),
        *motor_side_sections(found),
        *(() if found.drives else reasons_table(found)),
        *further,
        KeyValues("inputs", facts, "how it was computed"),
        Text("next", _next(found, recording, robot_argument, written), "next"),
    ]
    payload = identification_payload(found, recording)
    if logs:
        payload["error_by_log"] = [{"file": log.file, "error": error_payload(log.error)} for log in logs]
    return Report("identify", payload, tuple(sections))


def result_items(found: Identification) -> inputs.Items:
    """Return the numbers that say how far the result can be trusted."""
    counts = found.base.counts
    marks = [mark.text if isinstance(mark := _mark(item), Mark) else "known" for item in found.parameters]
    words = ("known", summary.BIASED, summary.ROUGH, summary.NEGATIVE, summary.NOT_SHOWN, "held")
    judged = ", ".join(f"{marks.count(word)} {word}" for word in words if word in marks)
    if found.drives:
        late = [item for item in found.nuisances if nuisance_of(item.effect) != "offset"]
        fitted: inputs.Items = (
            ("parameters", f"{4 * len(found.drives)} of drives; bodies are those of the robot file"),
            *inputs.nuisance_items(found.robot, late),
        )
    else:
        fitted = (
            ("parameters", f"{counts['parameters']} standard, {counts['base']} base; {judged}"),
            ("condition", f"{number_text(found.condition, 2)}, rank margin {number_text(found.rank_margin, 1)}"),
            *inputs.nuisance_items(found.robot, found.nuisances),
        )
    return (
        *fitted,
        *(_effect_item(found.robot, effect) for effect in found.effects),
        *(("note", sentence) for sentence in found.notes),
    )


def _effect_item(robot: Robot, found: FittedEffect) -> tuple[str, Cell]:
    """Return a declared effect with the values that this log gives it."""
    values = inputs.effect_text(robot, found.effect, found.joint, found.shown, found.std_error)
    unshown = ", ".join(f"{name} not shown by this log" for name in found.unshown)
    return (found.effect.replace("_", " "), f"{found.joint or 'robot'} {', '.join(filter(None, (values, unshown)))}")


def base_tables(found: Identification) -> list[Table]:
    """Return the base parameters with errors, and with references where the robot file has any.

    Those of drives and transmissions are a table of their own, which comes first; what the verdicts mean is under the
    last. Of a fit of the motion under commands, which takes the bodies of the file, the drives instead.
    """
    if found.drives:
        return [drives_table(found)]
    ordered = summary.by_kind([item.leader for item in found.parameters])
    drives = [k for k in ordered if found.parameters[k].leader.kind in summary.JOINT_KINDS]
    bodies = [k for k in ordered if k not in drives]
    parts = [
        ("joint_parameters", "parameters of drives and transmissions, with standard errors", drives),
        ("base_parameters", "parameters of the bodies, with standard errors", bodies),
    ]
    tables = [_base_table(found, key, title, members) for key, title, members in parts if members]
    notes = [summary.symbol_words(found.base.names[k] for k in members) for _, _, members in parts if members]
    notes[-1:] = [f"{words}\n{verdict_note(found)}" for words in notes[-1:]]
    return [replace(table, note=note) for table, note in zip(tables, notes, strict=True)]


def _base_table(found: Identification, key: str, title: str, members: Sequence[int]) -> Table:
    relative = found.relative_error()
    known = any(value == value for value in found.reference)
    doubtful = any(_mark(found.parameters[k]) for k in members)
    columns = [
        Column("name", "base parameter", span=True),
        *Column.numbers(estimate="value", std_error="± sd"),
        Column("relative", "± sd", "%", align="right"),
        Column("unit", "unit"),
        *((Column("reference", "file", align="right"), Column("off", "differs", "%", align="right")) if known else ()),
        *((Column("verdict", "verdict"),) if doubtful else ()),
    ]
    rows: list[tuple[Cell, ...]] = []
    for k in members:
        value, deviation = float(found.estimate[k]), float(found.std_error[k])
        minor = summary.small_value(value, deviation, found.verdict[k])
        reference: tuple[Cell, ...] = (Quantity(float(found.reference[k])), small(float(relative[k]))) if known else ()
        verdict: tuple[Cell, ...] = (_mark(found.parameters[k]),) if doubtful else ()
        rows.append(
            (
                folded(found.base.names[k], found.base.terms[k]),
                Quantity(value, resolution=deviation),
                Quantity(deviation, resolution=deviation),
                summary.SMALL if minor else summary.spread_text(deviation, value),
                found.base.units[k],
                *reference,
                *verdict,
            )
        )
    return Table(key, tuple(columns), tuple(rows), title, SHOWN)


def _mark(item: BaseEstimate) -> Cell:
    if item.reason.startswith(HELD):
        return Mark("held", "dim")
    if item.reason.startswith(IMPOSSIBLE):
        return Mark(summary.NEGATIVE, "bad")
    if item.verdict != "supported":
        return verdict_mark(item.verdict)
    return Mark(summary.BIASED, "warn") if item.bias_possible else ""


def verdict_note(found: Identification) -> str:
    """Return what the verdicts mean that stand in the tables."""
    items = found.parameters
    negative = [item for item in items if item.reason.startswith(IMPOSSIBLE)]
    rough = any(item.verdict == "weak" and item not in negative for item in items)
    refused = any(item.verdict == "refused" and not item.reason.startswith(HELD) for item in items)
    biased = any(item.bias_possible for item in items)
    said = [
        (summary.KNOWN, True),
        (f"{summary.ROUGH}: less well than that", rough),
        (f"{summary.NOT_SHOWN}: by this log", refused),
        (f"{summary.BIASED}: what the model lacks can move it by more than ± sd says", biased),
        (f"{summary.NEGATIVE}: no robot has such a value", bool(negative)),
        ("held: at the robot file's value, not looked for", any(item.reason.startswith(HELD) for item in items)),
        (summary.SMALL_WORDS, any(summary.small_value(item.estimate, item.std_error, item.verdict) for item in items)),
    ]
    return "\n".join(words for words, stands in said if stands)


def _next(found: Identification, recording: Recording, robot_argument: str, written: Sequence[str]) -> str:
    if found.drive_gains:
        first = replace(recording, files=recording.files[:1])  # the other one has the payload
        if found.gain_map:
            return inputs.command("identify", first, robot_argument, "--map", found.gain_map)
        return shlex.join(["elid", "excite", "--robot", robot_argument, "-o", "exciting.csv"])
    if found.model != "sufficient" or is_doubted(found):
        return inputs.command("diagnose", recording, robot_argument)
    if written:
        return inputs.command("validate", recording, inputs.fullest(written))
    keeping = inputs.keeping(found.robot, "identified", _declared(found.robot))
    mjcf = len(keeping) > 2 and not found.robot.source.lower().endswith(".urdf")
    if mjcf and not found.drives and not could_be_built(found):
        keeping = keeping[:2]  # an MJCF holds only bodies that there can be
    return inputs.command("identify", recording, robot_argument, *keeping)


def _declared(robot: Robot) -> list[str]:
    return [spec.effect for spec in robot.effects]
