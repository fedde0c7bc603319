"""What a model lacks, in sentences: the effects by their readable names, what they are worth, what to record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from elid_cli.diagnosis import Diagnosis, FoundEffect, Rival, Unexplained
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.residuals import HIGH, RowState, suspects
from elid_cli.diagnosis.unexplained import HELD_OUT
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.model.effects.kinds import CurveEffect
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.elasticity_words import own_elasticity, taken_as_rigid
from elid_cli.report.answers.inputs import Items
from elid_cli.report.answers.lacking import ABSORBED, UNSURE, follows_words, hidden_words, moment_words, taken_up_words
from elid_cli.report.answers.summary import called, listed
from elid_cli.report.tree import Cell, number_text, upper

_VARIABLES = {
    "reversals": "reversals of its motor (sticking)",
    "theta": "motor angle",
    "dtheta": "motor speed",
    "ddtheta": "motor acceleration",
    "tau": "torque",
    "t": "time",
    "deflection_rate": "deflection rate",
}
CUTOFF = "the filter's cut-off"
"""What an effect's advice on what to record says; a report says how many Hz that is."""
FOLLOWS = 0.05
"""Share of a residual's variance that must follow a variable for the variable to be named."""
TIMES, ALSO = ("t", "time"), 0.7
"""Time among the variables, and the part of its share from which another variable is named beside it."""
LEFT = 1.2
"""Times the sensors' noise below which nothing is left on held-out stretches."""
CLEAR = 3.0
"""Standard errors from which on a base parameter that was off is told."""
VAGUE_ERROR = 0.1
"""Relative standard error from which on another log should sharpen an effect's amplitude."""


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


def spoken(effect: str) -> str:
    """Return an effect's name as it is read: ``velocity coupling``, ``Stribeck friction``."""
    kind = effect_classes().get(effect)
    return kind.title if kind is not None and kind.title else effect.replace("_", " ")


def whose(effect: str, joint: str | None) -> str:
    """Return an effect with its joint, as it is read: ``velocity coupling of joint1``."""
    return spoken(effect) if joint is None else f"{spoken(effect)} of {joint}"


def replaced(rival: Rival, effects: Sequence[FoundEffect]) -> str:
    """Return what a rival stands in place of, as it is read: ``backlash``; of another joint's, that joint's."""
    if rival.at and rival.joint and rival.joint != rival.at:
        return f"that of {rival.at}" if rival.effect == rival.instead_of else whose(rival.instead_of, rival.at)
    (*others, last) = [e.joint for e in effects if e.effect == rival.instead_of] or [None]
    return f"that of {last}" if rival.effect == rival.instead_of and last and not others else spoken(rival.instead_of)


def summary_words(terms: Sequence[FoundEffect]) -> str:
    """Return what an effect is, as its values say it; terms of one curve, or the same effect at several joints."""
    kind = effect_classes()[terms[0].effect]
    curves: dict[str | None, list[FoundEffect]] = {}
    for term in terms:
        curves.setdefault(term.joint, []).append(term)
    said = {
        joint: kind.summary_of([t.parameters for t in curve], [t.std_error for t in curve])
        for joint, curve in curves.items()
    }
    if len(set(said.values())) == 1:
        return next(iter(said.values()))
    return "; ".join(f"{joint}: {words}" for joint, words in said.items())


def named_words(places: Mapping[str, Sequence[str]], rivals: Sequence[Rival], summary: str = "") -> str:
    """Return effects with their joints; of what the log cannot tell from one of them, a sentence each.

    Parameters
    ----------
    places
        Effect -> joints at which it was found.
    rivals
        What does as well.
    summary
        What the effect is, where there is but one.
    """
    sure, ties = list[str](), list[str]()
    for effect, joints in places.items():
        equals = [r for r in rivals if r.instead_of == effect]
        tied = [j for j in joints if any((r.at or r.joint) == j for r in equals)] or (joints if equals else [])
        if free := [joint for joint in joints if joint not in tied]:
            sure.append(f"{spoken(effect)} at {listed(free)}")
        if tied:
            names = [f"{spoken(effect)} at {listed(tied)}"]
            names += [f"{spoken(r.effect)} at {r.joint or 'the robot'}" for r in equals]
            ties.append(f"one of: {', '.join(dict.fromkeys(names))}; this log cannot tell which")
    said = "; ".join(sure) + (in_brackets(summary) if len(sure) == 1 and not rivals else "")
    return " ".join(f"{upper(sentence)}." for sentence in (said, *ties) if sentence)


