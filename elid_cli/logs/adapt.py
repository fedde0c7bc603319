"""The robot as its logs show it: joints that they do not hold are locked, ``transmission: auto`` is decided."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.errors import LogError
from elid_cli.logs.contract import RawLog
from elid_cli.logs.mapping.resolve import ReadPlan, resolve
from elid_cli.logs.reading import layers_of
from elid_cli.logs.source import open_source
from elid_cli.logs.writing import recognise
from elid_cli.robot.locking import locked
from elid_cli.robot.robot import Robot

LISTED = 8
"""Joints that a note names."""


def robot_as_logged(
    robot: Robot,
    logs: Sequence[str | Path],
    mapping: Mapping[str, Any] | None = None,
    hold: Mapping[str, float] | None = None,
) -> Robot:
    """Return the robot with its open questions answered by logs (none: by the description alone).

    Joints of a robot from URDF or MJCF that no log holds are locked at 0, or where `hold` says. A transmission ``auto``
    is elastic where every log holds both positions of its joint, or where K is known and a log holds the motor's
    position; else it is rigid. What was decided is in `Robot.notes`.

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
    auto = [joint.name for joint in robot.joints if joint.transmission == "auto"]
    if not (hold or auto or robot.source):
        return robot
    sides = [found for log in logs for found in _sides(robot, log, mapping, auto)]
    notes = list(robot.notes)
    absent = [name for name in robot.joint_names if not any(name in link | motor for link, motor in sides)]
    if sides and robot.source and len(absent) < robot.n:
        unheld = [name for name in absent if name not in hold]
        hold |= dict.fromkeys(unheld, 0.0)
        if unheld:
            notes.append(f"{_count(unheld)} locked at 0, as the log does not hold {_them(unheld)}: {_listed(unheld)}")
    robot = locked(robot, hold)
    joints = list(robot.joints)
    decided: dict[str, list[str]] = {}
    for k, joint in enumerate(joints):
        if joint.transmission == "auto":
            known = "K" in joint.parameters
            both = bool(sides) and all(joint.name in link & motor for link, motor in sides)
            spring = known and (not sides or all(joint.name in motor for _, motor in sides))
            joints[k] = replace(joint, transmission="elastic" if both or spring else "rigid")
            reason = "the log holds both positions" if both else "the description gives K"
            decided.setdefault(f"elastic: {reason}" if both or spring else "rigid", []).append(joint.name)
    if sides:
        notes += [f"{_listed(names)} taken as {what}" for what, names in decided.items()]
    return replace(robot, joints=tuple(joints), notes=tuple(notes))


def _sides(
    robot: Robot, log: str | Path, mapping: Mapping[str, Any] | None, auto: Sequence[str]
) -> Iterable[tuple[frozenset[str], frozenset[str]]]:
    """Yield the joints of which each part of a log holds (link, motor) positions."""
    try:
        source = open_source(log)
        opened = recognise(source).open(source)
    except LogError:  # whoever reads it says why
        return
    for raw in opened:
        plan = resolve(raw.channels, layers_of(raw, robot, mapping), robot)
        link, motor = (_placed(plan, signal, robot) for signal in ("q", "theta"))
        if any(name in link & motor for name in auto):  # recorders fill what they do not know
            link, motor = (names & _filled(raw, plan, s, robot) for s, names in (("q", link), ("theta", motor)))
        yield link, motor


def _placed(plan: ReadPlan, signal: str, robot: Robot) -> frozenset[str]:
    placement = plan.placements.get(signal)
    return frozenset(robot.joint_names[j] for js in placement.joints for j in js) if placement else frozenset()


def _filled(raw: RawLog, plan: ReadPlan, signal: str, robot: Robot) -> frozenset[str]:
    """Return the joints whose channel of a signal holds numbers that are not all the same."""
    placement = plan.placements[signal]
    found: set[str] = set()
    for joints, stream in zip(placement.joints, raw.load(placement.picks), strict=True):
        for j, values in zip(joints, stream.values.T, strict=True):
            known = values[np.isfinite(values)]
            if known.size and (known != known[0]).any():
                found.add(robot.joint_names[j])
    return frozenset(found)


def _count(names: Sequence[str]) -> str:
    return f"{len(names)} joint{'s' * (len(names) != 1)}"


def _them(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
