"""The answer of ``elid diagnose``: the residual, the effects that the model lacks, the error before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan
from typing import Any

from elid_cli.diagnosis import Diagnosis, FoundEffect, Unexplained
from elid_cli.diagnosis.contributions import Contribution
from elid_cli.diagnosis.triage import Organised, RowState
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
from elid_cli.reports.diagnosis_words import curve_words, variable_words, whose
from elid_cli.reports.identification import AT_FLOOR, identification_payload, torque_unit
from elid_cli.reports.identification import error_payload as errors
from elid_cli.reports.inputs import (
    Items,
    command,
    effect_text,
    heading,
    log_payload,
    nuisance_items,
    nuisance_payload,
    recorded_items,
    span_words,
    used_items,
)
from elid_cli.robot import Robot

MOVED = 3.0
"""Shift of a base parameter, in standard deviations, that is worth a word."""
NAMED = 5
"""How many moved base parameters are named."""
FOLLOWS = 0.05
"""Share of a residual's variance that must follow a variable for the variable to be named."""
NEAR = 0.005
"""Share of the residual that an effect must take away to be called near."""
_KEPT = "; fitted along all the same, as no two encoders have the same zero"


@dataclass(frozen=True)
class Check:
    """The models before and after on a log that neither was fitted to."""

    recording: Recording
    before: Mapping[str, JointError]
    after: Mapping[str, JointError]


@dataclass(frozen=True)
class Told:
    """A diagnosis with what goes with it in a report."""

    found: Diagnosis
    before: Identification
    after: Identification
    contributions: Sequence[Contribution]
    recording: Recording
    robot_argument: str
    """What ``--robot`` was given."""
    checks: Sequence[Check] = field(default_factory=tuple)
    written: str | None = None
    """The robot file that was written, if any."""
    lookup: bool = False
    """Whether a smooth curve was asked for."""


CURVES = (
    "gain of a friction curve of several terms: of what the held-out stretches show beyond noise when the trajectory is"
    " held to the equations of motion, what all terms take together"
)


def diagnosis_report(told: Told) -> Report:
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
        _residual(found),
        *([Text("triage", "\n".join(found.triage))] if found.triage else []),
        *_effects(told),
        _before_after("before_after", found.robot, found.before, found.after, "error on the held-out stretches"),
        *_refuted(found),
        *_unexplained(found),
        *(
            _before_after(f"check{k}", found.robot, check.before, check.after, f"error on {_files(check.recording)}")
            for k, check in enumerate(told.checks)
        ),
        *(Text(f"warning{k}", line, "warning") for k, line in enumerate((*recording.warnings, *told.after.warnings))),
        *_meaning(told),
    ]
    return Report("diagnose", diagnosis_payload(told), tuple(sections))


def diagnosis_payload(told: Told) -> dict[str, Any]:
    """Return the JSON object of a diagnosis (FORMATS: JSON)."""
    found = told.found
    return {
        **identification_payload(told.after, told.recording),
        "declared": nuisance_payload(told.after.effects),
        "before": _side(found.before, found.rows_before, told.before),
        "after": _side(found.after, found.rows_after, told.after),
        "effects": [_effect_payload(c) for c in told.contributions],
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
        "refuted": [
            {"effect": s.effect, "joint": s.joint, "quarters": _quarters(s.gains), "gain": s.whole, "kept": s.kept}
            for s in found.refuted
        ],
        "triage": list(found.triage),
        "organised": [
            {"joint": joint, "rows": rows, "variable": o.variable, "share": o.share}
            for (joint, rows), entries in found.organised.items()
            for o in entries
        ],
        "sufficient": found.sufficient,
        "tried": found.tried,
        "held_out": [list(span) for span in found.held_out],
        "moved": [
            {"name": m.name, "before": m.before, "after": m.after, "deviations": m.deviations} for m in found.moved
        ],
        "checks": [
            {"log": log_payload(c.recording), "before": {"error": errors(c.before)},
             "after": {"error": errors(c.after)}}
            for c in told.checks
        ],
    }  # fmt: skip


