"""The answer of ``elid diagnose`` on a log of commands: effects judged by the motion simulated under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot
from typing import Any

from elid_cli.diagnosis.by_motion.result import MotionDiagnosis, mean_abs_of
from elid_cli.diagnosis.result import FoundEffect, Rival
from elid_cli.estimation.trajectory.differing import Differing
from elid_cli.estimation.trajectory.fit import ABOVE
from elid_cli.logs.checks.known_masses import AGAINST
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.report.answers import inputs
from elid_cli.report.answers.diagnosis_json import forms_payload
from elid_cli.report.answers.diagnosis_tables import ADDED, SAME, form_words
from elid_cli.report.answers.drives import drives_needed
from elid_cli.report.answers.identification import base_tables
from elid_cli.report.answers.identification_json import error_payload, identification_payload
from elid_cli.report.answers.known import parameter_words
from elid_cli.report.answers.missing import named_words, replaced, spoken, variable_words, whose
from elid_cli.report.answers.motion_doubts import (
    alike_words,
    between_words,
    bodies_words,
    free_bodies_words,
    gains_words,
    load_words,
    mean_off,
    owned_words,
    scale_words,
)
from elid_cli.report.answers.summary import PARTIAL, answers, doubted, listed, record_sections, share_text
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
    picked,
    warned,
)
from elid_cli.robot.position_words import largest_words

METHOD = "judged by the simulated motion, on stretches that the values were not fitted to"
RIGID = " The joints are taken as rigid: play and compliance of their transmissions are not tried."


def motion_diagnosis_report(found: MotionDiagnosis, robot_argument: str, written: str | None = None) -> Report:
    """Return the report of a diagnosis by motion.

    Parameters
    ----------
    found
        The diagnosis.
    robot_argument
        What ``--robot`` was given.
    written
        elid's robot file that was written, if any.
    """
    recording = found.recording
    further = {
        f"to tell {whose(r.effect, r.joint)} from {replaced(r, found.effects)}": r.separate for r in found.also_possible
    }
    record, planned = _record(found, tuple(further.items()), robot_argument)
    sections: list[Section] = [
        inputs.heading(found.robot, recording),
        answers(_trust(found), _missing(found), parameter_words(found.after), record),
        *([Text("partial", PARTIAL, "warning")] if found.partial else []),
        *warned((*_log_warnings(found), *found.after.warnings)),
        *_effect_sections(found),
        _position_table(found),
        *_differing_section(found),
        *_unexplained_section(found),
        *base_tables(found.after),
        *([Text("all_parameters", ADDED)] if found.effects else []),
        *planned,
        KeyValues("inputs", (
            *inputs.recorded_items(found.robot, recording), *inputs.nuisance_items(found.robot, found.after.nuisances),
            ("tried", f"{found.tried} effects at their joints; {METHOD}"),
            *([("not tried", f"{', '.join(found.untried)}; --lookup judges by the computed torque, which holds them")]
              if found.untried else []),
            *(("note", note) for note in found.after.notes),
        ), "how it was computed"),
        Text("next", _next(found, robot_argument, written), "next"),
    ]  # fmt: skip
    return Report("diagnose", motion_diagnosis_payload(found), tuple(sections))


def motion_diagnosis_payload(found: MotionDiagnosis) -> dict[str, Any]:
    """Return the JSON object of a diagnosis by motion (docs/reference/json.md)."""
    before, after = found.mean_abs
    payload = identification_payload(found.after, replace(found.recording, warnings=_log_warnings(found)))
    if found.free_bodies is not None:
        payload["warnings"].append(free_bodies_words(found))
    if found.alone:
        payload["warnings"].append(between_words(found).strip())
    return {
        **payload,
        "judged_by": "motion",
        "declared": [],
        "before": {"error": error_payload(found.before.error), "published": {}, "mean_abs": before},
        "after": {"error": error_payload(found.after.error), "published": {}, "mean_abs": after},
        "position": {name: {"before": p.before, "after": p.after} for name, p in found.position.items()},
        "effects": [
            {**picked(e, "effect joint parameters std_error gain summary"), "forms": forms_payload(e)}
            for e in found.effects
        ],
        "nuisances": inputs.nuisance_payload(found.after.nuisances),
        "also_possible": [_rival(r) for r in found.also_possible],
        "unexplained": [{**picked(u, "joint rows variable share rms ratio"), "nearest": []} for u in found.unexplained],
        "differing": [
            {**picked(d, "name joint unit values std_error"),
             "changed_at": None if d.changed_at is None else found.recording.files[d.changed_at]}
            for d in found.differing
        ],
        **{key: [] for key in ("refuted", "triage", "organised", "held_out", "moved", "checks")},
        **({"partial": True} if found.partial else {}),
        "sufficient": found.sufficient,
        "tried": found.tried,
        "untried": list(found.untried),
        "other_bodies": dict(found.other_bodies),
        **({} if found.free_bodies is None else {"free_bodies": {"mean_abs": mean_abs_of(found.free_bodies)}}),
    }  # fmt: skip


def _log_warnings(found: MotionDiagnosis) -> tuple[str, ...]:
    """Return the warnings of the log, without what an effect explains: a torque against the weight, as of a spring.

    With a wrong sign the bodies' weight would not move the robot as it was measured.
    """
    explained = found.effects and not found.unexplained
    return tuple(line for line in found.recording.warnings if not (explained and AGAINST in line))


def _rival(rival: Rival) -> dict[str, Any]:
    beside = [picked(effect, "effect joint parameters std_error") for effect in rival.beside]
    return picked(rival, "effect joint gain instead_of parameters separate") | ({"beside": beside} if beside else {})


def _trust(found: MotionDiagnosis) -> str:
    before, after = (mean_off(found, fit, bare=k == 0) for k, fit in enumerate((found.fit_before, found.fit_after)))
    most = largest_words(found.robot, {name: own.after for name, own in found.position.items()})
    left = found.unexplained
    verdict = (
        f"Not down to the encoders' noise{' at ' + listed([u.joint for u in left])}"
        if left
        else "Mostly"
        if found.near
        else "Yes"
    )
    added = ", " + ("even when" if left else "once") + " what is missing is added" if found.effects else ""
    was = f" ({before} without)" if found.effects else ""
    words = (
        f"{verdict}{added}: the motion simulated under the commands is off by {after} on average{was}, at most by "
        f"{most}.{owned_words(found)}"
    )
    # with wrong units or signs the bodies' weight and the gains would not move the robot as it was measured
    return doubted(words, (*(found.recording.warnings if left else ()), *found.after.warnings))


def _missing(found: MotionDiagnosis) -> str:
    left = f" More than noise is left at {listed([u.joint for u in found.unexplained])}." if found.unexplained else ""
    if found.near:
        most = number_text(max(found.near.values()), 2)
        left += (
            f" What is left at {listed(list(found.near))} is up to {most} times the encoders' noise: no noise alone."
        )
    rigid, between = RIGID if found.unexplained else "", between_words(found)
    first = free_bodies_words(found)
    if found.partial and not found.effects:
        return f"Not known yet: the search was stopped before anything was judged.{left}"
    if not found.effects:
        others = f" Not tried by motion: {_untried_words(found)}." if found.untried else ""
        beside = f"{bodies_words(found)}{left}{between}{others}{rigid}"
        return f"{first}{between}" if first else f"No effect that was tried by motion brings the motion nearer.{beside}"
    places: dict[str, list[str]] = {}
    for effect in found.effects:
        joint = _place(found, effect)
        if joint not in places.setdefault(effect.effect, []):
            places[effect.effect].append(joint)
    changed = [d for d in found.differing if d.changed_at is not None and d.of_effect]
    moved = "".join(
        f" {d.name} of {d.joint} changed before {found.recording.files[d.changed_at or 0]}." for d in changed
    )
    named = named_words(places, found.also_possible)
    if first:
        first = f"{first} With the bodies of the file: "
        named = named.replace("One of", "one of", 1) if named.startswith("One of") else named
    doubts = f"{load_words(found)}{scale_words(found)}{moved}{gains_words(found)}{alike_words(found)}"
    doubts += left if found.near else ""
    return f"{first}{named}{doubts}{bodies_words(found)}{between}{rigid}"


def _untried_words(found: MotionDiagnosis) -> str:
    begins = effect_that(carried=True).name
    names = [f"{spoken(name)} that begins later" if name == begins else spoken(name) for name in found.untried]
    return f"{listed(names)} (--lookup judges these by the computed torque)"


def _record(found: MotionDiagnosis, further: inputs.Items, robot_argument: str) -> tuple[str, list[Section]]:
    """Return what the next log should hold, in a sentence and as a list."""
    further = (*further, *drives_needed(found.after))
    record, planned = record_sections(found.after, further, (found.recording.files[0], robot_argument))
    if planned:
        return record, planned
    if found.unexplained:
        left = [item.joint for item in found.unexplained]
        alone = (
            f"motion of {left[0]} alone, then of the others with it still"
            if len(left) == 1
            else "motion of each of them alone"
        )
        return f"What tells what is left at {listed(left)}: {alone}.", []
    return "Nothing more for these parameters; another run of the same machine would check them (elid replay).", []


def _effect_sections(found: MotionDiagnosis) -> list[Section]:
    waiting = [KeyValues("waiting", tuple((joint, effect) for effect, joint in found.waiting),
                         "chosen but not judged yet when it was stopped")] if found.waiting else []  # fmt: skip
    if not found.effects:
        if found.partial:
            return [*waiting]
        return [Text("effects", "No effect that a simulated motion can hold explains what is left.")]
    columns = (*Column.texts(effect="effect", joint="joint"), Column("gain", "explains", align="right"))
    rows: list[tuple[Cell, ...]] = [(e.effect, e.joint, percent(e.gain)) for e in found.effects]
    note = "explains: share of the joint's squared error, " + METHOD
    meanings: list[tuple[str, Cell]] = [
        (
            whose(e.effect, e.joint),
            f"{e.summary}: {inputs.effect_text(found.robot, e.effect, e.joint, e.parameters, e.std_error)}"
            f"{_constant_words(e)}{form_words(found.robot, e)}",
        )
        for e in found.effects
    ]
    tables: list[Section] = [Table("effects", columns, tuple(rows), title="missing from the model", note=note),
                             KeyValues("meaning", tuple(meanings)), *waiting]  # fmt: skip
    rivals: list[tuple[str, Cell]] = [
        (whose(r.effect, r.joint), f"in place of {replaced(r, found.effects)} it explains {share_text(r.gain)}")
        for r in found.also_possible
    ]
    return [*tables, *([KeyValues("also_possible", tuple(rivals), SAME)] if rivals else [])]


def _constant_words(effect: FoundEffect) -> str:
    """Return which parameters of an effect only add a constant torque, which the joint's offset adds as well."""
    kind = effect_classes()[effect.effect]
    names = [p.name for p in kind.amplitudes if p.name in effect.parameters and p.name not in effect.std_error]
    if not names or not effect.std_error:
        return ""
    return f"; {listed(names)}: only the sum with the torque offset shows"


