"""Tables and words of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan

from elid_cli.diagnosis import Diagnosis, FoundEffect, Rival, Unexplained
from elid_cli.diagnosis.evidence.quarters import Survival
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.residuals import Organised
from elid_cli.diagnosis.unexplained import HELD_OUT
from elid_cli.estimation.judgement import JointError
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.model.effects.kinds import CurveEffect
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.error_tables import LIGHTS, torque_unit
from elid_cli.report.answers.inputs import Items, effect_text
from elid_cli.report.answers.summary import AT_FLOOR, light, listed, share_text
from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Mark,
    Quantity,
    Section,
    Table,
    Text,
    Tone,
    number_text,
    percent,
)
from elid_cli.robot.robot import Robot

_VARIABLES = {
    "reversals": "reversals of its motor (sticking)",
    "theta": "motor angle",
    "dtheta": "motor speed",
    "ddtheta": "motor acceleration",
    "tau": "torque",
    "t": "time",
    "deflection_rate": "deflection rate",
}


def variable_words(variable: str) -> str:
    """Return in words what a residual follows: ``motor speed``, ``angle of joint2``, ``line at 28.3 Hz``."""
    head, _, rest = variable.partition(" ")
    if rest.startswith("of "):
        return f"{'speed' if head == 'dtheta' else 'angle'} {rest}"
    if head == "frequency":
        return f"line at {rest}"
    return _VARIABLES.get(variable, variable)


def curve_words(effect: FoundEffect) -> str:
    """Return what a curve runs over and where it acts: ``velocity on the motor side``; empty of any other effect."""
    kind = effect_classes()[effect.effect]
    return kind.words(effect.parameters) if issubclass(kind, CurveEffect) else ""


def whose(effect: str, joint: str | None) -> str:
    """Return an effect with its joint."""
    return effect if joint is None else f"{effect} of {joint}"


FOLLOWS = 0.05
"""Share of a residual's variance that must follow a variable for the variable to be named."""
NEAR = 0.005
"""Share of the residual that an effect must take away to be called near."""
STICKING = "reversals"
"""What the residual of a motor that sticks or creeps follows."""
SIDES = {
    "sum": "whole joint", "motor": "motor side", "load": "link side", "drive": "drive", "spring": "transmission",
    "deflection": "deflection",
}  # fmt: skip
"""Equation of a joint, by its name in JSON -> as people read it."""
SIDE_NOTES = {
    "sum": "whole joint: motor torque against link and motor together",
    "motor": "motor side: with the transmission's torque from the measured deflection",
    "load": "link side: torque sensor against the bodies",
    "drive": "drive: motor torque less the sensor's against rotor and friction",
    "spring": "transmission: torque sensor against the deflection",
}
SAME = "does as well: this log cannot tell it apart"
VAGUE_ERROR = 0.1
"""Relative standard error from which on another log should sharpen an effect's amplitude."""


def missing_words(told: DiagnosisInput) -> str:
    """Return what the model lacks, and what it is worth, in a sentence."""
    found = told.found
    named = [c for c in told.contributions if c.effect not in found.curves]
    left = [u.joint for u in found.unexplained]
    nothing = "nothing found so far" if found.partial else "nothing"
    rest = f" More than noise is left at {listed(list(dict.fromkeys(left)))}, which {nothing} explains." if left else ""
    if found.partial and not named:
        return f"Not known yet: the search was stopped before it found anything.{rest}"
    if not named:
        sticking = any(r.ratio > AT_FLOOR >= r.away for r in found.rows_after)
        where = " away from reversals" if sticking else ""
        nothing = f"Nothing{where}: only the sensors' noise is left, and no effect improves the model."
        return (rest.strip() or nothing) + _constant_words(found)
    places: dict[str, list[str]] = {}
    for c in named:
        places.setdefault(c.effect.effect, []).append(c.effect.joint or found.robot.name)
    order = [*found.robot.joint_names, found.robot.name].index
    words = [f"{effect.replace('_', ' ')} at {listed(sorted(set(p), key=order))}" for effect, p in places.items()]
    said = "; ".join(words) + (f" ({named[0].effect.summary})" if len(places) == 1 else "")
    gains = {c.joint: (_better(found, c), c.rows) for c in sorted(named, key=lambda c: order(c.joint))}
    better = listed([
        f"{number_text(times, 2)} times at {joint}{' (motor side)' if rows == 'motor' else ''}"
        for joint, (times, rows) in gains.items() if times > BETTER
    ])  # fmt: skip
    worth = f" With {'it' if len(places) == 1 else 'them'} the error is smaller: {better}." if better else ""
    constant = _constants(found)
    rivals = dict.fromkeys(whose(r.effect.replace("_", " "), r.joint) for r in _rivals(found) if r not in constant)
    tied = (
        f" This log cannot tell {'it' if len(places) == 1 else 'them'} from {listed(list(rivals))}." if rivals else ""
    )
    return f"{said[:1].upper()}{said[1:]}.{worth}{tied}{rest}{_constant_words(found)}"


