"""The answer of ``elid validate``: how well a described robot predicts a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from elid_cli.estimation.judgement import Judgement
from elid_cli.estimation.result import Nuisance
from elid_cli.estimation.validation.prediction import ByLog, Validation
from elid_cli.estimation.validation.sufficiency import ABOVE, above_noise
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import as_observed
from elid_cli.report.answers import inputs
from elid_cli.report.answers.error_tables import error_table, log_table, sensor_table
from elid_cli.report.answers.identification_json import error_payload, model_payload
from elid_cli.report.answers.lacking import lacking_words, moment_words, rows_words
from elid_cli.report.answers.summary import answers, listed, trust_words
from elid_cli.report.tree import KeyValues, Report, Section, Text, number_text, warned
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording


def validation_report(
    found: Validation, recording: Recording, robot_argument: str, held_out: Sequence[tuple[float, float]] = (),
    cases: Sequence[ByLog] = (), said: Judgement | None = None,
) -> Report:  # fmt: skip
    """Return the report of one validation, judged on some stretches (first and last time, s) or on the whole log.

    `cases` are the errors on each of several logs, and those of other robots; `said` is what the residual says of the
    model (`judge_prediction`).
    """
    said = said or Judgement((), ())
    acting = as_observed(found.robot, recording).effects
    effects = ", ".join(f"{spec.effect} {spec.joint or ''}".strip() for spec in acting)
    facts = (
        *inputs.recorded_items(found.robot, recording),
        *inputs.used_items(found.settings),
        ("predicted with", f"the robot file's own values{f' and {effects}' if effects else ''}; nothing was fitted"),
        *((("judged on", f"what diagnose holds out: {inputs.span_words(held_out)}"),) if held_out else ()),
    )
    payload = {
        **validation_payload(found, said),
        "log": inputs.log_payload(recording),
        "held_out": held_out,
    }
    if cases:
        payload["error_by_log"] = [{"file": case.file, "error": error_payload(case.error)} for case in cases]
    sections: tuple[Section, ...] = (
        inputs.heading(found.robot, recording),
        *validation_sections(found, said, recording.warnings),
        *log_table(found.robot, cases),
        KeyValues("inputs", facts, "how it was computed"),
        Text("next", inputs.command("diagnose", recording, robot_argument), "next"),
    )
    return Report("validate", payload, sections)


def validation_sections(found: Validation, said: Judgement, warnings: Sequence[str] = ()) -> list[Section]:
    """Return what a prediction says of the robot: can it be trusted, what is missing, the error of every joint.

    Parameters
    ----------
    found, said
        The prediction, and what its residual says of the model.
    warnings
        What reading the log warned of.
    """
    error = above_noise(found.error, found.robot, said.noise)
    lacking = {item.joint for item in said.insufficient}
    missing = _missing(said, alone=found.robot.n == 1) + _constant_words(found, said)
    return [
        answers(trust_words(found.robot, error, lacking, warnings), missing, "", ""),
        *warned(warnings),
        error_table(found.robot, error, "torque of each joint", fitted=False, lacking=lacking),
        *sensor_table(found.robot, found.error),
    ]


def _missing(said: Judgement, *, alone: bool) -> str:
    """Return what the described robot lacks: an effect, or other values of its parameters."""
    if said.misfitted and not said.insufficient:
        rows, moment = rows_words(said.misfitted), moment_words(said.noise)
        return (
            f"Perhaps no effect: values of parameters other than this file's, a delay or an offset of the torque would "
            f"explain that {rows}.{moment}"
        )
    return lacking_words(said.model, said.insufficient, said.noise, alone=alone)


def _constants(found: Validation, said: Judgement) -> dict[str, float]:
    """Return the constant torque that is most of what is left, by joint, of joints where that is more than noise."""
    above = {item.joint for item in said.noise if item.rows == "sum" and item.ratio > ABOVE}
    return {name: value for name, value in found.constants.items() if name in above}


def _constant_words(found: Validation, said: Judgement) -> str:
    """Return which joints' error is a constant for the most part, in a sentence after another; nothing of none."""
    units = {joint.name: joint.units[1] for joint in found.robot.joints}
    told = [f"{number_text(value, 3)} {units[name]} at {name}" for name, value in _constants(found, said).items()]
    return f" Most of that is a constant, as of an offset of the torque: {listed(told)}." if told else ""


def validation_payload(found: Validation, said: Judgement | None = None) -> dict[str, Any]:
    """Return the JSON object of a validation, without the log and the stretches that it was judged on."""
    said = said or Judgement((), ())
    return {
        **inputs.robot_payload(found.robot),
        "settings": found.settings,
        "error": error_payload(above_noise(found.error, found.robot, said.noise)),
        **model_payload(said.model, said.noise, said.insufficient),
        "misfitted": said.misfitted,
        "constant": _constants(found, said),
        "nuisances": inputs.nuisance_payload(_corrected(found.robot)),
    }


def _corrected(robot: Robot) -> list[Nuisance]:
    """Return what the robot file says of the channels, which were corrected."""
    kinds = effect_classes()
    return [
        Nuisance(spec.effect, spec.joint or "", dict(spec.parameters), {})
        for spec in robot.effects
        if kinds[spec.effect].nuisance or kinds[spec.effect].corrects
    ]
