"""Find the channel of a log that a mapping names, or say why there is none."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence

from elid_cli.errors import nearest
from elid_cli.logs.contract import Channel
from elid_cli.logs.mapping.language import GAINS, POSITIONS, TORQUES, VELOCITIES, SignalMap
from elid_cli.signals.recording import ACCEL, GYRO

LISTED = 12
"""Fields and names that a reason lists."""
ABSENT = "the log has no "
"""How the reason begins where a place is not in the log at all."""
DEFAULT_FIELDS = dict.fromkeys(POSITIONS, "position") | dict.fromkeys(VELOCITIES, "velocity")
DEFAULT_FIELDS |= dict.fromkeys(TORQUES, "effort") | {s: s for s in ("temperature", *GAINS)}
DEFAULT_FIELDS |= {signal: f"angular_velocity.{signal[-1]}" for signal in GYRO}
DEFAULT_FIELDS |= {signal: f"linear_acceleration.{signal[-1]}" for signal in ACCEL}


def find(spec: SignalMap, source: str, by_source: Mapping[str, Sequence[Channel]], *, near: bool) -> Channel | str:
    """Return the channel that `source` and the mapping's field name, or why there is none."""
    field = spec.field
    found = by_source.get(as_held(source, by_source))
    if found is None and not field:  # the short form /topic.field
        for cut in (i for i, letter in enumerate(source) if letter == "."):
            if (topic := rooted(source[:cut], by_source)) in by_source:
                found, field = by_source[topic], source[cut + 1 :]
                break
    if found is None:
        like = nearest(source, by_source) if near else None
        return f"{ABSENT}{source!r}" + (f" (nearest: {like!r})" if like else "")
    if len(found) == 1 and not found[0].width:
        return f"{found[0].source} cannot be read: {found[0].kind}"
    fields = {channel.field: channel for channel in found}
    held = _field_like(field, fields) if field else _usual_field(spec.signal, [channel.field for channel in found])
    if held is not None:
        return fields[held]
    wanted = field or DEFAULT_FIELDS[spec.signal]
    named = [name for name in fields if name and not name.endswith("sec")]
    only = f"only {', '.join(named[:LISTED])}" if named else f"it cannot be decoded: {found[0].kind}"
    like = nearest(wanted, named) if near else None
    return f"{found[0].source} has no field {wanted!r}, {only}" + (f" (nearest: {like!r})" if like else "")


def rooted(source: str, by_source: Container[str]) -> str:
    """Return a dataset's path or a topic with its first slash, which may be left out, where the log has it so."""
    return f"/{source}" if source not in by_source and f"/{source}" in by_source else source


def as_held(source: str, by_source: Container[str]) -> str:
    """Return the name of a channel as the log has it: with the first slash, without a unit in brackets."""
    if (found := rooted(source, by_source)) in by_source:
        return found
    return re.sub(r"\s*[\[(][^\[\]()]*[A-Za-zµ°%][^\[\]()]*[\])]$", "", source)


def _usual_field(signal: str, fields: Sequence[str]) -> str | None:
    """Return the field of a channel that holds a signal where the mapping names none."""
    # data, values: arrays of std_msgs, and those whose names are a topic of their own
    usual = next((name for name in (DEFAULT_FIELDS[signal], "data", "values") if name in fields), None)
    return fields[0] if len(fields) == 1 else usual


def _field_like(field: str, fields: Iterable[str]) -> str | None:
    """Return the field that a path names: itself, an interface by its full path, or the only path that contains it."""
    interface = field.removeprefix("interface_values.")
    for exact in (field, interface):
        if exact in fields:
            return exact
    holding = [path for path in fields if path.startswith(f"{field}.") or path.endswith(f".{field}")]
    return holding[0] if len(holding) == 1 else None
