"""The answer of ``elid compare``: what moved between saved results."""

from __future__ import annotations

from collections.abc import Sequence
from math import erfc, sqrt
from typing import Any

from elid_cli.estimation.comparison import Change, Comparison, SavedResult
from elid_cli.estimation.same_joints import TERM
from elid_cli.report.answers.summary import listed, share_text, signed_share
from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    Tone,
    number_text,
    percent,
    warned,
)

SHOWN = 20
DOUBTED = "may be biased: what a model lacks may have moved it, and nothing need have changed"
WORSE, NOTABLE = 3.0, 0.01
"""Held-out error over that of the first result, and of the torque, from which a model is said to lack something."""


def comparison_report(comparisons: Sequence[Comparison], sigmas: float) -> Report:
    """Return the report on all results against the first."""
    results = [comparisons[0].first, *(c.other for c in comparisons)]
    sections: list[Section] = [
        Text("title", " · ".join(dict.fromkeys(r.robot for r in results)), "heading"),
        KeyValues("answers", (("what has changed?", _changed(comparisons, sigmas)),)),
        KeyValues("results", tuple((f"result {k}", r.file) for k, r in enumerate(results, start=1))),
    ]
    for k, comparison in enumerate(comparisons, start=2):
        sections += _moved(comparison, k, sigmas)
    sections += _errors(results)
    sections += warned(doubts_of(comparisons))
    payload = {
        "robot": results[0].robot,
        "files": [r.file for r in results],
        "sigmas": sigmas,
        "comparisons": [_payload(c, sigmas) for c in comparisons],
    }
    return Report("compare", payload, tuple(sections))


def doubts_of(comparisons: Sequence[Comparison]) -> list[str]:
    """Return what makes comparisons mean less than they say, and which joints are left out."""
    results = [comparisons[0].first, *(c.other for c in comparisons)]
    return [*_doubts(results), *(_left_out(c) for c in comparisons if c.left_out)]


def _changed(comparisons: Sequence[Comparison], sigmas: float) -> str:
    """Return in a sentence for each result what moved from the first one by more than `sigmas` standard errors."""
    said, same = [], []
    for comparison in comparisons:
        if comparison.same:
            said.append(_repeated(comparison))
            continue
        moved = sorted(comparison.moved(sigmas), key=lambda change: -abs(change.deviations))
        sure, doubted = ([c for c in moved if c.bias_possible == biased] for biased in (False, True))
        where = f" in {comparison.other.file}" if len(comparisons) > 1 else ""
        said += [f"{_names(sure)}{where}."] if sure else []
        if doubted:
            perhaps = "Perhaps" if not sure else "Perhaps also"
            said.append(
                f"{perhaps} {_names(doubted)}{where}: what a model lacks may have moved "
                f"{'it' if len(doubted) == 1 else 'them'} instead (elid diagnose)."
            )
        same += [] if moved else [comparison.other.file]
    if same:
        where = f" in {listed(same)}" if len(comparisons) > 1 else ""
        said.append(f"Nothing by more than {number_text(sigmas, 3)} standard errors{where}.")
    return " ".join(said)


def _names(changes: Sequence[Change]) -> str:
    return listed([f"{change.name} ({_share(change)})" for change in changes])


def _repeated(comparison: Comparison) -> str:
    first, other = comparison.first.file, comparison.other.file
    if first == other:
        return f"Nothing can: {first} is given twice."
    return f"Nothing can: {other} is the same result as {first}, to the last digit."


def _share(change: Change) -> str:
    """Return the change as a share of the first value."""
    assert change.before.value is not None
    assert change.after.value is not None
    before, after = change.before.value, change.after.value
    return signed_share((after - before) / abs(before)) if before else "from 0"


def _moved(comparison: Comparison, number: int, sigmas: float) -> list[Section]:
    moved = sorted(comparison.moved(sigmas), key=lambda change: -abs(change.deviations))
    against = f"result {number} against result 1"
    if comparison.unshared:
        against += f", {len(comparison.unshared)} base parameters not in both"
    if comparison.left_out:
        against += f", {len(comparison.left_out)} of joints that are not the same"
    either = sum(c.before.value is None and c.after.value is None for c in comparison.changes)
    if either:
        against += f", {either} not shown by either"
    if len(comparison.refused) > either:
        against += f", {len(comparison.refused) - either} not shown by one of them"
    threshold = number_text(sigmas, 3)
    count = len(comparison.changes) - len(comparison.refused) + len(comparison.beside)
    chance = share_text(by_chance(count, sigmas))
    by_luck = f"by chance one of {count} that did not move does so in {chance} of comparisons"
    if not moved:
        line = f"{against}: none of {count} parameters moved by more than {threshold} sd; {by_luck}"
        return [Text(f"unmoved{number}", line)]
    title = f"{against}: {len(moved)} of {count} parameters moved by more than {threshold} sd"
    doubted = any(change.bias_possible for change in moved)
    columns = (
        Column("name", "base parameter"),
        *Column.numbers(before="result 1", after=f"result {number}", change="change", deviations="in sd"),
        Column("unit", "unit"),
        *([Column("verdict", "verdict")] if doubted else []),
    )
    rows = tuple(_row(change, doubted) for change in moved)
    note = f"{by_luck}\n{DOUBTED}" if doubted else by_luck
    return [Table(f"moved{number}", columns, rows, title=title, shown=SHOWN, note=note)]


