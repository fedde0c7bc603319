"""Columns that are one signal's at every joint, told by their names, and the units that these end in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from elid_cli.errors import nearest
from elid_cli.logs.contract import Channel
from elid_cli.logs.mapping.language import UNIT_WORDS, plain_unit


@dataclass(frozen=True)
class Family:
    """The columns of a signal, and how a mapping writes them."""

    members: tuple[str, ...]
    source: str
    """A pattern or a list, quoted where it must be."""
    joints: str = ""
    """The `joints` of the mapping."""
    held: tuple[str, ...] = ()
    """The robot's joints that the members are of; empty: not known."""

    @property
    def stem(self) -> str:
        """Its pattern without the joint, whose end may be a unit: ``q_deg`` of ``q_deg.{joint}``."""
        return re.sub(r"[./]?\{(joint|i|i0)\}", "", self.source.strip('"'))


def family(channel: Channel, channels: Sequence[Channel], joints: Sequence[str]) -> Family | None:
    """Return the columns that are a channel's at the joints, of at least half of them; None: it stands alone."""
    if channel.width > 1:
        return None
    source, names = channel.source, [c.source for c in channels if c.field == channel.field and c.width == 1]
    whole = _named_alike(source, names, joints)
    if whole is not None or len(joints) < 2:
        return whole
    return (
        _numbered_alike(source, names, len(joints))
        or _peers(source, names, joints)
        or _named_but_for_units(source, names, joints)
    )


def _named_alike(source: str, names: Sequence[str], joints: Sequence[str]) -> Family | None:
    """Return the columns whose names differ from `source` in a joint's name alone, if every joint has one."""
    for pattern in _patterns(source, joints):
        members = [name for other in joints if (name := pattern.replace("{joint}", other)) in names]
        if len(members) == len(joints):
            return Family(tuple(members), f'"{pattern}"', held=tuple(joints))
    return None


def _named_but_for_units(source: str, names: Sequence[str], joints: Sequence[str]) -> Family | None:
    """Return the same where half of the joints have one, and names may end in units of their own."""
    for stem in dict.fromkeys((source, parted(source)[0])):
        for pattern in _patterns(stem, joints):
            found = with_units(pattern, names, joints)
            if found is not None and 2 * len(found.held) >= len(joints):
                return found
    return None


def with_units(pattern: str, names: Sequence[str], joints: Sequence[str]) -> Family | None:
    """Return the columns that a pattern names, or names but for a unit at their end; None: there are none."""
    by_stem = {parted(name)[0]: name for name in names} | {name: name for name in names}
    filled = [pattern.replace("{joint}", joint) for joint in joints]
    own = [by_stem.get(name) for name in filled]
    members = tuple(name for name in own if name is not None)
    held = tuple(joint for joint, name in zip(joints, own, strict=True) if name is not None)
    tails = {name.removeprefix(stem) for stem, name in zip(filled, own, strict=True) if name is not None}
    if len(tails) == 1:
        return Family(members, f'"{pattern}{tails.pop()}"', held=held)
    listed = ", ".join("null" if name is None else quoted(name) for name in own)
    return Family(members, f"[{listed}]", held=held) if members else None


def _patterns(source: str, joints: Sequence[str]) -> Iterable[str]:
    """Yield a name with ``{joint}`` in place of each joint's name that stands alone in it, the longest first."""
    for joint in sorted(joints, key=len, reverse=True):
        if re.search(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", source):
            yield source.replace(joint, "{joint}", 1)


def _numbered_alike(source: str, names: Sequence[str], joints: int) -> Family | None:
    """Return the columns whose names differ from `source` in a number alone that counts the joints."""
    for match in reversed(list(re.finditer(r"\d+", source))):
        before, after = source[: match.start()], source[match.end() :]
        like = re.compile(rf"{re.escape(before)}(\d+){re.escape(after)}")
        numbers = sorted(int(found[1]) for name in names if (found := like.fullmatch(name)))
        count = min(len(numbers), joints)  # fewer: of the first joints, as the others are held
        if count > 1 and numbers[:count] == list(range(numbers[0], numbers[0] + count)):
            mark = {0: "{i0}", 1: "{i}"}.get(numbers[0])
            members = tuple(f"{before}{number}{after}" for number in numbers)
            if mark or count == joints:
                listed = f"[{', '.join(map(quoted, members[:joints]))}]"
                return Family(members, f'"{before}{mark}{after}"' if mark else listed)
    return None


def _peers(source: str, names: Sequence[str], joints: Sequence[str]) -> Family | None:
    """Return the columns of the same group as `source` whose names are like the joints', each like another one's."""
    for cut in (".", "/"):
        head, _, own = source.rpartition(cut)
        peers = [name.rpartition(cut)[2] for name in names if head and own and name.rpartition(cut)[0] == head]
        close = [name for joint in joints if (name := nearest(joint, peers)) is not None]
        if len(set(close)) == len(joints):
            members = tuple(f"{head}{cut}{name}" for name in close)
            return Family(members, f'"{head}{cut}{{joint}}"', pairs(joints, close), held=tuple(joints))
    return None


def called(joints: Sequence[str], labels: Sequence[str], before: Sequence[str | None]) -> list[str | None]:
    """Return what a channel calls each joint, None where it has none left for it; no two joints share a name.

    `before` is what another channel calls them, empty for the first: a joint is the same one in all of them.
    """
    labels = list(dict.fromkeys(labels))
    wanted = [name or joint for name, joint in zip(before or joints, joints, strict=True)]
    own = [name if name in labels else None for name in wanted]
    if before and any(own):
        return own
    left = [name for name in labels if name not in own]
    close = [name or nearest(like, left) for name, like in zip(own, wanted, strict=True)]
    if None not in close and len(set(close)) == len(close):
        return close
    return [name or (left.pop(0) if left else None) for name in own]


def pairs(joints: Sequence[str], names: Sequence[object]) -> str:
    """Return the `joints` of a mapping; those without a name are left out."""
    return ", ".join(f"{joint}: {name}" for joint, name in zip(joints, names, strict=False) if name is not None)


def parted(name: str) -> tuple[str, str]:
    """Return a column's name without the unit at its end, and that unit as the mapping language writes it, if any."""
    match = re.fullmatch(r"(.*[^_\s(\[])[_\s(\[]+([^_\s(\[\])]+)[\])]*", name)
    if match is None:
        return name, ""
    for text in (match[2], re.sub(r"(?<=[^\W\d]{3})\d+$", "", match[2])):  # pos_deg1 as pos_deg
        known = UNIT_WORDS.get(plain_unit(text))
        if known is not None:
            return match[1], known
    return name, ""


def unit_of(address: str, written: str) -> str:
    """Return the unit that a header or the end of a name tells, as the mapping language writes it; empty: none."""
    known = UNIT_WORDS.get(plain_unit(written)) or parted(address)[1]
    return known or ("counts:4096" if re.search(r"counts|ticks", address.lower()) else "")


def quoted(name: str) -> str:
    """Return a name as a mapping writes it."""
    from elid_cli.robot.yaml import quoted as as_yaml

    return as_yaml(name)