def _rivals(found: Diagnosis) -> list[Rival]:
    """Return what could be as well, without what the model has already: a constant torque that is corrected."""
    corrected = _offsets(found)
    return [r for r in found.also_possible if (r.effect, r.joint) not in corrected]


def _constants(found: Diagnosis) -> list[Rival]:
    """Return what constants that are corrected could be as well."""
    corrected = _offsets(found)
    return [r for r in _rivals(found) if (r.instead_of, r.joint) in corrected]


def _offsets(found: Diagnosis) -> set[tuple[str, str | None]]:
    return {(n.effect, n.joint) for n in found.nuisances if nuisance_of(n.effect) == "offset"}


def _constant_words(found: Diagnosis) -> str:
    constant = _constants(found)
    if not constant:
        return ""
    joints = listed(list(dict.fromkeys(r.joint or found.robot.name for r in constant)))
    kinds = listed(list(dict.fromkeys(r.effect.replace("_", " ") for r in constant)))
    return f" The constant torque at {joints} that is corrected as an offset could be {kinds} as well."


BETTER = 1.05
"""Error before over that after, from which on it is told."""


def _better(found: Diagnosis, contribution: Contribution) -> float:
    """Return how many times smaller the held-out error of the joint is after, in the row the effect explains best."""
    joint = contribution.joint
    if contribution.rows in ("sum", "motor") and joint in found.before:
        field = "rms" if contribution.rows == "sum" else "spring_rms"
        before, after = (getattr(e[joint], field) for e in (found.before, found.after))
        if before and after:
            return float(before / after)
    return contribution.whole_without / contribution.with_it if contribution.with_it else 0.0


def further_items(told: DiagnosisInput) -> Items:
    """Return what another log should hold: to tell effects apart, and to know those better that were found."""
    items: list[tuple[str, Cell]] = [
        (f"{whose(r.effect, r.joint)} or {r.instead_of}", r.separate) for r in _rivals(told.found)
    ]
    for c in told.contributions:
        effect = c.effect
        vague = any(e > VAGUE_ERROR * abs(effect.parameters.get(name, 0.0)) for name, e in effect.std_error.items())
        if vague and (kind := effect_classes().get(effect.effect)) is not None and kind.record:
            items.append((whose(effect.effect, effect.joint), kind.record))
    return tuple(dict(items).items())


def residual_table(found: Diagnosis) -> Table:
    """Return the table of what the model leaves in every row, and what it follows."""
    columns = (
        Column("joint", "joint"),
        Column("rows", "equation"),
        Column("rms", "residual", align="right"),
        Column("share", "of torque", align="right"),
        Column("ratio", "× noise", align="right"),
        Column("follows", "follows"),
    )
    rows: list[tuple[Cell, ...]] = []
    for row in sorted(found.rows_before, key=lambda r: found.robot.joint_names.index(r.joint)):
        high = row.high
        rows.append(
            (
                row.joint,
                SIDES.get(row.rows, row.rows),
                Quantity(row.rms, torque_unit(found.robot, row.joint), 3),
                share_text(row.share),
                Quantity(row.ratio, digits=2, tone="warn" if high else "good"),
                _follows(found.organised.get((row.joint, row.rows), ())) if high else "",
            )
        )
    return Table("residual", columns, tuple(rows), title="residual without what is missing" if found.effects
                 else "residual")  # fmt: skip