def in_brackets(summary: str) -> str:
    """Return what an effect is, in brackets and without any inside; nothing of nothing."""
    return f" ({summary.replace(' (', ', ').replace(')', '')})" if summary else ""


def poorly_fitted(found: Diagnosis) -> Mapping[str, Unexplained]:
    """Return what stays of what an effect was named for: joints whose residual follows the same variable as before."""
    named = {effect.joint for effect in found.effects}
    return {
        item.joint: item
        for item in found.unexplained
        if item.joint in named
        for rows, first in ((rows, organised[0]) for (joint, rows), organised in found.organised.items()
                            if joint == item.joint and organised)
        if rows == {"link": "sum"}.get(item.rows, item.rows) and first.variable == item.variable != HELD_OUT
    }  # fmt: skip


def held_out_size(found: Diagnosis, item: Unexplained | RowState) -> tuple[float, float]:
    """Return the error of a row after on the held-out stretches, N·m (N), and over its noise: as all tables have it."""
    if isinstance(item, Unexplained) and item.by_identify:
        return item.rms, item.ratio
    error = found.after.get(item.joint)
    rms, floor = (None, None) if error is None else {
        "sum": (error.rms, error.floor), "link": (error.rms, error.floor),
        "motor": (error.spring_rms, error.spring_floor),
    }.get(item.rows, (None, None))  # fmt: skip
    return (rms, rms / floor) if rms is not None and floor else (item.rms, item.ratio)


def missing_words(told: DiagnosisInput) -> str:
    """Return what the model lacks, and what it is worth, in a sentence."""
    found = told.found
    named = [c for c in told.contributions if c.effect not in found.curves]
    poor = poorly_fitted(found)
    left = [u.joint for u in found.unexplained if u.joint not in poor]
    nothing = "nothing found so far" if found.partial else "no effect that elid knows"
    rest = "".join(_left_words(found, joint, nothing) for joint in dict.fromkeys(left))
    moment = moment_words([item for item in told.after.noise if item.joint in left])
    rest += moment or _suspect_words(found, left)
    if found.partial and not named:
        return f"Not known yet: the search was stopped before it found anything.{rest}"
    if not named:
        sticking = any(r.ratio > HIGH >= r.away for r in found.rows_after)
        where = " away from reversals" if sticking else ""
        nothing = f"Nothing{where}: only the sensors' noise is left, and no effect improves the model."
        if any(row.high for row in found.rows_after):  # what is left is told beside
            nothing = "Nothing that elid can name: no effect that it knows improves the model."
        if taken := taken_up_words(told.after.notes):
            nothing = taken if told.after.insufficient else f"{UNSURE} {taken}"
        return f"{rest.strip() or nothing + hidden_words(told.after)}{taken_as_rigid(found)}"
    order = [*found.robot.joint_names, found.robot.name].index
    named.sort(key=lambda c: order(c.effect.joint or found.robot.name))
    places: dict[str, list[str]] = {}
    for c in named:
        joint = c.effect.joint or found.robot.name
        if joint not in places.setdefault(c.effect.effect, []):
            places[c.effect.effect].append(joint)
    gains = {c.joint: (_better(found, c), c.rows) for c in named}
    better = listed([
        f"{number_text(times, 2)} times at {joint}{' (motor side)' if rows == 'motor' else ''}"
        for joint, (times, rows) in gains.items() if times > BETTER
    ])  # fmt: skip
    tied = found.also_possible
    them = "them" if len(places) > 1 else spoken(named[0].effect.effect) if tied else "it"
    worth = f" With {them} the error is smaller: {better}." if better else ""
    said = named_words(places, tied, summary_words([c.effect for c in named]) if len(places) == 1 else "")
    if all(joint in poor for joints in places.values() for joint in joints):
        said = f"Something that no effect fits well. The nearest that elid knows: {said[:1].lower()}{said[1:]}"
    own = "".join(f" {words}" for words in dict.fromkeys(own_elasticity(found, c.effect) for c in named) if words)
    return (
        f"{said}{own}{worth}{_absorbed_words(told, named)}{_poor_words(found, poor)}{rest or hidden_words(told.after)}"
    )


