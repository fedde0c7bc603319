"""The answer of ``elid diagnose``: the residual, the effects that the model lacks, the error before and after."""

from __future__ import annotations

from dataclasses import replace

from elid_cli.diagnosis import Diagnosis
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.estimation.result import Identification
from elid_cli.report.answers import diagnosis_tables as tables
from elid_cli.report.answers import inputs, summary
from elid_cli.report.answers.classification import reasons_table
from elid_cli.report.answers.diagnosis_input import DiagnosisInput, referenced
from elid_cli.report.answers.diagnosis_json import diagnosis_payload
from elid_cli.report.answers.error_tables import torque_unit
from elid_cli.report.answers.identification import base_tables
from elid_cli.report.answers.known import parameter_words, some
from elid_cli.report.answers.missing import further_items, held_out_size, loud_rows, missing_words, repeating
from elid_cli.report.tree import KeyValues, Report, Section, Text, number_text, warned
from elid_cli.signals.recording import Recording

MOVED = 3.0
"""Shift of a base parameter, in standard deviations, that is worth a word."""
WORSE = 1.1
"""Error after over that before on another log from which it speaks against what was found."""
HIDES = 3.0
"""Times the sensors' noise from which on what is left hides parameters."""
NEARER = 0.7
"""Part of the difference from the robot file's parameters below which what is left of it is worth a word."""


def diagnosis_report(told: DiagnosisInput) -> Report:
    """Return the report of one diagnosis."""
    found, recording = told.found, told.recording
    facts = (
        *inputs.recorded_items(found.robot, recording),
        *inputs.used_items(told.after.settings),
        *inputs.nuisance_items(found.robot, found.corrected),
        *_tried(found),
        *(("note", sentence) for sentence in told.after.notes),
    )
    sharper, following = further_items(told), _next(told)
    record, planned = summary.record_sections(
        told.after,
        sharper,
        (recording.files[0], told.robot_argument),
        writes=not _another_log(told),
        written=told.written is not None,
        plan=_another_log(told),
        following=following,
    )
    sections: list[Section] = [
        inputs.heading(found.robot, recording),
        summary.answers(
            _trust_words(told),
            missing_words(told) + _loud_words(told),
            parameter_words(told.after, _in_doubt(found, told.after)),
            record,
        ),
        *([Text("partial", summary.PARTIAL, "warning")] if found.partial else []),
        *warned((*_repeating(found), *_worse(found), *_against(told)), "against"),
        *warned((*recording.warnings, *told.after.warnings)),
        *result_sections(told),
        *(
            tables.before_after_table(
                f"check{k}", found.robot, check.before, check.after, f"error on {_files(check.recording)}"
            )
            for k, check in enumerate(told.checks)
        ),
        *base_tables(told.after),
        *_moved_section(told),
        *reasons_table(told.after, hiding=_hiding(told.found)),
        *planned,
        KeyValues("inputs", facts, "how it was computed"),
        Text("next", following, "next"),
    ]
    return Report("diagnose", diagnosis_payload(told), tuple(sections))


def result_sections(told: DiagnosisInput) -> list[Section]:
    """Return what was found: effects, the error before and after, residuals, what stays."""
    found = told.found
    return [
        *tables.effect_sections(told),
        tables.before_after_table(
            "before_after",
            found.robot,
            found.before,
            found.after,
            "error on the held-out stretches, which the fit never saw",
            changed=bool(told.contributions),
        ),
        *_as_identified(found),
        *([tables.residual_table(found)] if found.effects or any(row.high for row in found.rows_before) else []),
        *tables.refuted_section(found),
        *tables.unexplained_section(found),
        *tables.triage_section(found),
    ]


def _as_identified(found: Diagnosis) -> list[Section]:
    """Return the same at identification's cut-off, where the search's is another."""
    before, after = found.left_out
    other = found.predicted_worse or found.usual_cutoff != found.state_after.log.signals.filter.cutoff
    if not found.effects or not before or not other:
        return []
    title = f"error on stretches left out in turn, below {number_text(found.usual_cutoff)} Hz as in elid identify"
    table = tables.before_after_table("as_identified", found.robot, before, after, title)
    return [replace(table, note="as in the table above, at another filter: other figures of the same errors")]


def _tried(found: Diagnosis) -> inputs.Items:
    many = "effect at its joint" if found.tried == 1 else "effects at their joints"
    several = [f"below {number_text(cutoff)} Hz" for cutoff in found.searched_at]
    where = f", {', then '.join(several)}" if len(several) > 1 else ""
    return (("tried", f"{found.tried} {many}{where}; held out of the search: {inputs.span_words(found.held_out)}"),)


def _loud_words(told: DiagnosisInput) -> str:
    """Return in words which row holds more than white noise that has nothing to do with the motion."""
    rows = loud_rows(told.found)
    if not rows:
        return ""
    worst = rows[0]
    memory = [n.correlation for n in told.after.noise if n.joint == worst.joint]
    lasts = f" with a correlation time of {max(memory) * 1e3:.0f} ms" if memory else ""
    size = held_out_size(told.found, worst)[1]
    return (
        f" Yet {number_text(size, 2)} times the sensors' noise is left at {worst.joint}, and follows no single "
        f"variable of the motion. It may be torque noise{lasts}, or depend on several "
        f"{'variables' if told.found.robot.n == 1 else 'joints'} at once; this log cannot tell which."
    )


