"""The robot as its logs show it: joints that they do not hold are locked, ``transmission: auto`` is decided."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError, first_of, nearest
from elid_cli.logs.checks.deflection import Sensed, same_position
from elid_cli.logs.contract import RawLog
from elid_cli.logs.mapping.joints_in_names import named_joints
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.logs.mapping.long_table import reshaped
from elid_cli.logs.mapping.misnamed import refuse_misnamed
from elid_cli.logs.mapping.plan import Placement, ReadPlan
from elid_cli.logs.mapping.resolve import resolve
from elid_cli.logs.reading import converted, layers_of
from elid_cli.logs.repair.clocks import in_seconds
from elid_cli.logs.source import open_source
from elid_cli.logs.writing import recognise
from elid_cli.robot.locking import beyond_limits, locked
from elid_cli.robot.mjcf.held import folded
from elid_cli.robot.robot import Joint, Robot

YIELDING = "with transmission: elastic in the robot file, identify looks for a stiffness"
"""What a note says of joints that are taken as rigid with nothing but their motors' positions."""
SAME = "q and theta differ by no more than a constant and sensor noise"
APART = 0.02
"""rad or m from where a joint is locked beyond which it is said to be elsewhere: zeros differ by less."""
LISTED = 8
"""Joints that a note names."""
IDLE = 1e-3
"""rad or m within which a joint whose torque is not measured counts as standing still."""


def robot_as_logged(
    robot: Robot,
    logs: Sequence[str | Path],
    mapping: Mapping[str, Any] | None = None,
    hold: Mapping[str, float] | None = None,
) -> Robot:
    """Return the robot with its open questions answered by logs (none: by the description alone).

    Joints of a robot from URDF or MJCF that no log holds are locked at 0, or where `hold` says; where a log has a joint
    without any motion, it is locked there, if the log has both positions, or no torque of that joint but of others (the
    fingers of a gripper), or of none (commands that a brake does not follow). A transmission ``auto`` is elastic where
    every log holds both positions of its joint and one of them shows that they differ by more than sensor noise, or
    where K is known and a log holds the motor's position; else it is rigid. What was decided is in `Robot.notes`.

    Parameters
    ----------
    robot
        As described.
    logs
        As for `read_recording`; one that cannot be read decides nothing.
    mapping
        As for `read_recording`.
    hold
        Values, rad or m, of joints that are locked whatever the logs hold.
    """
    hold = dict(hold or {})
    told = beyond_limits(robot, hold)
    robot = locked(robot, hold)
    told += _elsewhere(robot, logs, mapping)
    auto = [joint.name for joint in robot.joints if joint.transmission == "auto"]
    if not (hold or auto or robot.source):
        return replace(robot, notes=(*robot.notes, *_ungeared(robot)))
    parts = [found for log in logs for found in _held(robot, log, mapping, auto)]
    notes = [*robot.notes, *told]
    if parts and robot.source:
        _refuse_misnamed(robot, parts, logs, mapping)
        robot, locks = _without_absent(robot, parts)
        notes += locks
    notes = [note for note in notes if not any(note.startswith(f"{name} mimics ") for name in robot.held)]
    joints = list(robot.joints)
    decided: dict[str, list[str]] = {}
    for k, joint in enumerate(joints):
        if joint.transmission == "auto":
            known = "K" in joint.parameters
            both = bool(parts) and all(joint.name in part.link & part.motor for part in parts)
            spring = known and all(joint.name in part.motor for part in parts)
            elastic = spring or (both and not all(joint.name in part.twice for part in parts))
            joints[k] = replace(joint, transmission="elastic" if elastic else "rigid")
            reason = "the log holds both positions" if both else "the description gives K"
            motors = bool(parts) and all(joint.name in part.motor - part.link for part in parts)
            other = f"rigid: {SAME}" if both else f"rigid: {YIELDING}" if motors else "rigid"
            said = f"elastic: {reason}" if elastic else other
            decided.setdefault(said, []).append(joint.name)
    if parts:
        notes += [f"{_listed(names)} taken as {what}" for what, names in decided.items()]
    return folded(replace(robot, joints=tuple(joints), notes=(*notes, *_ungeared(robot))))