def _absorbed_words(told: DiagnosisInput, named: Sequence[Contribution]) -> str:
    """Return what it does to base parameters that the model lacked what they can take up; nothing where none did."""
    taken = [whose(c.effect.effect, c.effect.joint) for c in named if c.effect.absorbed]
    if not taken:
        return ""
    them = listed(taken) if len(taken) < len(named) else "it" if len(taken) == 1 else "them"
    known = {item.name: item for item in told.before.parameters if item.std_error > 0}
    pairs = [(abs(item.estimate - known[item.name].estimate) / known[item.name].std_error, item.name)
             for item in told.after.parameters if item.name in known]  # fmt: skip
    size, name = max(((size, name) for size, name in pairs if math.isfinite(size)), default=(0.0, ""))
    off = f": without, {called(name)} is {number_text(size, 2)} of its standard errors off" if size > CLEAR else ""
    return f" Base parameters can take up nearly all of {them}, and the error hardly shows that{off}."


def _left_words(found: Diagnosis, joint: str, nothing: str) -> str:
    """Return how much is left at a joint that nothing explains, and what it goes with."""
    left = {u.variable for u in found.unexplained if u.joint == joint}
    if left <= ABSORBED.keys():
        said = " and ".join(ABSORBED[word].format(joint) for word in sorted(left))
        return f" {upper(said)}: too little is left to tell."
    worst = max((u for u in found.unexplained if u.joint == joint), key=lambda u: held_out_size(found, u)[1])
    names = [words if (words := variable_words(name)) == "time" else f"the {words}"
             for name, _ in left_follows(found, worst)]  # fmt: skip
    goes = f" It {follows_words('time')}." if names == ["time"] else f" It follows {listed(names)}." if names else ""
    times, where = held_out_size(found, worst)[1], ""
    if times < LEFT <= worst.ratio:
        times, where = worst.ratio, " on the stretches that were fitted"
    size = number_text(times, 2)
    return f" {size} times the sensors' noise is left at {joint}{where}, which {nothing} explains.{goes}{_near(worst)}"


def _near(item: Unexplained) -> str:
    """Return what takes most of a residual that it does not explain; nothing where nothing does."""
    near = item.nearest[0] if item.nearest else None
    if near is None or near.gain < NEAR:
        return ""
    kind = effect_classes().get(near.effect)
    forms = "; elid friction compares its other forms" if kind is not None and kind.holds() else ""
    what, part = whose(near.effect, near.joint), number_text(100 * near.gain, 2)
    return f" {upper(what)} comes near: it takes {part} % of that{forms}."


def judged_after(found: Diagnosis) -> tuple[RowState, ...]:
    """Return the rows after, each over its noise as all tables have it."""
    return tuple(replace(row, ratio=held_out_size(found, row)[1]) for row in found.rows_after)


def _suspect_words(found: Diagnosis, left: Sequence[str]) -> str:
    """Return where to look first for what is left at joints, as their rows tell the sides of a joint apart."""
    joints: dict[str, list[str]] = {}
    for joint, side in suspects(judged_after(found)).items():
        if joint in left:
            joints.setdefault(side, []).append(joint)
    places = [f"the {side} at {listed(where)}" for side, where in joints.items()]
    return f" Look first at {'; '.join(places)}." if places else ""


