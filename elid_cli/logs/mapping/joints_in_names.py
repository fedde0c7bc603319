"""Names of joints in those of columns: ``shoulder_motor_pos``, ``elbow_motor_pos``; ``torque.hip``, ``torque.knee``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from elid_cli.logs.contract import Channel
from elid_cli.logs.mapping.suggest import NO_POSITION, POSITIONAL, RATES

MEANING = POSITIONAL | NO_POSITION | RATES
"""Words that say what a column holds, and name no joint."""


def names_in_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Return what tells columns of the same meaning apart, in their order; empty where no two joints are named so.

    A column's name is cut in two at one of its separators. The part with a word for what it holds is its meaning, the
    other one the joint. Every joint must have two columns at least, the same as the others.
    """
    found: dict[tuple[str, bool], list[str]] = {}
    for column in columns:
        for meaning, joint, leads in _cuts(column):
            found.setdefault((meaning, leads), []).append(joint)
    groups: dict[tuple[str, ...], int] = {}
    for joints in found.values():
        if len(joints) > 1:
            groups[tuple(joints)] = groups.get(tuple(joints), 0) + 1
    best = max(groups, key=lambda joints: (groups[joints] * len(joints), -len("".join(joints))), default=())
    return best if best and groups[best] > 1 else ()


def named_joints(channels: Sequence[Channel]) -> tuple[str, ...]:
    """Return the joints that a log names itself: those of its arrays or messages, or in the names of its columns."""
    labelled = [channel.labels for channel in channels if channel.labels]
    if labelled:
        return tuple(dict.fromkeys(label for labels in labelled for label in labels))
    named = [m.group(1) for c in channels if (m := re.fullmatch(r"/?(?:q|theta|tau)[./](.+)", c.source))]
    if named:
        return tuple(dict.fromkeys(named))
    return names_in_columns([c.source for c in channels if c.width == 1 and not c.field])


def _cuts(column: str) -> list[tuple[str, str, bool]]:
    """Return the ways in which a name is a meaning and a joint, and whether the joint leads."""
    places = [m.span() for m in re.finditer(r"[_./: -]+", column.strip("/"))]
    parts, found = column.strip("/"), []
    for start, stop in places:
        first, last = parts[:start], parts[stop:]
        for meaning, joint, leads in ((last, first, True), (first, last, False)):
            if _means(meaning) and not _means(joint) and not re.fullmatch(r"\d*", joint):
                found.append((meaning, joint, leads))
    return found


def _means(text: str) -> bool:
    """Whether a part of a name says what it holds."""
    words = re.split(r"[_./: -]+", text.lower())
    pairs = {f"{a}_{b}" for a, b in pairwise(words)}
    return bool(MEANING & ({re.sub(r"\d+$", "", word) for word in words} | pairs))