def _position_table(found: MotionDiagnosis) -> Table:
    columns = (
        *Column.texts(joint="joint", trust="motion"),
        *Column.numbers(before="before", after="after", torque="torque error after"),
    )
    rows: list[tuple[Cell, ...]] = []
    left = {item.joint for item in found.unexplained}
    for joint in found.robot.joints:
        unit = f"m{joint.units[0]}"
        item, torque = found.position[joint.name], found.after.error.get(joint.name)
        rows.append((
            joint.name, Mark("above noise", "warn") if joint.name in left else Mark("near noise", "good"),
            Quantity(1e3 * item.before, unit, 3), Quantity(1e3 * item.after, unit, 3),
            None if torque is None else percent(torque.relative),
        ))  # fmt: skip
    return Table("position", columns, tuple(rows), title="rms error of the simulated position",
                 note=f"{METHOD}; near noise: within {ABOVE:g} times the encoder's noise")  # fmt: skip


def _differing_section(found: MotionDiagnosis) -> list[Section]:
    if not found.differing:
        return []
    return [KeyValues("differing", tuple((f"{d.joint} {d.name}", _differing_words(found, d)) for d in found.differing),
                      "what the recordings do not agree on")]  # fmt: skip


def _differing_words(found: MotionDiagnosis, item: Differing) -> str:
    values = ", ".join(number_text(v, 3) for v in item.values)
    usual = hypot(*item.std_error) / len(item.std_error) ** 0.5
    change = f"; changed before {found.recording.files[item.changed_at]}" if item.changed_at is not None else ""
    return f"{values} {item.unit} (± {number_text(usual, 1)}){change}"