def joints_held(robot: Robot, log: str | Path, mapping: Mapping[str, Any] | None = None) -> frozenset[str]:
    """Return the joints of which a log has positions, moving or not; none of one that cannot be read."""
    return frozenset(name for part in _held(robot, log, mapping, ()) for name in part.link | part.motor)


def _without_absent(robot: Robot, parts: Sequence[_Held]) -> tuple[Robot, list[str]]:
    """Return the robot with those joints locked that no part holds or moves, where others are left, and what to say."""
    places = {n: {part.still.get(n) for part in parts if n in part.link | part.motor} for n in robot.joint_names}
    absent = [name for name, found in places.items() if not found]
    still = {name: at for name, found in places.items() if len(found) == 1 for at in found if at is not None}
    if len(absent) + len(still) == robot.n:
        still = {}
    said = []
    if 0 < len(absent) < robot.n:
        near = _nearest(robot, absent, parts)
        said.append(f"{_count(absent)} locked at 0, as the log does not hold {_them(absent)}: {_listed(absent)}{near}")
        robot = locked(robot, dict.fromkeys(absent, 0.0))
    if still:
        where = _listed([f"{name} at {at:g}" for name, at in still.items()])
        said.append(f"{_count(list(still))} locked where the log has {_them(list(still))} without any motion: {where}")
    said += beyond_limits(robot, still)
    return locked(robot, still), said


def _refuse_misnamed(
    robot: Robot, parts: Sequence[_Held], logs: Sequence[str | Path], mapping: Mapping[str, Any] | None
) -> None:
    """Refuse a mapping by whose misnamed places joints would be locked (UsageError)."""
    absent = sorted(set(robot.joint_names).difference(*(part.link | part.motor for part in parts)))
    for log in logs if absent and mapping else ():
        for raw, plan in _parts(robot, log, mapping):
            refuse_misnamed(raw.channels, plan, robot, mapping or {}, absent)


def _nearest(robot: Robot, absent: Sequence[str], parts: Sequence[_Held]) -> str:
    """Return the names in a log nearest to joints that it does not hold, of those that are no joint's; in words."""
    free = sorted(frozenset().union(*(part.names for part in parts)).difference(robot.joint_names, robot.order))
    found = [(name, like) for name in absent if (like := nearest(name, free))]
    pairs = [like if len(absent) == 1 else f"{name} {like}" for name, like in found]
    return f" (nearest name in the log that is no joint's: {_listed(pairs)})" if pairs else ""


def _ungeared(robot: Robot) -> list[str]:
    """Return a sentence on the joints whose gear ratio is not known."""
    unknown = [joint.name for joint in robot.joints if joint.gear_ratio is None and not _turning_alone(robot, joint)]
    whose = "no gear ratio is known" if len(unknown) == robot.n else f"gear ratio not known: {_listed(unknown)}"
    ja = "a rotor is then described by its inertia at the joint (Ja), without coupling to others"
    return [f"{whose}; {ja}"] if unknown else []


def _turning_alone(robot: Robot, joint: Joint) -> bool:
    """Whether the robot's file has a rotor that turns otherwise than the joint, and couples to nothing."""
    return abs(robot.rotors.get(joint.name, ("", 1.0))[1]) != 1.0


@dataclass(frozen=True)
class _Held:
    """The joints of which one part of a log holds positions."""

    link: frozenset[str]
    motor: frozenset[str]
    twice: frozenset[str] = frozenset()
    """Of those with both: where they show no deflection (`same_position`)."""
    still: Mapping[str, float] = field(default_factory=dict)
    """Of those that do not move at all: where they stand, rad or m."""
    names: frozenset[str] = frozenset()
    """What the log calls its joints itself, without what was read."""


