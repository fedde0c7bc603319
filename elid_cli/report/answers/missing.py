"""What a model lacks, in sentences: the effects by their readable names, what they are worth, what to record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from elid_cli.diagnosis import Diagnosis, FoundEffect, Rival
from elid_cli.diagnosis.refit import Contribution
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.model.effects.kinds import CurveEffect
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.inputs import Items
from elid_cli.report.answers.summary import AT_FLOOR, listed
from elid_cli.report.tree import Cell, number_text

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


def spoken(effect: str) -> str:
    """Return an effect's name as it is read: ``velocity coupling``, ``Stribeck friction``."""
    kind = effect_classes().get(effect)
    return kind.title if kind is not None and kind.title else effect.replace("_", " ")


def whose(effect: str, joint: str | None) -> str:
    """Return an effect with its joint, as it is read: ``velocity coupling of joint1``."""
    return spoken(effect) if joint is None else f"{spoken(effect)} of {joint}"


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
    """Return effects with their joints; what the log cannot tell from one of them stands beside it as its equal.

    Parameters
    ----------
    places
        Effect -> joints at which it was found.
    rivals
        What does as well.
    summary
        What the effect is, where there is but one.
    """
    groups: list[str] = []
    for effect, joints in places.items():
        equals = [r for r in rivals if r.instead_of == effect]
        tied = [joint for joint in joints if any(r.joint == joint for r in equals)] or (joints if equals else [])
        if free := [joint for joint in joints if joint not in tied]:
            groups.append(f"{spoken(effect)} at {listed(free)}")
        if tied:
            names = [f"{spoken(effect)} at {listed(tied)}"]
            names += [f"{spoken(r.effect)} at {r.joint or 'the robot'}" for r in equals]
            groups.append(f"one of: {', '.join(dict.fromkeys(names))}; this log cannot tell which")
    alone = len(groups) == 1 and not rivals
    said = "; ".join(groups) + (f" ({summary})" if summary and alone else "")
    return f"{said[:1].upper()}{said[1:]}."


VAGUE_ERROR = 0.1
"""Relative standard error from which on another log should sharpen an effect's amplitude."""


def missing_words(told: DiagnosisInput) -> str:
    """Return what the model lacks, and what it is worth, in a sentence."""
    found = told.found
    named = [c for c in told.contributions if c.effect not in found.curves]
    left = [u.joint for u in found.unexplained]
    nothing = "nothing found so far" if found.partial else "no effect of the library"
    rest = f" More than noise is left at {listed(list(dict.fromkeys(left)))}, which {nothing} explains." if left else ""
    if found.partial and not named:
        return f"Not known yet: the search was stopped before it found anything.{rest}"
    if not named:
        sticking = any(r.ratio > AT_FLOOR >= r.away for r in found.rows_after)
        where = " away from reversals" if sticking else ""
        nothing = f"Nothing{where}: only the sensors' noise is left, and no effect improves the model."
        if any(row.high for row in found.rows_after):  # what is left is told beside
            nothing = "Nothing that this log shows: no effect of the library improves the model."
        return rest.strip() or nothing
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
    return f"{said}{worth}{rest}"


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
        (f"to tell {whose(r.effect, r.joint)} from {spoken(r.instead_of)}", r.separate)
        for r in told.found.also_possible
    ]
    if repeating(told.found):
        items.insert(0, ("to tell effects of the motion from disturbances in time", "a motion that does not repeat"))
    for c in told.contributions:
        effect = c.effect
        vague = any(e > VAGUE_ERROR * abs(effect.parameters.get(name, 0.0)) for name, e in effect.std_error.items())
        if vague and (kind := effect_classes().get(effect.effect)) is not None and kind.record:
            items.append((f"for {whose(effect.effect, effect.joint)}", kind.record))
    return tuple(dict(items).items())


def repeating(found: Diagnosis) -> bool:
    """Whether the motion repeats and something was found in it, or stays unexplained, that may be of time."""
    return found.repeats is not None and not found.sufficient