def _in_doubt(found: Diagnosis, after: Identification) -> list[str]:
    """Return the joints where what is left may be more than noise, and no parameter is marked as possibly biased."""
    lacking = {found.robot.joint_names[p.leader.joint] for p in after.parameters if p.bias_possible}
    left = {row.joint for row in loud_rows(found)} | {item.joint for item in found.unexplained}
    return [joint for joint in found.robot.joint_names if joint in left - lacking]


def _trust_words(told: DiagnosisInput) -> str:
    words = summary.trust_words(told.found.robot, told.found.after, warnings=told.recording.warnings)
    verdict, _, rest = words.partition(": ")
    if not told.contributions or not rest:
        return words
    added = "once" if words.startswith("Yes") else "even when"
    return f"{verdict}, {added} what is missing is added: {rest}"


def _moved_section(told: DiagnosisInput) -> list[Section]:
    """Return what holds of all parameters together: what the missing effects had moved, and how far the file is."""
    words = [tables.ADDED if told.contributions else ""]
    errors = {
        item.name: item.std_error for item in told.after.parameters
    }  # they reach to other forms of what was found
    moved = [
        m.name
        for m in told.found.moved
        if abs(m.deviations) > MOVED and abs(m.after - m.before) > MOVED * errors.get(m.name, 0.0)
    ]
    if moved and not told.found.unexplained:
        words.append(f"Without it these are biased by more than {MOVED:g} standard errors: {some(moved)}.")
    if referenced(told.before):
        first, last = (m.normalised_mean_error() for m in (told.before, told.after))
        change = (
            f"{summary.share_text(first)} before, {summary.share_text(last)} after"
            if told.contributions
            else summary.share_text(last)
        )
        if not told.contributions or last < NEARER * first:  # the file need not be true: a small change says nothing
            words.append(f"Mean difference of all base parameters from the robot file: {change}.")
    said = "\n".join(word for word in words if word)
    return [Text("all_parameters", said)] if said else []


def _hiding(found: Diagnosis) -> set[int]:
    """Return the joints at which many times the sensors' noise is left."""
    return {found.robot.joint_names.index(r.joint) for r in found.rows_after if r.high and r.ratio > HIDES}


def _hopeless(told: DiagnosisInput) -> bool:
    """Whether the model is poor and no parameter of it known: what is missing then is another log, not its file."""
    poor = any(summary.light(error).text == summary.POOR for error in told.found.after.values())
    return poor and not any(p.verdict == "supported" and not p.bias_possible for p in told.after.parameters)


def _another_log(told: DiagnosisInput) -> bool:
    """Whether another log is what comes next, not a robot file.

    That is where a written file would not hold what was found, or where the model is poor and nothing was found.
    """
    poor = any(summary.light(error).text == summary.POOR for error in told.found.after.values())
    return _hopeless(told) or bool(told.found.predicted_worse) or (poor and not told.contributions)


def _next(told: DiagnosisInput) -> str:
    found, recording = told.found, told.recording
    if found.partial:
        return inputs.command("diagnose", recording, told.robot_argument)
    if _another_log(told) and (found.sufficient or found.predicted_worse) and told.written is None:
        return summary.plan_command(recording.files[0], told.robot_argument)
    if found.sufficient:
        keep = inputs.keeping(found.robot, "identified", [spec.effect for spec in found.robot.effects])
        return inputs.command("identify", recording, told.robot_argument, *keep)
    if _hopeless(told):
        return summary.plan_command(recording.files[0], told.robot_argument)
    if told.written is not None:
        return inputs.command("validate", recording, told.written, "--held-out")
    if told.contributions:
        refined = inputs.keeping(found.robot, "refined", [spec.effect for spec in found.refined.effects])
        tried = [word for name in told.only for word in ("--only", name)]
        lookup = ("--lookup",) if told.lookup else ()
        return inputs.command("diagnose", recording, told.robot_argument, *tried, *lookup, *refined)
    if told.only:
        return inputs.command("diagnose", recording, told.robot_argument)
    if not told.lookup:
        return inputs.command("diagnose", recording, told.robot_argument, "--lookup")
    return inputs.command("identify", recording, told.robot_argument)


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


def _repeating(found: Diagnosis) -> list[str]:
    """Return what is said of a motion that repeats, where something was found in it or stays unexplained."""
    if not repeating(found):
        return []
    return [
        f"the motion repeats every {number_text(found.repeats, 3)} s. A disturbance that repeats in time would look "
        "like an effect of the motion, and held-out stretches repeat what was fitted."
    ]


def _worse(found: Diagnosis) -> list[str]:
    """Return what is said where parameters estimated with what was found predict left-out torque worse."""
    if not found.predicted_worse:
        return []
    before, after = found.left_out
    sizes = [
        f"{joint} {first} → {last} {torque_unit(found.robot, joint)}"
        for joint in found.predicted_worse
        if (first := number_text(before[joint].rms, 3)) != (last := number_text(after[joint].rms, 3))
    ]
    errors = f" ({summary.listed(sizes)})" if sizes else ""
    where = summary.listed(list(found.predicted_worse))
    return [
        f"below {number_text(found.usual_cutoff)} Hz, where elid identify fits, what was found makes the prediction of "
        f"{where} worse on stretches that no fit saw{errors}. A written robot file therefore keeps the parameters from "
        "before; of what was found it holds only stiffnesses and encoder faults."
    ]


def _files(recording: Recording) -> str:
    return ", ".join(recording.files)


def event_words(effect: FoundEffect) -> str:
    """Return that something happened in this log alone and is in no robot file, as a sentence."""
    when = effect.parameters.get("time")
    at = "" if when is None else f" at {number_text(when, 3)} s"
    return f"The {effect.effect.replace('_', ' ')} of {effect.joint}{at} is of this log, not of the robot: left out."