def left_follows(found: Diagnosis, item: Unexplained) -> list[tuple[str, float]]:
    """Return the variables that what is left follows, with the shares of its mean square; time is hardly ever alone.

    What changes slowly follows time as well: the next variable stands beside it where it explains nearly as much.
    """
    told = [(item.variable, item.share)] if item.share > FOLLOWS and item.variable != HELD_OUT else []
    if told and item.variable in TIMES and not found.effects:
        rows = {"link": "sum"}.get(item.rows, item.rows)
        others = [o for o in found.organised.get((item.joint, rows), ()) if o.variable not in TIMES]
        told[:0] = [(o.variable, o.share) for o in others[:1] if o.share > ALSO * item.share]
    return told


def _poor_words(found: Diagnosis, poor: Mapping[str, Unexplained]) -> str:
    """Return at which joints what was named is the nearest that elid knows, and no good fit."""
    said = [
        f" It is a poor fit: what is left at {joint} still follows the {variable_words(item.variable)}, "
        f"{number_text(held_out_size(found, item)[1], 2)} times the sensors' noise."
        for joint, item in poor.items()
    ]
    return "".join(said)


NEAR = 0.5
"""Part of what is left from which an effect comes near to explaining it."""
BETTER = 1.05
"""Error before over that after, from which on it is told."""


def _better(found: Diagnosis, contribution: Contribution) -> float:
    """Return how many times smaller the held-out error of the joint is after, in the row the effect explains best."""
    joint = contribution.joint
    if nuisance_of(contribution.effect.effect):  # the model before has its channels corrected
        return contribution.without / contribution.with_it if contribution.with_it else 0.0
    if contribution.rows in ("sum", "motor") and joint in found.before:
        field = "rms" if contribution.rows == "sum" else "spring_rms"
        before, after = (getattr(e[joint], field) for e in (found.before, found.after))
        if before and after:
            return float(before / after)
    return contribution.whole_without / contribution.with_it if contribution.with_it else 0.0


def further_items(told: DiagnosisInput) -> Items:
    """Return what another log should hold: to tell effects apart, and to know those better that were found."""
    items: list[tuple[str, Cell]] = [
        (f"to tell {whose(r.effect, r.joint)} from {replaced(r, told.found.effects)}", r.separate)
        for r in told.found.also_possible
    ]
    for joint in dict.fromkeys(item.joint for item in told.found.unexplained):
        alone = f"alone, then of the other joints with {joint} still" if told.found.robot.n > 1 else "at several speeds"
        items.append((f"to find what is left at {joint}", f"motion of {joint} {alone}"))
    if loud := list(dict.fromkeys(row.joint for row in loud_rows(told.found))):
        items.append(
            ("to tell torque noise from what depends on several joints",
             f"the same motion twice (what comes again is no noise), and motion of {listed(loud)} alone")
        )  # fmt: skip
    if repeating(told.found):
        items.insert(0, ("to tell effects of the motion from disturbances in time", "a motion that does not repeat"))
    for c in told.contributions:
        effect = c.effect
        vague = any(e > VAGUE_ERROR * abs(effect.parameters.get(name, 0.0)) for name, e in effect.std_error.items())
        if vague and (kind := effect_classes().get(effect.effect)) is not None and kind.record:
            record = kind.record.replace(CUTOFF, f"{CUTOFF} ({number_text(_cutoff(told.found))} Hz here)")
            items.append((f"for {whose(effect.effect, effect.joint)}", record))
    return tuple(dict(items).items())


def loud_rows(found: Diagnosis) -> list[RowState]:
    """Return the rows that hold more than white noise and follow no variable of the motion, the worst first."""
    rows = [] if found.unexplained else [row for row in found.rows_after if row.high]
    return sorted(rows, key=lambda row: -row.ratio)


def _cutoff(found: Diagnosis) -> float:
    return found.state_after.log.signals.filter.cutoff


def repeating(found: Diagnosis) -> bool:
    """Whether the motion repeats and something was found in it, or stays unexplained, that may be of time."""
    return found.repeats is not None and not found.sufficient