def _follows(organised: Sequence[Organised]) -> str:
    named = [o for o in organised if o.share > FOLLOWS][:2]
    return ", ".join(f"{variable_words(o.variable)} {share_words(o.share)}" for o in named) or "nothing known"


def effect_sections(told: DiagnosisInput) -> list[Section]:
    """Return the effects that are missing, what each means, and what it cannot be told from."""
    found = told.found
    named = [c for c in told.contributions if c.effect not in found.curves]
    curves = [c for c in told.contributions if c.effect in found.curves]
    sections: list[Section] = []
    if named:
        sections += _found(found.robot, "effects", "missing from the model", named)
    elif not found.sufficient:
        sections.append(Text("effects", "No effect of the library explains it."))
    sections += _also_possible(found)
    if curves:
        sections += _found(found.robot, "curves", "curves over what is left, asked for by --lookup", curves)
    return sections


def _found(robot: Robot, key: str, title: str, contributions: Sequence[Contribution]) -> list[Section]:
    """Return a table of effects with the error without and with each, and what each means."""
    columns = (
        Column("effect", "effect"),
        Column("joint", "joint"),
        Column("rows", "equation"),
        Column("error", "held-out error", align="right"),
        Column("gain", "explains", align="right"),
        Column("worst_quarter", "worst quarter", align="right"),
    )
    rows: list[tuple[Cell, ...]] = []
    meanings: list[tuple[str, Cell]] = []
    curves: dict[tuple[str, str | None], list[Contribution]] = {}
    for c in contributions:
        curves.setdefault((c.effect.effect, c.effect.joint), []).append(c)
    for (name, joint), terms in curves.items():
        c = terms[0]
        error = f"{number_text(c.whole_without, 3)} → {number_text(c.with_it, 3)} {_unit(robot, c)}"
        told = [gain for term in terms for gain in term.effect.quarters if not isnan(gain)]
        worst = percent(min(told), 2) if told else "–"
        where = c.joint if joint else f"robot ({c.joint})"
        side = SIDES.get(c.rows, c.rows)
        rows.append((Mark(name, "warn"), where, side, error, percent(c.effect.gain, 2), worst))
        meanings.append((f"{name} {joint or ''}".strip(), _meaning_of(robot, [term.effect for term in terms])))
    note = (
        "explains: share of the error beyond noise that it takes away; worst quarter: share of the error in that "
        "quarter of the log where it is least, predicted from the other three"
    )
    return [Table(key, columns, tuple(rows), title=title, note=note), KeyValues(f"{key}_meaning", tuple(meanings))]


def _unit(robot: Robot, contribution: Contribution) -> str:
    unit = torque_unit(robot, contribution.joint)
    if contribution.rows != "deflection":
        return unit
    return "rad" if unit == "N·m" else "m"


def _meaning_of(robot: Robot, terms: Sequence[FoundEffect]) -> str:
    """Return what an effect is and its values; of a curve of several terms those of each."""
    effect = terms[0]
    if curve := curve_words(effect):
        return f"a smooth curve over {curve}; it describes what is left and explains nothing"
    texts = [effect_text(robot, e.effect, e.joint, e.parameters, e.std_error) for e in terms]
    text = f"{effect.summary}: {'; and '.join(texts)}"
    absent = [p.name for p in effect_classes()[effect.effect].amplitudes if p.name not in effect.parameters]
    if absent:
        text += f"; taken as 0: {', '.join(absent)}, which this motion shows in sums with the others only"
    return text


