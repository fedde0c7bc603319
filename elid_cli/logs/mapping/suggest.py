"""A mapping to paste where elid cannot tell a signal's channel: guessed from names, never applied."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from elid_cli.errors import nearest
from elid_cli.logs.contract import Channel
from elid_cli.logs.mapping.resolve import DEFAULT_FIELDS

WORDS: Mapping[str, tuple[str, ...]] = {
    "t": ("time", "stamp", "t"),
    "tau": ("taum", "tau", "torque", "effort", "current", "voltage", "u", "i"),
    "theta": ("theta", "motor_position", "motor_pos", "motor", "rotor"),
    "q": ("q", "link", "joint", "position", "pos", "deflection", "defl"),
}
"""Words that name a signal, the surest first."""
OTHER_SIDE = {"tau": ("cmd", "ref", "desired", "link"), "theta": ("ref", "cmd", "vel", "dtheta", "rad_s")}
OTHER_SIDE["q"] = ("ref", "cmd", "vel", "dq", "rad_s", "motor", "tau", "effort", "current")
POSITIONAL = {"position", "positions", "pos", "q", "theta", "angle", "angles", "rad", "deg", "counts", "ticks"}
"""Words, some of them units, of which a message's field has one where it may be a position."""
MILLIAMPERE = r"(_ma(_|$)|milliamp)"
UNITS = (
    (r"(deg|grad)", "deg"),
    (r"(counts|ticks)", "counts:4096"),
    (rf"(current|_a$|amp|{MILLIAMPERE})", "A"),
    (r"mnm", "mN.m"),
)


def suggestion(
    channels: Sequence[Channel],
    joints: Sequence[str],
    signals: Sequence[str],
    works: Callable[[str], bool] = lambda line: True,
) -> str:
    """Return YAML lines that map `signals` to the channels whose names fit best; empty where none does.

    `works` is asked whether the log can be read by a line: one that cannot, which may be what has just failed, is no
    suggestion.
    """
    sources = _patterns(channels, joints)
    lines = []
    for signal in signals:
        scores = [_score(signal, source.source, source.field) for source in sources]
        for k in sorted(range(len(sources)), key=lambda k: -scores[k]):
            line = f"{signal}: {_spec(signal, sources[k], joints)}" if scores[k] > 0 else ""
            if line and works(line):
                lines.append(line)
                break
    return "\n".join(lines)


def _patterns(channels: Sequence[Channel], joints: Sequence[str]) -> list[Channel]:
    """Return the channels with one entry per family of columns: ``theta1_rad theta2_rad`` become ``theta{i}_rad``."""
    families: dict[tuple[str, str], list[Channel]] = {}
    for channel in channels:
        families.setdefault((_pattern(channel.source, joints), channel.field), []).append(channel)
    found = []
    for (pattern, field), members in families.items():
        first = members[0]
        whole = len(members) == 1 and first.width > 1
        found.append(first if whole or pattern == first.source else Channel(pattern, field, 1, kind=first.kind))
    return found


def _pattern(source: str, joints: Sequence[str]) -> str:
    for joint in sorted(joints, key=len, reverse=True):
        if re.search(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", source):
            return source.replace(joint, "{joint}", 1)
    match = re.search(r"\d+", source)
    if match and len(joints) > 1 and 1 <= int(match.group()) <= len(joints):
        return f"{source[: match.start()]}{{i}}{source[match.end() :]}"
    return source


def _score(signal: str, source: str, field: str) -> int:
    """Return how well a name fits a signal; 0: not at all."""
    text = f"{source}.{field}".lower().replace("{i}", " ").replace("{joint}", " ")
    words = re.split(r"[^a-z]+", text)
    if any(word in text for word in OTHER_SIDE.get(signal, ())):
        return 0
    if field and signal != "t" and signal in DEFAULT_FIELDS:
        wanted = DEFAULT_FIELDS[signal]
        if wanted == "position" and not POSITIONAL & set(re.split(r"[^a-z]+", field.lower())):
            return 0
    if signal == "t" and ("{i}" in source or "{joint}" in source):
        return 0
    for rank, word in enumerate(WORDS[signal]):
        if word in words or (len(word) > 3 and word in text):
            return len(WORDS[signal]) - rank
    return 0


def _spec(signal: str, channel: Channel, joints: Sequence[str]) -> str:
    quote = '"' if re.search(r"[{}:,#\[\]]", channel.source) else ""
    parts = [f"from: {quote}{channel.source}{quote}"]
    if channel.field:
        parts.append(f"field: {channel.field}")
    if channel.labels and not set(joints) <= set(channel.labels) and joints:
        names = [nearest(joint, channel.labels) for joint in joints]
        if None in names or len(set(names)) < len(names):
            names = list(channel.labels[: len(joints)])
        pairs = ", ".join(f"{joint}: {name}" for joint, name in zip(joints, names, strict=False))
        parts.append(f"joints: {{{pairs}}}")
    if signal == "q" and "defl" in channel.address.lower():
        parts.append("add: theta")
    if signal == "t":
        unit = next((u for u in ("ns", "us", "ms") if re.search(rf"(_|\b){u}\b", channel.source.lower())), "s")
        parts.append(f"unit: {unit}")
    else:
        text = channel.address.lower()
        unit = next((unit for pattern, unit in UNITS if re.search(pattern, text)), "")
        if unit:
            parts.append(f"unit: {unit}")
        if unit == "A":
            parts.append("scale: 0.001" if re.search(MILLIAMPERE, text) else "scale: 1.0")
        if "motor" in text and signal == "tau" and unit != "A":
            parts.append("side: motor")
    return "{" + ", ".join(parts) + "}"