def by_chance(count: int, sigmas: float) -> float:
    """Return the probability that one of `count` parameters that did not move differs by more than `sigmas` sd."""
    return 1.0 - (1.0 - erfc(sigmas / sqrt(2.0))) ** count


def _row(change: Change, told: bool) -> tuple[Cell, ...]:
    """Return the row of what moved; `told`: with whether it may be biased."""
    before, after = change.before, change.after
    assert before.value is not None
    assert after.value is not None
    difference = after.value - before.value
    tone: Tone = "bad" if abs(change.deviations) > 10 else "warn"
    return (
        change.name,
        Quantity(before.value, resolution=before.std_error),
        Quantity(after.value, resolution=after.std_error),
        percent(difference / abs(before.value) if before.value else None, 2),
        Quantity(change.deviations, digits=2, tone=tone),
        change.unit,
        *((("may be biased" if change.bias_possible else ""),) if told else ()),
    )


def _errors(results: Sequence[SavedResult]) -> list[Section]:
    joints = list(dict.fromkeys(joint for r in results for joint in r.error))
    if not joints:
        return []
    columns = (Column("joint", "joint"), *(Column(f"r{k}", f"result {k}", align="right") for k in _numbers(results)))
    rows: list[tuple[Cell, ...]] = [
        (joint, *(None if (e := r.error.get(joint)) is None else share_text(e) for r in results)) for joint in joints
    ]
    return [Table("error", columns, tuple(rows), title="held-out error, share of torque")]


def _doubts(results: Sequence[SavedResult]) -> list[str]:
    """Return what makes a comparison mean less than it says."""
    first, *others = results
    doubts = [
        f"{other.file} is of {other.robot or 'another robot'} and {first.file} of {first.robot}:"
        " parameters of the same name may not be the same"
        for other in others
        if other.robot != first.robot or other.error.keys() != first.error.keys()
    ]
    doubts += [
        f"{other.file} and {first.file} were found with robot files that differ in geometry, gears, transmissions or "
        "effects: parameters of the same name may not be the same"
        for other in others
        if other.robot == first.robot and "" != other.fingerprint != first.fingerprint != ""
    ]
    for other in others:
        for joint, share in other.error.items():
            before = first.error.get(joint)
            if before and share > WORSE * before and share > NOTABLE:
                doubts.append(
                    f"{joint}: the torque is predicted {number_text(share / before, 2)} times as badly in {other.file}"
                    " as in the first: its model lacks something there, which can bias its parameters (elid diagnose)"
                )
    return doubts


def _left_out(comparison: Comparison) -> str:
    """Return which joints are not compared because they are not the same."""
    terms = [set(map(int, TERM.findall(name))) for name in comparison.left_out]
    alone = set[int]().union(*(of for of in terms if len(of) == 1)) or set[int]().union(*terms)
    joints = [_joint(comparison, k) for k in sorted(alone)]
    count = len(comparison.left_out)
    which = "1 parameter of the same name is" if count == 1 else f"{count} parameters of the same name are"
    return (
        f"{comparison.first.file} and {comparison.other.file} are of robots that differ in {listed(joints)}: "
        f"{which} left out"
    )


def _joint(comparison: Comparison, number: int) -> str:
    """Return what both results call a joint."""
    names = [r.joints[number - 1] if 0 < number <= len(r.joints) else "?"
             for r in (comparison.first, comparison.other)]  # fmt: skip
    return f"joint {number} ({' and '.join(dict.fromkeys(names))})"


def _numbers(results: Sequence[SavedResult]) -> range:
    return range(1, len(results) + 1)


def _payload(comparison: Comparison, sigmas: float) -> dict[str, Any]:
    return {
        "before": comparison.first.file,
        "after": comparison.other.file,
        "moved": [change.name for change in comparison.moved(sigmas)],
        "unshared": list(comparison.unshared),
        "refused": list(comparison.refused),
        "left_out": list(comparison.left_out),
        "same": comparison.same,
        "changes": [_change(change) for change in comparison.changes],
        "beside": [_change(change) for change in comparison.beside],
    }


def _change(change: Change) -> dict[str, Any]:
    return {
        "name": change.name,
        "unit": change.unit,
        "before": change.before.value,
        "after": change.after.value,
        "before_std_error": change.before.std_error,
        "after_std_error": change.after.std_error,
        "deviations": change.deviations,
        "bias_possible": change.bias_possible,
    }