def _held(robot: Robot, log: str | Path, mapping: Mapping[str, Any] | None, auto: Sequence[str]) -> Iterable[_Held]:
    """Yield what each part of a log holds; numbers are looked at where an open question is asked of both sides."""
    for raw, plan in _parts(robot, log, mapping):
        names = _unused(raw, plan)
        link, motor = (_placed(plan, signal, robot) for signal in ("q", "theta"))
        if any(name in link & motor for name in auto):
            yield replace(_looked_at(raw, plan, robot, frozenset(auto)), names=names)
        elif (unnamed := _unnamed(raw, plan, robot)) or (robot.source and robot.n > 1 and link | motor):
            found, idle = _by_numbers(raw, plan, robot)
            absent = unnamed - found
            yield _Held(link - absent, motor - absent, still=idle, names=names)
        else:
            yield _Held(link, motor, names=names)


def _parts(robot: Robot, log: str | Path, mapping: Mapping[str, Any] | None) -> Iterable[tuple[RawLog, ReadPlan]]:
    """Yield the parts of a log with where each signal is; none of one that cannot be read, whose reader says why."""
    try:
        source = open_source(log)
        opened = recognise(source).open(source)
    except LogError:
        return
    for raw in (reshaped(part, mapping, robot.log) for part in opened):
        yield raw, _plan(raw, robot, mapping)


def _plan(raw: RawLog, robot: Robot, mapping: Mapping[str, Any] | None) -> ReadPlan:
    return resolve(raw.channels, layers_of(raw, robot, mapping), robot)


def _unused(raw: RawLog, plan: ReadPlan) -> frozenset[str]:
    """Return the names of joints in a part of which nothing is read."""
    picks = [pick for placement in plan.placements.values() for pick in placement.picks]
    return frozenset(
        name
        for name in named_joints(raw.channels)
        if not any(name in pick.columns or pick.source.endswith(name) for pick in picks)
    )


def _placed(plan: ReadPlan, signal: str, robot: Robot) -> frozenset[str]:
    placement = plan.placements.get(signal)
    return frozenset(robot.joint_names[j] for js in placement.joints for j in js) if placement else frozenset()


def _unnamed(raw: RawLog, plan: ReadPlan, robot: Robot) -> frozenset[str]:
    """Return the joints placed in messages that may name them, of which those seen so far name others only."""
    named = {(c.source, c.field): c.labels for c in raw.channels if c.open_ended and c.labels}
    found: set[str] = set()
    for signal in {"q", "theta"} & set(plan.placements):
        placement = plan.placements[signal]
        for pick, joints in zip(placement.picks, placement.joints, strict=True):
            labels = named.get((pick.source, pick.field), ())
            found |= {
                robot.joint_names[j] for c, j in zip(pick.columns, joints, strict=True) if labels and c not in labels
            }
    return frozenset(found)


def _looked_at(raw: RawLog, plan: ReadPlan, robot: Robot, auto: frozenset[str]) -> _Held:
    """Return what a part holds by its numbers: recorders fill what they do not know with one value."""
    torque = next((signal for signal in ("tau", "tau_link") if signal in plan.placements), None)
    chosen = {s: plan.placements[s] for s in ("q", "theta", torque) if s is not None}
    sensed: dict[str, dict[str, Sensed]] = {signal: {} for signal in ("q", "theta", "tau")}
    stands: dict[str, dict[str, float]] = {"theta": {}, "q": {}, "tau": {}}
    for signal, joint, known in _sensed(raw, plan, robot, chosen):
        side = "tau" if signal == torque else signal
        if np.ptp(known.values) > 0:
            sensed[side][joint] = known
        else:
            stands[side][joint] = float(known.values[0])
    q, theta, tau = sensed["q"], sensed["theta"], sensed["tau"]
    still = {name: at for name, at in (stands["theta"] | stands["q"]).items() if name not in q.keys() | theta.keys()}
    link, motor = (frozenset(sensed[s]) | (still.keys() & stands[s].keys()) for s in ("q", "theta"))
    apart = any(placement.spec.add for placement in chosen.values())  # a deflection sensor, which says itself
    asked = frozenset() if apart else auto & q.keys() & theta.keys()
    twice = {name for name in asked if same_position(q[name], theta[name], tau.get(name))}
    return _Held(link, motor, frozenset(twice | still.keys()), still)


