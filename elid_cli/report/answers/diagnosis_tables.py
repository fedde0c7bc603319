"""Its tables and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan

from elid_cli.diagnosis import Diagnosis, FoundEffect, Unexplained
from elid_cli.diagnosis.evidence.quarters import Survival
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.residuals import Organised
from elid_cli.diagnosis.unexplained import HELD_OUT
from elid_cli.estimation.result import JointError
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import CurveEffect
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.identification import AT_FLOOR, torque_unit
from elid_cli.report.answers.inputs import effect_text
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
    """Return what a curve runs over and where it acts: ``velocity in the motor row``; empty of any other effect."""
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
CURVES = (
    "gain of a friction curve of several terms: of what the held-out stretches show beyond noise when the trajectory is"
    " held to the equations of motion, what all terms take together"
)


def residual_table(found: Diagnosis) -> Table:
    """Return the table of what the model leaves in every row, and what it follows."""
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
    return ", ".join(f"{variable_words(o.variable)} {share_words(o.share)}" for o in named) or "nothing known"


def effect_sections(told: DiagnosisInput) -> list[Section]:
    """Return the effects that are missing, what each means, and what it cannot be told from."""
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
    if curve := curve_words(effect):
        return f"a smooth curve over {curve}; it describes what is left and explains nothing"
    text = effect_text(robot, effect.effect, effect.joint, effect.parameters, effect.std_error)
    absent = [p.name for p in effect_classes()[effect.effect].amplitudes if p.name not in effect.parameters]
    if absent:
        text += f"; taken as 0: {', '.join(absent)}, which this motion shows in sums with the others only"
    return f"{effect.summary}: {text}"


def _also_possible(found: Diagnosis) -> list[Section]:
    if not found.also_possible:
        return [Text("also_possible", "not distinguishable here: nothing")] if found.effects else []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (
            f"{r.effect} {r.joint or ''}".strip(),
            f"instead of {r.instead_of}, gain {share_words(r.gain)}; to tell them apart record {r.separate}",
        )
        for r in found.also_possible
    )
    return [KeyValues("also_possible", items, title="not distinguishable here")]


def before_after_table(
    key: str, robot: Robot, before: Mapping[str, JointError], after: Mapping[str, JointError], title: str
) -> Table:
    """Return the error of every row before and after."""
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


def refuted_section(found: Diagnosis) -> list[Section]:
    """Return what the search found and a quarter of the log, predicted from the other three, speaks against."""
    if not found.refuted:
        return []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (f"{s.effect} {s.joint or ''}".strip(), f"takes from each quarter's error: {s.words}{_kept(s)}")
        for s in found.refuted
    )
    title = "not named: makes a quarter of the log worse that the others predict"
    return [KeyValues("refuted", items, title=title)]


def unexplained_section(found: Diagnosis) -> list[Section]:
    """Return what no effect explains."""
    if not found.unexplained:
        return []
    ordered = sorted(found.unexplained, key=lambda u: found.robot.joint_names.index(u.joint))
    items = tuple((f"{u.joint} {u.rows} row", _left(found.robot, u)) for u in ordered)
    return [KeyValues("unexplained", items, title="not explained by any effect")]


def _left(robot: Robot, item: Unexplained) -> str:
    size = f"{number_text(item.rms, 3)} {torque_unit(robot, item.joint)}, {number_text(item.ratio, 3)} times its floor"
    if item.variable == HELD_OUT:
        return f"{size} on the held-out stretches, where the search does not look, and noise elsewhere"
    follows = f"; follows {variable_words(item.variable)} ({share_words(item.share)})" if item.share > FOLLOWS else ""
    sticks = "; leave slow motion out: --min-velocity 0.03" if follows and item.variable == STICKING else ""
    near = ", ".join(
        f"{whose(effect, joint)} {share_words(gain)}" for effect, joint, gain in item.nearest if gain > NEAR
    )
    said = f"nearest, and what they take of parts left out: {near}" if near else "no effect comes near"
    return f"{size}{follows}{sticks}; {said}"


def share_words(fraction: float) -> str:
    """Return a share in percent."""
    return f"{number_text(100 * fraction, 2)} %"


def _kept(refuted: Survival) -> str:
    why = effect_classes()[refuted.effect].always_fitted
    return f"; fitted along all the same, as {why}" if refuted.kept else ""