def _unexplained_section(found: MotionDiagnosis) -> list[Section]:
    if not found.unexplained:
        return []
    items: list[tuple[str, Cell]] = []
    for u in found.unexplained:
        unit = f"m{found.robot.joint(u.joint).units[0]}"
        items.append((
            u.joint, f"{number_text(1e3 * u.rms, 2)} {unit} rms, {number_text(u.ratio, 2)} times the encoder's noise; "
            f"{share_text(u.share)} follows the {variable_words(u.variable)}",
        ))  # fmt: skip
    return [KeyValues("unexplained", tuple(items), "left unexplained")]


def _next(found: MotionDiagnosis, robot_argument: str, written: str | None) -> str:
    if found.partial:
        return inputs.command("diagnose", found.recording, robot_argument)
    if found.free_bodies is not None:
        bodies = f"{found.robot.name}-identified.yaml"
        return inputs.command("identify", found.recording, robot_argument, "--fit", "torque", "--write-robot", bodies)
    if written is not None:
        return inputs.command("replay", found.recording, written)
    if found.effects:
        return inputs.command(
            "diagnose", found.recording, robot_argument, "--write-robot", f"{found.robot.name}-refined.yaml"
        )
    return inputs.command("identify", found.recording, robot_argument, "--fit", "trajectory")


def _place(found: MotionDiagnosis, effect: FoundEffect) -> str:
    """Return where an effect is, in words: its joint, the last one of a load, or the robot."""
    kind = effect_classes().get(effect.effect)
    load = kind is not None and kind.carried
    return effect.joint or (found.robot.joint_names[-1] if load else found.robot.name)


def named_effects(found: MotionDiagnosis) -> Sequence[str]:
    """Return what `--fail-on-effect` says is missing, one sentence each."""
    library = effect_classes()
    lacks = [f"{_place(found, e)}: the model lacks {e.effect}" for e in found.effects if e.effect in library]
    return [*lacks, *([f"{found.robot.name}: the bodies are others"] if found.free_bodies is not None else [])]
