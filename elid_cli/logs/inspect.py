"""What is in a log: channels with counts, rates and gaps, what elid would take each signal from (`elid info`)."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.errors import LogError
from elid_cli.logs.checks.missing_signal import MEANING, MissingSignal
from elid_cli.logs.checks.units_and_signs import unit_lines
from elid_cli.logs.contract import Channel, LogFormat, Pick, RawLog
from elid_cli.logs.mapping.joints_in_names import named_joints
from elid_cli.logs.mapping.language import GAINS
from elid_cli.logs.mapping.long_table import KEY as LONG
from elid_cli.logs.mapping.long_table import reshaped
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.logs.mapping.resolve import fits, resolve
from elid_cli.logs.mapping.suggest import completed, needed, proposal, untold
from elid_cli.logs.reading import layers_of
from elid_cli.logs.repair.clocks import in_seconds
from elid_cli.logs.repair.timeline import build
from elid_cli.logs.source import open_source
from elid_cli.logs.writing import recognise
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.signals.recording import INERTIAL
from elid_cli.tables import Shown

MOST_MEASURED = 500
"""Channels whose clocks are measured, beside those of the robot's signals."""


@dataclass(frozen=True)
class ChannelInfo:
    """One column, dataset or message field."""

    name: str
    kind: str
    count: int | None
    """Samples; None where they were not counted."""
    rate: float | None
    """Hz; None where the channel has no usable time."""
    gaps: int
    span: float | None
    """s from first to last sample."""
    labels: tuple[str, ...]
    """Joint names in it."""
    signals: tuple[str, ...]
    """Signals that elid would take from it."""


@dataclass(frozen=True, repr=False)
class LogInfo(Shown):
    """What `elid info` says about one log."""

    file: str
    format: str
    sha256: str
    parts: int
    """Episodes in it."""
    joints: tuple[str, ...]
    """The robot's joints, or the names found in the log where no robot is given."""
    channels: tuple[ChannelInfo, ...]
    taken: Mapping[str, str]
    """Signal -> where elid would read it."""
    missing: tuple[str, ...]
    """Signals that elid would need and cannot place."""
    mapping: str
    """YAML to paste for the missing ones, guessed from names, and for units that the header names; empty: neither."""
    losses: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)
    resolved: Mapping[str, Any] = field(default_factory=dict)
    """The mapping that says what was taken from where."""
    chain: str = ""
    """Link whose chain has as many joints as a table without names has columns for; empty: not looked for."""
    gains_missing: tuple[str, ...] = ()
    """Gains by which its commands would make the torque that it lacks, and which neither it nor the robot holds."""