def _side(error: Mapping[str, JointError], rows: Sequence[RowState], model: Identification) -> dict[str, Any]:
    return {
        "error": errors(error),
        "rows": [{"joint": r.joint, "rows": r.rows, "rms": r.rms, "share": r.share, "ratio": r.ratio} for r in rows],
        "normalised_mean_error": model.normalised_mean_error() if _referenced(model) else None,
    }


def _effect_payload(contribution: Contribution) -> dict[str, Any]:
    effect = contribution.effect
    payload = {
        "effect": effect.effect,
        "joint": effect.joint,
        "parameters": dict(effect.parameters),
        "std_error": dict(effect.std_error),
        "gain": effect.gain,
        "summary": effect.summary,
        "folds": list(effect.folds),
        "quarters": _quarters(effect.quarters),
        "local": effect.local,
        "collocated": effect.collocated,
        "error": {
            "joint": contribution.joint,
            "rows": contribution.rows,
            "before": contribution.without,
            "after": contribution.with_it,
        },
    }
    return {**payload, "curve": curve_words(effect.parameters)} if effect.effect == "lookup" else payload


def _quarters(gains: Sequence[float]) -> list[float | None]:
    return [None if isnan(gain) else gain for gain in gains]


def _tried(found: Diagnosis) -> Items:
    return (("tried", f"{found.tried} effects at their joints; held out of the search: {span_words(found.held_out)}"),)


def _residual(found: Diagnosis) -> Table:
    columns = (
        Column("joint", "joint"),
        Column("rows", "row"),
        Column("rms", "residual", align="right"),
        Column("share", "share", align="right"),
        Column("ratio", "× floor", align="right"),
        Column("follows", "follows"),
    )
    rows: list[tuple[Cell, ...]] = []
    for row in sorted(found.rows_before, key=lambda r: found.robot.joint_names.index(r.joint)):
        high = row.high
        rows.append(
            (
                row.joint,
                row.rows,
                Quantity(row.rms, torque_unit(found.robot, row.joint), 3),
                percent(row.share),
                Quantity(row.ratio, digits=3, tone="warn" if high else "good"),
                _follows(found.organised.get((row.joint, row.rows), ())) if high else "",
            )
        )
    kinds = {row.rows for row in found.rows_before}
    notes = []
    if "motor" in kinds:
        notes.append("sum: motor torque against the whole model; motor: with the spring's torque from the deflection")
    if "spring" in kinds:
        notes.append(
            "load: torque sensor against the bodies; drive: motor torque less the sensor's against rotor and friction;"
            " spring: sensor against the deflection"
        )
    return Table("residual", columns, tuple(rows), title="what the model leaves", note="\n".join(notes))


def _follows(organised: Sequence[Organised]) -> str:
    named = [o for o in organised if o.share > FOLLOWS][:2]
    return ", ".join(f"{variable_words(o.variable)} {_share(o.share)}" for o in named) or "nothing known"


def _effects(told: Told) -> list[Section]:
    found = told.found
    named = [c for c in told.contributions if c.effect not in found.curves]
    curves = [c for c in told.contributions if c.effect in found.curves]
    sections: list[Section] = []
    if named:
        sections += _found(found.robot, "effects", "missing from the model", named)
        sections += _also_possible(found)
    elif not found.sufficient:
        sections.append(Text("effects", "No effect of the library explains it."))
    if curves:
        sections += _found(found.robot, "curves", "curves over what is left, asked for by --lookup", curves)
    return sections


