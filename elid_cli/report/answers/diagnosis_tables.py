"""Tables and words of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan

from elid_cli.diagnosis import Diagnosis, FoundEffect, Unexplained
from elid_cli.diagnosis.evidence.quarters import Survival
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.residuals import Organised
from elid_cli.diagnosis.residuals import words as where_words
from elid_cli.diagnosis.result import OtherForm
from elid_cli.diagnosis.unexplained import HELD_OUT
from elid_cli.estimation.judgement import EQUATIONS, JointError
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers import missing
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.elasticity_words import own_elasticity
from elid_cli.report.answers.error_tables import LIGHTS, SIDE_NOTES, torque_unit
from elid_cli.report.answers.inputs import effect_text
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

NEAR = 0.005
"""Share of the residual that an effect must take away to be called near."""
STICKING = "reversals"
"""What the residual of a motor that sticks or creeps follows."""
NOTES = {
    **SIDE_NOTES,
    "load": "link side: torque sensor against the bodies",
    "drive": "drive: motor torque less the sensor's against rotor and friction",
    "spring": "transmission: torque sensor against the deflection",
}
SIZE_ONLY = ": the residual is "
"""What a line of the triage has that says nothing but how large a residual is, as the list of what is left does."""
ADDED = "All values are those with what is missing added to the model."
SAME = "does as well: this log cannot tell it apart"
FORM_NAMES = 4
"""Parameters that are named of those that another form of an effect moves."""


def residual_table(found: Diagnosis) -> Table:
    """Return the table of what the model leaves in every row, and what it follows."""
    columns = (
        *Column.texts(joint="joint", rows="equation"),
        *Column.numbers(rms="residual", share="of torque", ratio="× noise"),
        Column("follows", "follows"),
    )
    rows: list[tuple[Cell, ...]] = []
    for row in sorted(found.rows_before, key=lambda r: found.robot.joint_names.index(r.joint)):
        high = row.high
        rows.append(
            (
                row.joint,
                EQUATIONS.get(row.rows, row.rows),
                Quantity(row.rms, torque_unit(found.robot, row.joint), 3),
                share_text(row.share),
                Quantity(row.ratio, digits=2, tone="warn" if high else "good"),
                _follows(found.organised.get((row.joint, row.rows), ())) if high else "",
            )
        )
    before = "before: " if found.effects else ""
    title = f"{before}residual where the model was fitted, and what it follows"
    note = "on the stretches that were fitted, so other figures than those of held-out stretches"
    return Table("residual", columns, tuple(rows), title=title, note=note)


def _follows(organised: Sequence[Organised]) -> str:
    named = [o for o in organised if o.share > missing.FOLLOWS][:2]
    return ", ".join(f"{missing.variable_words(o.variable)} {share_text(o.share)}" for o in named) or "nothing known"


def effect_sections(told: DiagnosisInput) -> list[Section]:
    """Return the effects that are missing, what each means, and what it cannot be told from."""
    found = told.found
    ordered = sorted(told.contributions, key=lambda c: found.robot.joint_names.index(c.joint))
    named = [c for c in ordered if c.effect not in found.curves]
    curves = [c for c in ordered if c.effect in found.curves]
    sections: list[Section] = []
    if named:
        sections += _found(found, "effects", "missing from the model", named)
    elif not found.sufficient:
        tried = "Nothing found so far" if found.partial else "No effect that elid knows"
        sections.append(Text("effects", f"{tried} explains it."))
    sections += _also_possible(found)
    if curves:
        sections += _found(found, "curves", "curves over what is left, asked for by --lookup", curves)
    return sections


def _found(found: Diagnosis, key: str, title: str, contributions: Sequence[Contribution]) -> list[Section]:
    """Return a table of effects with the error without and with each, and what each means."""
    columns = [
        *Column.texts(effect="effect", joint="joint", rows="equation"),
        *Column.numbers(error="held-out error", gain="explains", worst_quarter="worst stretch"),
    ]
    robot, poor = found.robot, missing.poorly_fitted(found)
    rows: list[tuple[Cell, ...]] = []
    meanings: list[tuple[str, Cell]] = []
    curves: dict[tuple[str, str | None], list[Contribution]] = {}
    for c in contributions:
        curves.setdefault((c.effect.effect, c.effect.joint), []).append(c)
    for (name, joint), terms in curves.items():
        c = terms[0]
        error = f"{number_text(c.whole_without, 3)} → {number_text(c.with_it, 3)} {_unit(robot, c)}"
        # what one term of a curve takes from a quarter, the other term in the model, is not what the curve is worth
        told = [gain for gain in c.effect.quarters if not isnan(gain)] if len(terms) == 1 else []
        worst = percent(min(told), 2) if told else "–"
        where = joint or f"robot ({c.joint})"
        side = EQUATIONS.get(c.rows, c.rows) + (f" of {c.joint}" if joint not in (None, c.joint) else "")
        rows.append((Mark(name, "warn"), where, side, error, percent(_explained(c), 2), worst))
        fit = "a poor fit: " if joint in poor else ""
        own = also_words(found, c.effect)
        meaning = fit + _meaning_of(robot, [term.effect for term in terms]) + (f". {own}" if own else "")
        meaning += form_words(robot, c.effect)
        meanings.append((missing.whose(name, joint), meaning))
    note = (
        "held-out error: without the effect, everything else fitted again → with it, on stretches that no fit saw; "
        "explains: share of the squared held-out error that it takes away in this equation"
    )
    if all(row[-1] == "–" for row in rows):
        columns.pop()  # several terms of one curve are not judged so, nor is what acts for a moment
        rows = [row[:-1] for row in rows]
    else:
        note += (
            "; worst stretch: the same share where it helps least, of four stretches of the log, each predicted by a "
            "fit to the other three"
        )
    table = Table(key, tuple(columns), tuple(rows), title=title, note=note)
    return [table, KeyValues(f"{key}_meaning", tuple(meanings))]


def also_words(found: Diagnosis, effect: FoundEffect) -> str:
    """Return what else an effect may be, or what it takes for granted; nothing of most."""
    beside = {(other, e.joint) for e in found.effects for other in effect_classes()[e.effect].comes_with}
    kind = effect_classes()[effect.effect]
    asked = (effect.effect, effect.joint) in beside
    return own_elasticity(found, effect) or ("" if asked else kind.taken)


def _explained(c: Contribution) -> float:
    """Return the share of the squared held-out error of its equation that an effect takes away."""
    return max(1.0 - (c.with_it / c.whole_without) ** 2, 0.0) if c.whole_without > 0 else 0.0


def _unit(robot: Robot, contribution: Contribution) -> str:
    return robot.joint(contribution.joint).units[contribution.rows != "deflection"]


def _meaning_of(robot: Robot, terms: Sequence[FoundEffect]) -> str:
    """Return what an effect is and its values; of a curve of several terms those of each."""
    effect = terms[0]
    if curve := missing.curve_words(effect):
        return f"a smooth curve over {curve}; it describes what is left and explains nothing"
    texts = [effect_text(robot, e.effect, e.joint, e.parameters, e.std_error) for e in terms]
    text = f"{missing.summary_words(terms)}: {'; and '.join(texts)}"
    kind = effect_classes()[effect.effect]
    absent = [p.name for p in kind.amplitudes if p.name not in effect.parameters]
    sums = {name: said for name, said in kind.in_sums(robot, effect.joint).items() if name in effect.parameters}
    if absent:
        text += f"; taken as 0: {', '.join(absent)}"
        text += ", which no motion shows alone" if sums else ", which no motion of this robot shows"
    for name, said in sums.items():
        text += f"; {name} stands for {said}"
    return text


def form_words(robot: Robot, effect: FoundEffect) -> str:
    """Return what is said of other forms of an effect that explain a log about as well; nothing without one."""
    return "".join(f"; {_form_words(robot, effect, form)}" for form in effect.forms)


def _form_words(robot: Robot, effect: FoundEffect, form: OtherForm) -> str:
    """Return the values of an effect in another form, and what it then makes of the parameters."""
    values = effect_text(robot, effect.effect, effect.joint, form.parameters, {})
    text = f"{values} would explain this log about as well"
    if form.moved:
        told = listed([f"{name} {number_text(value, 3)}" for name, value in form.moved[:FORM_NAMES]])
        text += f", and make {told}: standard errors include that"
    return text


def _also_possible(found: Diagnosis) -> list[Section]:
    if not found.also_possible:
        return [Text("also_possible", "No other effect does as well on this log.")] if found.effects else []
    taken = {e.effect for e in found.effects if e.absorbed}  # of what these explain, next to nothing, nothing is said
    items: tuple[tuple[str, Cell], ...] = tuple(
        (
            missing.whose(r.effect, r.joint),
            f"in place of {missing.replaced(r, found.effects)}"
            + ("" if r.instead_of in taken else f" it explains {share_text(r.gain)}"),
        )
        for r in found.also_possible
    )
    return [KeyValues("also_possible", items, title=SAME)]


def before_after_table(
    key: str,
    robot: Robot,
    before: Mapping[str, JointError],
    after: Mapping[str, JointError],
    title: str,
    *,
    changed: bool = True,
) -> Table:
    """Return the error of every row before and after; `changed` False: nothing was added, both are the same."""
    columns = [
        *Column.texts(joint="joint", rows="equation", trust="model"),
        *((Column("before", "before", align="right"),) if changed else ()),
        *Column.numbers(after="after" if changed else "error", relative="of torque"),
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
            row: list[Cell] = [joint, EQUATIONS[kind], change if kind == "sum" else ""]
            row += [*([Quantity(first, unit, 3)] if changed else []), Quantity(last, unit, 3), share_text(share)]
            if floors:
                tone: Tone = "warn" if floor and last > AT_FLOOR * floor else "good"
                row.append(Quantity(last / floor, digits=2, tone=tone) if floor else None)
            rows.append(tuple(row))
    seen = [kind for kind, words in EQUATIONS.items() if any(words == row[1] for row in rows)]
    whose_error = ["model: before → after where it changes; of torque, × noise: of the error after"] if changed else []
    notes = [LIGHTS, *whose_error, *(NOTES[kind] for kind in seen if kind in NOTES)]
    return Table(key, tuple(columns), tuple(rows), title=title, note="\n".join(notes))


def refuted_section(found: Diagnosis) -> list[Section]:
    """Return what the search found and a quarter of the log, predicted from the other three, speaks against."""
    if not found.refuted:
        return []
    items: tuple[tuple[str, Cell], ...] = tuple(
        (missing.whose(s.effect, s.joint), f"takes from the error of each stretch{_where(s)}: {s.words}{_kept(s)}")
        for s in found.refuted
    )
    title = "not named: it makes one of four stretches of the log worse, each predicted by a fit to the other three"
    return [KeyValues("refuted", items, title=title)]


def unexplained_section(found: Diagnosis) -> list[Section]:
    """Return what no effect explains."""
    if not found.unexplained:
        return []
    after = "after: " if found.effects else ""
    ordered = sorted(found.unexplained, key=lambda u: found.robot.joint_names.index(u.joint))
    items = tuple((f"{u.joint} {EQUATIONS.get(u.rows, u.rows)}", _left(found, u)) for u in ordered)
    title = f"{after}what nothing found so far explains" if found.partial else f"{after}what no effect explains"
    return [KeyValues("unexplained", items, title=title)]


def _left(found: Diagnosis, item: Unexplained) -> str:
    rms, ratio = missing.held_out_size(found, item)
    times = f"{number_text(ratio, 2)} times the sensors' noise"
    size = f"{number_text(rms, 3)} {torque_unit(found.robot, item.joint)}, {times}"
    if item.variable == HELD_OUT:
        return f"{size} on the held-out stretches, where the search does not look, and noise elsewhere"
    named = [(share_text(share), missing.variable_words(name)) for name, share in missing.left_follows(found, item)]
    follows = "; " + ", ".join(f"{share} follows {name}" for share, name in named) if named else ""
    follows = follows.replace(" follows", " of its mean square follows", 1)
    sticks = "; leave slow motion out: --min-velocity 0.03" if follows and item.variable == STICKING else ""
    near = ", ".join(f"{missing.whose(n.effect, n.joint)} {share_text(n.gain)}" for n in item.nearest if n.gain > NEAR)
    none = f"no effect that elid knows takes away even {share_text(NEAR)}"
    none = "the search was stopped before all effects were tried" if found.partial else none
    none = "elid identify sees it, below its own cut-off" if item.by_identify else none
    said = f"nearest, with the share that each would explain: {near}" if near else none
    return f"{size}{follows}{sticks}; {said}"


def triage_section(found: Diagnosis) -> list[Section]:
    """Return which side of a joint to look at for what stays; what the found effects explain is not looked for."""
    told = {u.joint for u in found.unexplained}
    lines = where_words(missing.judged_after(found)) if told else ()
    said = [line for line in lines if SIZE_ONLY not in line or line.split(":")[0] not in told]
    return [Text("triage", "\n".join(said))] if said else []


def _where(refuted: Survival) -> str:
    return "" if refuted.cutoff is None else f", below {number_text(refuted.cutoff)} Hz as in elid identify"


def _kept(refuted: Survival) -> str:
    why = effect_classes()[refuted.effect].always_fitted
    return f"; fitted along all the same, as {why}" if refuted.kept else ""