def _by_numbers(raw: RawLog, plan: ReadPlan, robot: Robot) -> tuple[frozenset[str], dict[str, float]]:
    """Return the joints that a part has positions of, and where those stand that neither move nor have a torque.

    Of a log of commands that are those that do not move.
    """
    chosen = {s: plan.placements[s] for s in ("q", "theta", "tau", "tau_link") if s in plan.placements}
    # a torque that is computed of commands is none where a brake holds the joint
    commanded = "q_des" in plan.placements and not {"tau", "tau_link"} & chosen.keys()
    found: dict[str, list[Array]] = {}
    driven: set[str] = set()
    for signal, joint, known in _sensed(raw, plan, robot, chosen):
        if signal in ("q", "theta"):
            found.setdefault(joint, []).append(known.values)
        elif np.ptp(known.values) > 0:
            driven.add(joint)
    idle = found.keys() - driven if driven or commanded else set()
    still = {j: float(np.median(found[j][0])) for j in idle if max(np.ptp(values) for values in found[j]) <= IDLE}
    return frozenset(found), {name: still[name] for name in robot.joint_names if name in still}


def _sensed(
    raw: RawLog, plan: ReadPlan, robot: Robot, chosen: Mapping[str, Placement]
) -> Iterable[tuple[str, str, Sensed]]:
    """Yield signal, joint and samples of what is chosen of a part; nothing where no sample is a number."""
    streams = raw.load([pick for placement in chosen.values() for pick in placement.picks])
    seconds = in_seconds(streams, factor=plan.time.factor if plan.time is not None else None, rate=1.0, notes=[])
    for sampled in converted(replace(plan, placements=chosen), streams, seconds, robot):
        for j, values in zip(sampled.joints, sampled.values.T, strict=True):
            known = Sensed.of(sampled.t, values)
            if known.values.size:
                yield sampled.signal, robot.joint_names[j], known


def _elsewhere(robot: Robot, logs: Sequence[str | Path], mapping: Mapping[str, Any] | None) -> list[str]:
    """Return a sentence per locked joint that a log has somewhere else: its load is not in the model."""
    found: dict[str, tuple[float, float]] = {}
    known, hold = {joint.name: joint for joint in robot.joints}, robot.held
    joints = tuple(known.get(name) or Joint(name, transmission="rigid") for name in robot.order)
    whole = Robot(robot.name, joints, log=robot.log)
    try:
        parse_mapping(mapping or {}, whole, "--map")
        parse_mapping(robot.log, whole, "log")
    except UsageError:  # lists of places, of the joints that are left: those that are locked have none
        return []
    for log in logs if hold else ():
        for raw, plan in _parts(whole, log, mapping):
            side = "q" if "q" in plan.placements else "theta"
            if side not in plan.placements or not _placed(plan, side, whole) & set(hold):
                continue
            if (own := _plan(raw, robot, mapping).placements.get(side)) is not None and own.left:
                continue  # its columns are numbered without them
            for _, joint, known_values in _sensed(raw, plan, whole, {side: plan.placements[side]}):
                ends = float(known_values.values.min()), float(known_values.values.max())
                if joint in hold and max(abs(end - hold[joint]) for end in ends) > APART:
                    low, high = found.get(joint, ends)
                    found[joint] = min(low, ends[0]), max(high, ends[1])
    return [
        f"{name} is locked at {hold[name]:g}, but the log has it from {low:.4g} to {high:.4g}: what that changes "
        "in the torques of the others is not modelled"
        for name, (low, high) in found.items()
    ]


def _count(names: Sequence[str]) -> str:
    return f"{len(names)} joint{'s' * (len(names) != 1)}"


def _them(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _listed(names: Sequence[str]) -> str:
    return first_of(names, LISTED)