def inspect_log(path: str | Path, robot: Robot | None = None, mapping: Mapping[str, Any] | None = None) -> LogInfo:
    """Return what is in a log; with a robot, where its signals would be read from.

    Parameters
    ----------
    path
        A file or a rosbag2 folder.
    robot
        Whose joints and mapping are used; None: joints as the log names them.
    mapping
        What `read_map_options` returns, tried before the robot's own.

    Raises
    ------
    LogError
        If the file cannot be read at all.
    UsageError
        An argument of another kind.
    """
    if robot is not None:
        check_robot(robot)
    source = open_source(path)
    fmt: LogFormat = recognise(source)
    opened = fmt.open(source)
    raw = reshaped(opened[0], mapping, robot.log if robot is not None else None)
    chosen = robot if robot is not None else _guessed(raw)
    plan = _with_effort_named(resolve(raw.channels, layers_of(raw, chosen, mapping), chosen), chosen)
    plan = _without_unmeasured(raw, plan)
    taken = {signal: placement.places for signal, placement in plan.placements.items()}
    units = getattr(raw, "units", {})
    lacking = needed(plan, chosen, units)
    missing = tuple(signal for signal in lacking if signal != "t")
    # a robot that is only guessed may have both sides
    wanted = ("q", "theta", *missing[1:]) if robot is None and missing[:1] == ("q",) else missing
    wanted = ("t", *wanted) if plan.time is not None and "t" in lacking else wanted
    notes: list[str] = [*raw.notes, *plan.notes]
    infos = _measured(raw, plan, notes)
    reasons = dict(plan.reasons)
    if lacked := untold(plan):
        reasons["tau"] = lacked
    # the joints of a robot that is only guessed from the log decide nothing
    works = partial(fits, raw.channels, chosen) if robot is not None else lambda line: True
    if not any(info.rate for info in infos):  # named or not, nothing serves as time
        missing, wanted = ("t", *missing), tuple(dict.fromkeys(("t", *wanted)))
        reasons["t"] = "nothing holds times that advance"
    proposed, link = proposal(raw, chosen, raw.channels, wanted, works)
    if plan.time is None and any(line.startswith("t:") for line in proposed.splitlines()):
        reasons["t"] = "nothing is called t or time"
    # the lines of a chain are of fewer joints than the robot has
    fresh = [line for line in proposed.splitlines() if line.partition(":")[0] not in plan.placements and not link]
    if link:
        notes.append(
            f"its columns cannot be those of {chosen.n} joints, but of the joints that carry {link}: "
            f"--tip {link}, if it holds these alone"
        )
    if robot is not None:
        fault = MissingSignal(robot, plan, raw, source.name)
        notes.extend(sentence for signal in MEANING for sentence in fault.partial(signal))
    partly = completed(plan, raw.channels, chosen.joint_names, works, units)
    fresh += [line for line, _ in partly.values()]
    fresh += [line for line in unit_lines(units, plan, chosen.joint_names) if line.partition(":")[0] not in partly]
    return LogInfo(
        file=source.name,
        format=fmt.name,
        sha256=source.sha256,
        parts=len(opened),
        joints=chosen.joint_names,
        channels=infos,
        taken=taken,
        missing=missing,
        mapping="\n".join(fresh),
        losses=(*raw.losses, *plan.unfit),
        notes=tuple(dict.fromkeys(notes)),
        reasons={signal: reason for signal, reason in reasons.items() if signal in missing},
        resolved=({LONG: long.written} if (long := getattr(raw, "long", None)) is not None else {})
        | ({"t": plan.time.written} if plan.time is not None else {})
        | {
            signal: dict(placement.spec.written or {})
            for signal, placement in plan.placements.items()
            if not placement.either or (signal == "tau" and robot is not None)  # else the robot to come decides
        },
        chain=link,
        gains_missing=_gains_missing({*plan.placements, *(line.partition(":")[0] for line in fresh)}, chosen),
    )


def _gains_missing(known: Collection[str], robot: Robot) -> tuple[str, ...]:
    """Return the gains that a torque from commands lacks, of a log with these signals; none where it has a torque."""
    if "q_des" not in known or {"tau", "tau_link"} & set(known):
        return ()
    return tuple(gain for gain in GAINS if gain not in known and gain not in robot.control)


def _with_effort_named(plan: ReadPlan, robot: Robot) -> ReadPlan:
    """Return the plan with the effort of joint states as the torque that reading makes of it (`checks.required`)."""
    effort = plan.placements.get("tau_link")
    elastic = any(joint.transmission == "elastic" for joint in robot.joints)
    if effort is None or not effort.either or elastic or {"tau", "theta"} & set(plan.placements):
        return plan
    others = {signal: placement for signal, placement in plan.placements.items() if signal != "tau_link"}
    return replace(plan, placements={**others, "tau": effort})


def _without_unmeasured(raw: RawLog, plan: ReadPlan) -> ReadPlan:
    """Return the plan without sensors on links of which messages hold no number: an Imu has room for both kinds."""
    asked = {s: p for s, p in plan.placements.items() if s in INERTIAL and all(pick.field for pick in p.picks)}
    streams = iter(raw.load([pick for placement in asked.values() for pick in placement.picks]) if asked else ())
    placements = dict(plan.placements)
    for signal, placement in asked.items():
        held = [bool(np.isfinite(next(streams).values).any()) for _ in placement.picks]
        if any(held):
            picks, joints = tuple(compress(placement.picks, held)), tuple(compress(placement.joints, held))
            placements[signal] = replace(placement, picks=picks, joints=joints)
        else:
            del placements[signal]
    return replace(plan, placements=placements)


