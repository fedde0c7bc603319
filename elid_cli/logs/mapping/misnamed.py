"""Places that a mapping names for single joints and that a log does not have: each would lock its joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from elid_cli.errors import UsageError, did_you_mean, first_of
from elid_cli.logs.contract import Channel
from elid_cli.logs.mapping.find import ABSENT, LISTED, find
from elid_cli.logs.mapping.language import SignalMap, parse_mapping
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.logs.mapping.resolve import log_name, sources_of
from elid_cli.robot.robot import Robot
from elid_cli.robot.written_keys import written_at

SIDES = ("q", "theta")
"""Signals of which a joint needs one."""


def refuse_misnamed(
    channels: Sequence[Channel], plan: ReadPlan, robot: Robot, mapping: Mapping[str, Any], absent: Sequence[str]
) -> None:
    """Refuse a mapping that names a position of a joint of which the log has none, where it has no such place.

    Parameters
    ----------
    channels, plan
        Of a part of a log, and where signals of the whole robot are read from in it.
    robot
        With all joints.
    mapping
        The user's.
    absent
        Joints of which no log has a position.

    Raises
    ------
    UsageError
        Naming the place, and the nearest one that no other joint has.
    """
    signals, _ = parse_mapping(mapping, robot, "--map")
    used = {pick.source for placement in plan.placements.values() for pick in placement.picks}
    free = [channel for channel in channels if channel.source not in used]
    for key in mapping:
        spec = signals.get(str(key))
        for joint in absent if spec is not None and key in SIDES else ():
            if spec is not None and (why := _lacking(spec, joint, channels, free, robot)):
                said, near = why
                raise UsageError(f"{written_at(key, '--map')}: {key} of {joint}: {said}", hint=near)


def _lacking(
    spec: SignalMap, joint: str, channels: Sequence[Channel], free: Sequence[Channel], robot: Robot
) -> tuple[str, str] | None:
    """Return which place named for a joint is not in the log, and what is near; None where none is named, or it is."""
    named = isinstance(spec.source, tuple) or (spec.joints is not None and joint in spec.joints)
    source = sources_of(spec, robot, robot.numbers)[robot.joint_names.index(joint)]
    if not named or not source:
        return None
    by_source: dict[str, list[Channel]] = {}
    for channel in channels:
        by_source.setdefault(channel.source, []).append(channel)
    found = find(spec, source, by_source, near=False)
    if isinstance(found, str):
        places = [channel.source for channel in free if channel.width]
        return (found, did_you_mean(source, places)) if found.startswith(ABSENT) else None
    own = log_name(spec, joint)
    if not found.labels or isinstance(own, int) or own in found.labels or found.open_ended:
        return None
    others = {log_name(spec, other) for other in robot.joint_names if other != joint}
    labels = first_of(list(found.labels), LISTED, " ")
    near = did_you_mean(own, [label for label in found.labels if label not in others])
    return f"{found.address} names {labels}, not {own!r}", near