def _found(robot: Robot, key: str, title: str, contributions: Sequence[Contribution]) -> list[Section]:
    """Return a table of effects with the error without and with each, and what each means."""
    columns = (
        Column("effect", "effect"),
        Column("joint", "joint"),
        Column("rows", "row"),
        Column("error", "held-out error", align="right"),
        Column("gain", "gain", align="right"),
        Column("worst_quarter", "worst quarter", align="right"),
    )
    rows: list[tuple[Cell, ...]] = []
    meanings: list[tuple[str, Cell]] = []
    places = [(c.effect.effect, c.effect.joint) for c in contributions]
    # terms of one curve stand together
    for c in sorted(contributions, key=lambda c: places.index((c.effect.effect, c.effect.joint))):
        effect, unit = c.effect, _unit(robot, c)
        error = f"{number_text(c.without, 3)} → {number_text(c.with_it, 3)} {unit}"
        where = c.joint if effect.joint else f"robot ({c.joint})"
        told = [gain for gain in effect.quarters if not isnan(gain)]
        worst = percent(min(told), 2) if told else "–"
        rows.append((Mark(effect.effect, "warn"), where, c.rows, error, percent(effect.gain, 2), worst))
        meanings.append((f"{effect.effect} {effect.joint or ''}".strip(), _meaning_of(robot, effect)))
    note = CURVES if any(c.effect.collocated for c in contributions) else ""
    return [Table(key, columns, tuple(rows), title=title, note=note), KeyValues(f"{key}_meaning", tuple(meanings))]


def _unit(robot: Robot, contribution: Contribution) -> str:
    unit = torque_unit(robot, contribution.joint)
    if contribution.rows != "deflection":
        return unit
    return "rad" if unit == "N·m" else "m"


def _meaning_of(robot: Robot, effect: FoundEffect) -> str:
    if effect.effect == "lookup":
        return f"a smooth curve over {curve_words(effect.parameters)}; it describes what is left and explains nothing"
    return f"{effect.summary}: {effect_text(robot, effect.effect, effect.joint, effect.parameters, effect.std_error)}"


def _also_possible(found: Diagnosis) -> list[Section]:
    if not found.also_possible:
        return [Text("also_possible", "not distinguishable here: nothing")] if found.effects else []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (
            f"{r.effect} {r.joint or ''}".strip(),
            f"instead of {r.instead_of}, gain {_share(r.gain)}; to tell them apart record {r.separate}",
        )
        for r in found.also_possible
    )
    return [KeyValues("also_possible", items, title="not distinguishable here")]


def _before_after(
    key: str, robot: Robot, before: Mapping[str, JointError], after: Mapping[str, JointError], title: str
) -> Table:
    columns = [
        Column("joint", "joint"),
        Column("rows", "row"),
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
        old, unit = before[joint], torque_unit(robot, joint)
        sides = [("sum", old.rms, new.rms, new.relative, new.floor)]
        if new.spring_rms is not None:
            sides.append(("motor", old.spring_rms or 0.0, new.spring_rms, new.spring_relative or 0.0, new.spring_floor))
        if old.sensor is not None and new.sensor is not None:
            size = new.sensor.reading_rms
            for kind in ("load", "drive", "spring"):
                first, last = (float(getattr(sensor, f"{kind}_rms")) for sensor in (old.sensor, new.sensor))
                sides.append((kind, first, last, last / (new.torque_rms if kind == "drive" else size), None))
        for kind, first, last, share, floor in sides:
            row: list[Cell] = [joint, kind, Quantity(new.torque_rms, unit, 3), Quantity(first, unit, 3)]
            row += [Quantity(last, unit, 3), percent(share)]
            if floors:
                tone: Tone = "warn" if floor and last > AT_FLOOR * floor else "good"
                row.append(Quantity(last / floor, digits=3, tone=tone) if floor else None)
            rows.append(tuple(row))
    return Table(key, tuple(columns), tuple(rows), title=title)


def _refuted(found: Diagnosis) -> list[Section]:
    """Return what the search found and a quarter of the log, predicted from the other three, speaks against."""
    if not found.refuted:
        return []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (f"{s.effect} {s.joint or ''}".strip(), f"takes from each quarter's error: {s.words}{_KEPT if s.kept else ''}")
        for s in found.refuted
    )
    title = "not named: makes a quarter of the log worse that the others predict"
    return [KeyValues("refuted", items, title=title)]