def _also_possible(found: Diagnosis) -> list[Section]:
    if not _rivals(found):
        return [Text("also_possible", "No other effect does as well on this log.")] if found.effects else []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (
            f"{r.effect} {r.joint or ''}".strip(),
            f"in place of {r.instead_of} it explains {share_words(r.gain)}; to tell them apart, record: {r.separate}",
        )
        for r in _rivals(found)
    )
    return [KeyValues("also_possible", items, title=SAME)]


def before_after_table(
    key: str, robot: Robot, before: Mapping[str, JointError], after: Mapping[str, JointError], title: str
) -> Table:
    """Return the error of every row before and after."""
    columns = [
        Column("joint", "joint"),
        Column("rows", "equation"),
        Column("trust", "model"),
        Column("before", "before", align="right"),
        Column("after", "after", align="right"),
        Column("relative", "of torque", align="right"),
    ]
    floors = any(e.floor for e in after.values())
    if floors:
        columns.append(Column("floor", "× noise", align="right"))
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
            known = light(old).text, light(new)
            change = known[1] if known[0] == known[1].text else Mark(f"{known[0]} → {known[1].text}", known[1].tone)
            row: list[Cell] = [joint, SIDES[kind], change if kind == "sum" else ""]
            row += [Quantity(first, unit, 3), Quantity(last, unit, 3), share_text(share)]
            if floors:
                tone: Tone = "warn" if floor and last > AT_FLOOR * floor else "good"
                row.append(Quantity(last / floor, digits=2, tone=tone) if floor else None)
            rows.append(tuple(row))
    seen = [kind for kind, words in SIDES.items() if any(words == row[1] for row in rows)]
    notes = [LIGHTS, *(SIDE_NOTES[kind] for kind in seen if kind in SIDE_NOTES)]
    return Table(key, tuple(columns), tuple(rows), title=title, note="\n".join(notes))


def refuted_section(found: Diagnosis) -> list[Section]:
    """Return what the search found and a quarter of the log, predicted from the other three, speaks against."""
    if not found.refuted:
        return []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (f"{s.effect} {s.joint or ''}".strip(), f"takes from each quarter's error: {s.words}{_kept(s)}")
        for s in found.refuted
    )
    title = "not named: it makes a quarter of the log worse, predicted from the other three"
    return [KeyValues("refuted", items, title=title)]


def unexplained_section(found: Diagnosis) -> list[Section]:
    """Return what no effect explains."""
    if not found.unexplained:
        return []
    ordered = sorted(found.unexplained, key=lambda u: found.robot.joint_names.index(u.joint))
    items = tuple((f"{u.joint} {SIDES.get(u.rows, u.rows)}", _left(found.robot, u)) for u in ordered)
    return [KeyValues("unexplained", items, title="not explained by any effect")]


def _left(robot: Robot, item: Unexplained) -> str:
    times = f"{number_text(item.ratio, 2)} times the sensors' noise"
    size = f"{number_text(item.rms, 3)} {torque_unit(robot, item.joint)}, {times}"
    if item.variable == HELD_OUT:
        return f"{size} on the held-out stretches, where the search does not look, and noise elsewhere"
    follows = f"; follows {variable_words(item.variable)} ({share_words(item.share)})" if item.share > FOLLOWS else ""
    sticks = "; leave slow motion out: --min-velocity 0.03" if follows and item.variable == STICKING else ""
    near = ", ".join(f"{whose(n.effect, n.joint)} {share_words(n.gain)}" for n in item.nearest if n.gain > NEAR)
    said = f"nearest, and what they take of parts left out: {near}" if near else "no effect comes near"
    return f"{size}{follows}{sticks}; {said}"


def share_words(fraction: float) -> str:
    """Return a share in percent."""
    return f"{number_text(100 * fraction, 2)} %"


def _kept(refuted: Survival) -> str:
    why = effect_classes()[refuted.effect].always_fitted
    return f"; fitted along all the same, as {why}" if refuted.kept else ""
