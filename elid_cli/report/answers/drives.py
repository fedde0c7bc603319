"""What a fit of the motion under commands found, drive by drive: the bodies stay those of the robot file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, inf, log10
from typing import Any

from elid_cli.errors import in_words
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.verdicts import WEAK
from elid_cli.report.answers.summary import (
    JOINT_KINDS,
    NAMED,
    NEEDS,
    NOT_SHOWN,
    RULE,
    SYMBOLS,
    listed,
    share_text,
)
from elid_cli.report.tree import Cell, Column, Mark, Table, number_text, upper

DRIVE = ("Ja", "fs", "fv")
"""Parameters of a drive that may be known roughly; an offset near 0 is as well known as another."""
WORDS = {kind: JOINT_KINDS[kind] for kind in DRIVE} | {"offset": "torque offset"}
DIGITS = 4
"""Most digits of a value."""
OFFSETS = (
    "offset: by how much the computed torque is above the one that acts, or half of what friction is larger forwards "
    "than backwards: they look the same"
)
OWN = "what weights and inertias are off in the file, offset and Ja are off here"
UNITS = {True: "kg·m², N·m, N·m·s/rad and N·m", False: "kg, N, N·s/m and N"}
"""Units of the columns, of turning joints and of sliding ones."""


def drives_table(found: Identification) -> Table:
    """Return the table of the drives, one a row."""
    columns = (
        Column("joint", "joint"),
        *Column.numbers(Ja="Ja", fs="fs", fv="fv", offset="offset"),
    )
    rows = [(joint, *(_cell(values[kind], kind) for kind in WORDS)) for joint, values in found.drives.items()]
    turning = {joint.revolute for joint in found.robot.joints}
    unit = "; of sliding joints ".join(words for kind, words in UNITS.items() if kind in turning)
    symbols = "; ".join(f"{kind}: {SYMBOLS[kind]}" for kind in DRIVE)
    note = "\n".join([symbols, OFFSETS, f"in {unit}, with one standard error each", OWN])
    return Table("drives", columns, tuple(rows), f"drives, with the bodies of {found.robot.name}", note=note)


def _cell(item: Mapping[str, Any], kind: str) -> Cell:
    if item["verdict"] == "refused":
        return Mark(NOT_SHOWN, "bad")
    value, deviation = item["estimate"], item["std_error"]
    # four such columns fit a terminal: one digit of the error, and four of the value at most
    if not 0 < deviation < inf:
        text = f"{number_text(value)} ± {number_text(deviation)}"
    else:
        decimals = -floor(log10(deviation))
        if value:
            decimals = min(decimals, DIGITS - 1 - floor(log10(abs(value))))
        decimals = min(max(decimals, 0), 12)
        least = 10.0**-decimals
        error = f"{deviation:.{decimals}f}" if deviation >= 0.5 * least else f"< {least:.{decimals}f}"
        text = f"{value:.{decimals}f} ± {error}"
    doubtful = item.get("bias_possible") or (kind in DRIVE and item["verdict"] == "weak")
    return Mark(text, "warn") if doubtful else text


def _share(item: Mapping[str, Any]) -> float:
    return item["std_error"] / abs(item["estimate"]) if item["estimate"] else inf


def drives_words(found: Identification) -> str:
    """Return how well the drives are known, in a few sentences."""
    drives, names, (rough, doubted) = found.drives, in_words(list(WORDS.values())), _weak(found)
    lacking = _lacking(found)
    hidden = _of_verdict(found, "refused")
    still = sorted({joint for joints in hidden.values() for joint in joints}, key=list(drives).index)
    moving = len(drives) - len(still)
    whole = "the joint" if len(drives) == 1 else f"{f'{moving} of' if still else 'all'} {len(drives)} joints"
    said = [f"{upper(names)} of {whole}, with the bodies of the robot file"]
    if still:
        said.append(f"{upper(NOT_SHOWN)} by this log: {_kinds(hidden)}")
    if rough:
        said.append(f"Known roughly, not {RULE}: {_kinds(rough)}")
    if doubted:
        said.append(f"May be biased, as the motion they are fitted to is far off: {_kinds(doubted)}")
    if lacking:
        whose = "all values" if len(lacking) == len(drives) else f"values of {listed(lacking)}"
        said.append(f"May be biased by what is missing: {whose}")
    sizes = []
    for kind in DRIVE:
        known = {joint: item[kind] for joint, item in drives.items()
                 if item[kind]["verdict"] == "supported" and joint not in lacking}  # fmt: skip
        known = {joint: item for joint, item in known.items() if _share(item) <= WEAK}  # others are small
        if known:
            worst, share = max(((joint, _share(item)) for joint, item in known.items()), key=lambda pair: pair[1])
            sizes.append(f"{WORDS[kind]} {share_text(share)} ({worst})")
    said += (
        [f"Largest standard errors of the {'others' if rough or doubted or lacking else 'values'}: {', '.join(sizes)}"]
        if sizes
        else []
    )
    return " ".join(f"{sentence}." for sentence in said)


def _of_verdict(found: Identification, verdict: str) -> dict[str, list[str]]:
    """Return the joints of which a parameter has a verdict, by parameter."""
    rough: dict[str, list[str]] = {}
    for joint, values in found.drives.items():
        for kind in DRIVE:
            if values[kind]["verdict"] == verdict:
                rough.setdefault(kind, []).append(joint)
    return rough


def _weak(found: Identification) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return the joints of which a parameter is known roughly by its error, and by the motion alone, by parameter."""
    weak = _of_verdict(found, "weak")
    by_error = {kind: [joint for joint in joints if _share(found.drives[joint][kind]) > WEAK]
                for kind, joints in weak.items()}  # fmt: skip
    others = {kind: [joint for joint in joints if joint not in by_error[kind]] for kind, joints in weak.items()}
    return ({kind: joints for kind, joints in by_error.items() if joints},
            {kind: joints for kind, joints in others.items() if joints})  # fmt: skip


def _lacking(found: Identification) -> list[str]:
    """Return the joints of which a value that is known by its error may be biased by what is missing."""
    return [joint for joint, values in found.drives.items()
            if any(own["verdict"] == "supported" and own.get("bias_possible") for own in values.values())]  # fmt: skip


def drives_needed(found: Identification) -> Sequence[tuple[str, Cell]]:
    """Return what the next log should hold for what is known roughly: for what, and what."""
    needed, _ = _weak(found)
    still = {joint: None for joints in _of_verdict(found, "refused").values() for joint in joints}
    said = {kind: joints[0] if len(joints) == 1 else "these joints" for kind, joints in needed.items()}
    moves: list[tuple[str, Cell]] = [(f"for all of {in_words(list(still), NAMED)}", "motion")] if still else []
    return moves + [
        (f"for {WORDS[kind]} of {in_words(joints, NAMED)}", NEEDS[kind].format(said[kind]))
        for kind, joints in needed.items()
    ]


def _kinds(joints_of: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{WORDS[kind]} of {listed(joints)}" for kind, joints in joints_of.items())
