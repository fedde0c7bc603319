"""What a log tells of a robot from URDF or MJCF: which joints it holds, where each signal is, what must be asked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from elid_cli.logs.adapt import joints_held, robot_as_logged
from elid_cli.logs.inspect import LogInfo, inspect_log
from elid_cli.robot.completion import Completion
from elid_cli.robot.robot import Robot


def first_look(
    robot: Robot, log: str | Path, hold: Mapping[str, float] | None = None, mapping: Mapping[str, Any] | None = None
) -> Completion:
    """Return what a log shows of a robot and what it does not.

    Parameters
    ----------
    robot
        As its own file describes it.
    log
        As for `inspect_log`.
    hold
        Joints that are held whatever the log has, rad or m.
    mapping
        What `read_map_options` returns: taken as confirmed.

    Raises
    ------
    LogError
        The log cannot be read at all.
    """
    hold = dict(hold or {})
    seen = robot_as_logged(robot, [log], mapping, hold)
    info = inspect_log(log, seen, mapping)
    unnamed = _unnamed(info, seen.joint_names) if {"q", "theta"} & set(info.missing) else ()
    if unnamed:
        seen = robot_as_logged(robot, [log], mapping, hold | dict.fromkeys(unnamed, 0.0))
        info = inspect_log(log, seen, mapping)
    left = [name for name in robot.joint_names if name not in seen.joint_names and name not in hold]
    standing = joints_held(robot, log, mapping) if left and not unnamed else frozenset()
    return Completion(
        lock=hold,
        log={signal: spec for signal, spec in info.resolved.items() if signal in (mapping or {})},
        logged=info.file,
        found=info.taken,
        guesses=tuple(line for line in info.mapping.splitlines() if line),
        missing=info.missing,
        chain=info.chain,
        absent=tuple(name for name in left if name not in standing),
        standing={name: seen.held[name] for name in left if name in standing},
    )


def _unnamed(info: LogInfo, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints that no channel names, where it names others: those of a gripper, say."""
    names = [name for channel in info.channels for name in (channel.name, *channel.labels)]
    found = [j for j in joints if any(re.search(rf"(?<![A-Za-z0-9]){re.escape(j)}(?![A-Za-z0-9])", n) for n in names)]
    return tuple(joint for joint in joints if joint not in found) if found else ()