def guessed_robot(path: str | Path) -> Robot:
    """Return the joints that a log names itself, as a robot of which nothing else is known (LogError as above)."""
    source = open_source(path)
    return _guessed(recognise(source).open(source)[0])


def _guessed(raw: RawLog) -> Robot:
    """Return a robot of the joints that a log names, elastic where it has both sides."""
    joints = tuple(Joint(name, transmission="rigid") for name in _joint_names(raw))
    both = {"q", "theta"} <= set(
        resolve(raw.channels, layers_of(raw, Robot("log", joints), None), Robot("log", joints)).placements
    )
    return Robot("log", tuple(replace(j, transmission="elastic") for j in joints) if both else joints)


def _measured(raw: RawLog, plan: ReadPlan, notes: list[str]) -> tuple[ChannelInfo, ...]:
    """Load one column of every source and measure its clock."""
    signals: dict[str, list[str]] = {}
    for signal, placement in plan.placements.items():
        for pick in placement.picks:
            signals.setdefault(Channel(pick.source, pick.field).address, []).append(signal)
    own_time = {pick.source: pick.time for p in plan.placements.values() for pick in p.picks}
    time = plan.time.source if plan.time is not None else ""
    readable = [c for c in raw.channels if c.width and not c.field.endswith("sec")]
    few = [c for k, c in enumerate(readable) if k < MOST_MEASURED or c.source in own_time]
    fields = {c.source: c.field for c in reversed(few)}
    picks = [Pick(source, name, (0,), own_time.get(source, "" if name else time)) for source, name in fields.items()]
    factor = plan.time.factor if plan.time is not None else None
    clocks = _clocks(raw, picks, factor, notes)
    infos = []
    for channel in raw.channels:
        if re.search(r"(^|\.)(nano|n)?secs?$", channel.field):
            continue
        count, rate, gaps, span = clocks.get(channel.source, (channel.rows, None, 0, None))
        used = tuple(dict.fromkeys(signals.get(channel.address, ())))
        infos.append(ChannelInfo(channel.address, channel.kind, count, rate, gaps, span, channel.labels, used))
    return tuple(infos)


def _clocks(
    raw: RawLog, picks: Sequence[Pick], factor: float | None, notes: list[str]
) -> dict[str, tuple[int | None, float | None, int, float | None]]:
    """Return (samples, rate in Hz, gaps, span in s) of every source."""
    try:
        streams = raw.load(picks)
    except LogError:  # datasets of other lengths than the time: each on its own
        streams = []
        for pick in list(picks):
            try:
                streams += raw.load([pick])
            except LogError:
                streams += raw.load([Pick(pick.source, pick.field, pick.columns)])
    found: dict[str, tuple[int | None, float | None, int, float | None]] = {}
    for pick, stream in zip(picks, streams, strict=True):
        count = stream.values.shape[0]
        try:
            (t,) = in_seconds([stream], factor=factor, notes=notes)
            line = build(t, stream.values, pick.source)
        except LogError:
            line = None
        if line is None:
            found[pick.source] = (count, None, 0, None)
            continue
        gaps = len(line.segments) - 1
        found[pick.source] = (count, float(1 / line.dt), gaps, float(line.t[-1] - line.t[0]))
    return found


def _joint_names(raw: RawLog) -> tuple[str, ...]:
    """Return the joints that a log names itself, for `elid info` without a robot."""
    if joints := named_joints(raw.channels):
        return joints
    wide = [channel.width for channel in raw.channels if channel.source in ("/q", "/theta", "/tau")]
    numbers = {int(m.group(1)) for c in raw.channels if (m := re.match(r"[A-Za-z_]+(\d+)", c.source))}
    count = wide[0] if wide else max((number for number in numbers if number < 100), default=1)
    return tuple(f"joint{i + 1}" for i in range(count))