def _unexplained(found: Diagnosis) -> list[Section]:
    if not found.unexplained:
        return []
    ordered = sorted(found.unexplained, key=lambda u: found.robot.joint_names.index(u.joint))
    items = tuple((f"{u.joint} {u.rows} row", _left(found.robot, u)) for u in ordered)
    return [KeyValues("unexplained", items, title="not explained by any effect")]


def _left(robot: Robot, item: Unexplained) -> str:
    size = f"{number_text(item.rms, 3)} {torque_unit(robot, item.joint)}, {number_text(item.ratio, 3)} times its floor"
    follows = f"; follows {variable_words(item.variable)} ({_share(item.share)})" if item.share > FOLLOWS else ""
    near = ", ".join(f"{whose(effect, joint)} {_share(gain)}" for effect, joint, gain in item.nearest if gain > NEAR)
    said = f"nearest, and what they take of parts left out: {near}" if near else "no effect comes near"
    return f"{size}{follows}; {said}"


def _meaning(told: Told) -> list[Section]:
    found = told.found
    sections: list[Section] = []
    if found.sufficient:
        limit = number_text(AT_FLOOR)
        sticking = any(r.ratio > AT_FLOOR >= r.away for r in found.rows_after)
        where = " away from reversals" if sticking else ""
        text = f"The model is sufficient: every row is within {limit} of its noise floor{where}; no effect improves it."
        keep = ("--write-robot", f"{found.robot.name}-identified.yaml")
        line = command("identify", told.recording, told.robot_argument, *keep)
        return [Text("meaning", text), Text("next", line, "next")]
    if told.contributions:
        sections.append(Text("meaning", "\n".join(_outcome(told))))
    return [*sections, Text("next", _next(told), "next")]


def _outcome(told: Told) -> list[str]:
    """Return in words where the model after stands, and what the missing effects had moved."""
    found = told.found
    worst = _worst(found)
    words = [f"after: every row within {number_text(worst, 3)} of its floor"] if worst <= AT_FLOOR else []
    moved = [m for m in found.moved if abs(m.deviations) > MOVED]
    if moved:
        named = ", ".join(f"{m.name} {m.deviations:+.0f} sd" for m in moved[:NAMED])
        words.append(f"moved by it: {named}{f' and {len(moved) - NAMED} more' if len(moved) > NAMED else ''}")
    if _referenced(told.before):
        first, last = (percent(m.normalised_mean_error()).value for m in (told.before, told.after))
        words.append(
            f"mean error against the robot file's parameters: {number_text(first, 3)} → {number_text(last, 3)} %"
        )
    return words or ["after: more than the sensors' noise is left"]


def _worst(found: Diagnosis) -> float:
    """Return the largest held-out error over its floor, as the table before it shows; without floors, of the fit."""
    pairs = [(e.rms, e.floor) for e in found.after.values()]
    pairs += [(e.spring_rms, e.spring_floor) for e in found.after.values() if e.spring_rms is not None]
    ratios = [rms / floor for rms, floor in pairs if floor and rms is not None]
    return max(ratios) if ratios else max(row.ratio for row in found.rows_after)


def _next(told: Told) -> str:
    found, recording = told.found, told.recording
    if told.written is not None:
        return command("validate", recording, told.written, "--held-out")
    if told.contributions:
        refined = ("--write-robot", f"{found.robot.name}-refined.yaml")
        lookup = ("--lookup",) if told.lookup else ()
        return command("diagnose", recording, told.robot_argument, *lookup, *refined)
    if not told.lookup:
        return command("diagnose", recording, told.robot_argument, "--lookup")
    return command("identify", recording, told.robot_argument)


def _referenced(model: Identification) -> bool:
    """Whether the robot file holds a reference of every base parameter."""
    return all(value == value for value in model.reference)


def _share(fraction: float) -> str:
    return f"{number_text(100 * fraction, 2)} %"


def _files(recording: Recording) -> str:
    return ", ".join(recording.files)
