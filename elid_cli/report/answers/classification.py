"""Classes of the standard parameters: what the equations allow, and what a log adds to that."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.verdicts import hidden_by_rest
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.report.answers import inputs
from elid_cli.report.answers.known import parameter_words
from elid_cli.report.answers.summary import NOT_SHOWN, ROUGH, RULE, called
from elid_cli.report.tree import Cell, Column, Folded, KeyValues, Mark, Report, Section, Table, Text, Tone, number_text
from elid_cli.robot.parameter import JOINT_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording

WORDS: dict[str, tuple[str, Tone]] = {
    "independent": ("indep.", "good"),
    "combined": ("comb.", "plain"),
    "unidentifiable": ("–", "dim"),
    "weak": (ROUGH, "warn"),
    "not excited": (NOT_SHOWN, "bad"),
}
"""Class -> word and tone in the grid of joints and parameters."""
MOST_TERMS = 4
"""Terms of a combination that a table always shows."""
REASONS = 12
"""Reasons printed without --all."""
LEGEND = "indep.: identifiable by itself; comb.: in a combination only; –: no effect on any torque"
LEGEND_LOG = f"{LEGEND}; {ROUGH}: not {RULE}; {NOT_SHOWN}: by this log"


def classification_report(
    robot: Robot, base: BaseParameters, robot_argument: str, found: Identification | None, recording: Recording | None
) -> Report:
    """Return the report of ``elid classify``, with a log (`found` and `recording`) or from structure alone."""
    payload: dict[str, Any] = inputs.robot_payload(robot)
    facts: inputs.Items = ()
    if found is not None and recording is not None:
        payload["log"] = inputs.log_payload(recording)
        facts = (*inputs.recorded_items(robot, recording), *inputs.used_items(found.settings))
    payload |= base_payload(base, found)
    sections: list[Section] = [
        inputs.heading(robot, recording),
        Text("answer", _answer(base, found)),
        KeyValues("inputs", (*(facts or inputs.note_items(robot)), *count_items(base))),
        _base_table(base, found),
        grid("classes", "structural class", robot, base.classes, LEGEND),
    ]
    if found is not None:
        sections.append(grid("this_log", "class in this log", robot, found.this_log, LEGEND_LOG))
        sections += reasons_table(found)
        sections.append(Text("next", inputs.command("identify", recording, robot_argument), "next"))
    else:
        sections.append(Text("next", inputs.command("identify", None, robot_argument), "next"))
    return Report("classify", payload, tuple(sections))


def _answer(base: BaseParameters, found: Identification | None) -> str:
    """Return what motion can show of the parameters, and what a log shows of that."""
    counts = base.counts
    told = {f"{counts['independent']} of the {counts['parameters']} parameters by themselves": counts["independent"],
            f"{counts['combined']} only in combinations": counts["combined"]}  # fmt: skip
    never = f"; {counts['unidentifiable']} never act on any torque" if counts["unidentifiable"] else ""
    possible = f"Motion can show {', '.join(words for words, count in told.items() if count)}{never}."
    return possible if found is None else f"{possible} {parameter_words(found)}"


def base_sections(base: BaseParameters) -> list[Section]:
    """Return the base parameters by themselves."""
    return [KeyValues("inputs", count_items(base)), _base_table(base, None)]


def base_payload(base: BaseParameters, found: Identification | None = None) -> dict[str, Any]:
    """Return the keys of JSON on counts, classes and base parameters."""
    return {**class_payload(base, found), "base_parameters": [_entry(base, k, found) for k in range(base.count)]}


def class_payload(base: BaseParameters, found: Identification | None) -> dict[str, Any]:
    """Return the keys of JSON on counts and classes."""
    payload: dict[str, Any] = {
        "counts": base.counts,
        "structural_rank_margin": base.margin,
        "classification": dict(base.classes),
    }
    if found is not None:
        payload["this_log"] = dict(found.this_log)
        payload["reasons"] = dict(found.reasons)
    return payload


def count_items(base: BaseParameters) -> inputs.Items:
    """Return the counts in words."""
    counts = base.counts
    return (
        (
            "parameters",
            f"{counts['parameters']} standard, {counts['base']} base; {counts['independent']} independent, "
            f"{counts['combined']} combined, {counts['unidentifiable']} unidentifiable",
        ),
        ("rank margin", f"{number_text(base.margin, 1)} between the last kept and the first dropped"),
    )


def grid(key: str, title: str, robot: Robot, classes: Mapping[str, str], legend: str) -> Table:
    """Return a table of kinds by joints, one word per parameter."""
    columns = (Column("parameter", ""), *(Column(joint.name, joint.name) for joint in robot.joints))
    rows: list[tuple[Cell, ...]] = []
    for kind in JOINT_PARAMETERS:
        cells = [_word(classes.get(StandardParameter(kind, i - 1))) for i in range(1, robot.n + 1)]
        if any(cells):
            rows.append((kind, *cells))
    return Table(key, columns, tuple(rows), title=title, note=legend)


def _word(kind: str | None) -> Cell:
    if kind is None:
        return ""
    word, tone = WORDS.get(kind, (kind, "plain"))
    return Mark(word, tone)


def reasons_table(found: Identification, hiding: Collection[int] = ()) -> list[Section]:
    """Return why parameters that the robot could identify are weak or missing; nothing where none is.

    `hiding` are joints at which so much stays unexplained that it hides what the motion shows.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    names, places = found.robot.joint_names, {str(name): name.joint for name in found.base.parameters}
    for name, kind in found.this_log.items():
        if kind in ("weak", "not excited"):
            reason = found.reasons.get(name, "")
            if places.get(name) in hiding:  # a stiffness looked for from the motor side is none of the model's
                reason = hidden_by_rest(reason, names[places[name]])
            groups.setdefault((kind, reason), []).append(name)
    if not groups:
        return []
    columns = Column.texts(parameter="parameter", this_log="this log", reason="why")
    rows = tuple((" ".join(names), Mark(*WORDS[kind]), reason) for (kind, reason), names in groups.items())
    return [Table("reasons", columns, rows, title="what this log cannot show", shown=REASONS)]


def _base_table(base: BaseParameters, found: Identification | None) -> Table:
    columns = [*Column.texts(name="base parameter", unit="unit")]
    if found is not None:
        columns.append(Column("verdict", "this log"))
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate(base.names):
        verdict: tuple[Cell, ...] = () if found is None else (verdict_mark(found.verdict[k]),)
        rows.append((folded(name, base.terms[k]), base.units[k], *verdict))
    return Table("base_parameters", tuple(columns), tuple(rows))


def folded(name: str, terms: Mapping[str, float]) -> Cell:
    """Return a base parameter's name; a combination of many terms folds to its leading one and their number."""
    if len(terms) <= MOST_TERMS:
        return name
    return Folded(name, called(" + ".join(terms)))


def verdict_mark(verdict: str) -> Mark:
    """Return a verdict with its tone."""
    words: dict[str, tuple[str, Tone]] = {
        "supported": ("known", "plain"), "weak": (ROUGH, "warn"), "refused": (NOT_SHOWN, "bad"),
    }  # fmt: skip
    return Mark(*words.get(verdict, (verdict, "plain")))


def _entry(base: BaseParameters, k: int, found: Identification | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": base.names[k], "terms": dict(base.terms[k]), "unit": base.units[k]}
    if found is not None:
        entry["verdict"] = found.verdict[k]
    return entry
