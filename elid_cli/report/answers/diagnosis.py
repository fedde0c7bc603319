"""The answer of ``elid diagnose``: the residual, the effects that the model lacks, the error before and after."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.diagnosis import Diagnosis
from elid_cli.diagnosis.residuals import RowState
from elid_cli.report.answers.diagnosis_input import DiagnosisInput, referenced
from elid_cli.report.answers.diagnosis_json import diagnosis_payload
from elid_cli.report.answers.diagnosis_tables import (
    before_after_table,
    effect_sections,
    refuted_section,
    residual_table,
    unexplained_section,
)
from elid_cli.report.answers.identification import AT_FLOOR, torque_unit
from elid_cli.report.answers.inputs import (
    Items,
    command,
    heading,
    nuisance_items,
    recorded_items,
    span_words,
    used_items,
)
from elid_cli.report.tree import KeyValues, Report, Section, Text, number_text, percent
from elid_cli.signals.recording import Recording

MOVED = 3.0
"""Shift of a base parameter, in standard deviations, that is worth a word."""
WORSE = 1.1
"""Error after over that before on another log from which it speaks against what was found."""
NAMED = 5
"""How many moved base parameters are named."""


def diagnosis_report(told: DiagnosisInput) -> Report:
    """Return the report of one diagnosis."""
    found, recording = told.found, told.recording
    facts = (
        *recorded_items(found.robot, recording),
        *used_items(told.after.settings),
        *nuisance_items(found.robot, found.nuisances),
        *_tried(found),
    )
    sections: list[Section] = [
        heading(found.robot, recording),
        KeyValues("inputs", facts),
        *result_sections(told),
        *(
            before_after_table(
                f"check{k}", found.robot, check.before, check.after, f"error on {_files(check.recording)}"
            )
            for k, check in enumerate(told.checks)
        ),
        *(Text(f"against{k}", line, "warning") for k, line in enumerate(_against(told))),
        *(Text(f"warning{k}", line, "warning") for k, line in enumerate((*recording.warnings, *told.after.warnings))),
        *_meaning(told),
    ]
    return Report("diagnose", diagnosis_payload(told), tuple(sections))


def result_sections(told: DiagnosisInput) -> list[Section]:
    """Return what was found: residuals, effects, the error before and after, what stays."""
    found = told.found
    return [
        residual_table(found),
        *([Text("triage", "\n".join(found.triage))] if found.triage else []),
        *effect_sections(told),
        before_after_table("before_after", found.robot, found.before, found.after, "error on the held-out stretches"),
        *refuted_section(found),
        *unexplained_section(found),
    ]


def _tried(found: Diagnosis) -> Items:
    many = "effect at its joint" if found.tried == 1 else "effects at their joints"
    return (("tried", f"{found.tried} {many}; held out of the search: {span_words(found.held_out)}"),)


def _meaning(told: DiagnosisInput) -> list[Section]:
    found = told.found
    sections: list[Section] = []
    if found.sufficient:
        limit = number_text(AT_FLOOR)
        sticking = any(r.ratio > AT_FLOOR >= r.away for r in found.rows_after)
        where = " away from reversals" if sticking else ""
        text = f"The model is sufficient: every row is within {limit} of its noise floor{where}; no effect improves it."
        if loud := [r for r in found.rows_after if r.high]:
            text = f"The model is sufficient: no effect improves it. {_loud(told, loud)}"
        keep = ("--write-robot", f"{found.robot.name}-identified.yaml")
        line = command("identify", told.recording, told.robot_argument, *keep)
        return [Text("meaning", text), Text("next", line, "next")]
    if told.contributions:
        sections.append(Text("meaning", "\n".join(_outcome(told))))
    return [*sections, Text("next", _next(told), "next")]


def _loud(told: DiagnosisInput, rows: Sequence[RowState]) -> str:
    """Return in words which rows hold more than white noise that has nothing to do with the motion."""
    worst = max(rows, key=lambda row: row.ratio)
    memory = [n.correlation for n in told.after.noise if n.joint == worst.joint]
    lasts = f" and remembers {max(memory) * 1e3:.0f} ms" if memory else ""
    return (
        f"What is left at {worst.joint}, {number_text(worst.ratio, 2)} times the sensors' white noise, does not follow "
        f"the motion{lasts}: noise of the torque."
    )


def _outcome(told: DiagnosisInput) -> list[str]:
    """Return in words where the model after stands, and what the missing effects had moved."""
    found = told.found
    worst = _worst(found)
    words = [
        f"after: every row within {number_text(worst, 3)} of its floor"
        if worst <= AT_FLOOR
        else f"after: more than the sensors' noise is left, up to {number_text(worst, 3)} times the floor"
    ]
    loud = [row for row in found.rows_after if row.high]
    if loud and not found.unexplained:
        words.append(_loud(told, loud))
    moved = [m for m in found.moved if abs(m.deviations) > MOVED]
    if moved:
        named = ", ".join(f"{m.name} {m.deviations:+.0f} sd" for m in moved[:NAMED])
        words.append(f"moved by it: {named}{f' and {len(moved) - NAMED} more' if len(moved) > NAMED else ''}")
    if referenced(told.before):
        first, last = (percent(m.normalised_mean_error()).value for m in (told.before, told.after))
        words.append(
            f"mean error against the robot file's parameters: {number_text(first, 3)} → {number_text(last, 3)} %"
        )
    return words


def _worst(found: Diagnosis) -> float:
    """Return the largest held-out error over its floor, as the table before it shows; without floors, of the fit."""
    pairs = [(e.rms, e.floor) for e in found.after.values()]
    pairs += [(e.spring_rms, e.spring_floor) for e in found.after.values() if e.spring_rms is not None]
    ratios = [rms / floor for rms, floor in pairs if floor and rms is not None]
    return max(ratios) if ratios else max(row.ratio for row in found.rows_after)


def _next(told: DiagnosisInput) -> str:
    found, recording = told.found, told.recording
    if told.written is not None:
        return command("validate", recording, told.written, "--held-out")
    if told.contributions:
        refined = ("--write-robot", f"{found.robot.name}-refined.yaml")
        tried = [word for name in told.only for word in ("--only", name)]
        lookup = ("--lookup",) if told.lookup else ()
        return command("diagnose", recording, told.robot_argument, *tried, *lookup, *refined)
    if told.only:
        return command("diagnose", recording, told.robot_argument)
    if not told.lookup:
        return command("diagnose", recording, told.robot_argument, "--lookup")
    return command("identify", recording, told.robot_argument)


def _against(told: DiagnosisInput) -> list[str]:
    """Return what other logs say against the model after."""
    found, said = [], "what was found may not hold beyond the log that it was found in"
    for check in told.checks:
        for joint, after in check.after.items():
            before = check.before[joint].rms
            if after.rms > WORSE * before:
                unit = torque_unit(told.found.robot, joint)
                sizes = f"{number_text(before, 3)} → {number_text(after.rms, 3)} {unit}"
                found.append(f"{_files(check.recording)}: {joint} is predicted worse than before, {sizes}: {said}")
    return found


def _files(recording: Recording) -> str:
    return ", ".join(recording.files)
