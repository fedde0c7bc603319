"""From log files to one `Recording`: recognise, resolve, load, convert, align, check, join."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_list, number, optional
from elid_cli.errors import LogError, check_word
from elid_cli.logs.checks.required import Checked, check, refuse_mixed
from elid_cli.logs.checks.units_and_signs import suspicions, told_torques, written_units
from elid_cli.logs.contract import RawLog, Stream
from elid_cli.logs.mapping.language import COMMANDS, parse_mapping
from elid_cli.logs.mapping.left_out import Spans, left_out_of
from elid_cli.logs.mapping.long_table import reshaped
from elid_cli.logs.mapping.plan import Layer, Placement, ReadPlan
from elid_cli.logs.mapping.profiles import known_messages
from elid_cli.logs.mapping.resolve import resolve
from elid_cli.logs.mapping.suggest import proposal
from elid_cli.logs.repair.align import Aligned, align, resampled
from elid_cli.logs.repair.clocks import another_clock, in_seconds
from elid_cli.logs.repair.damage import Damage, refuse
from elid_cli.logs.repair.reachable import Sampled
from elid_cli.logs.repair.sample_times import at_even_times
from elid_cli.logs.source import Source, open_source
from elid_cli.logs.writing import recognise
from elid_cli.memory import Recent, let_go, side_by_side
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.signals.recording import ACCEL, GYRO, INERTIAL, MEASURED, Recording, Segment, repeated, unique_notices

SAME_RATE = 1e-6
"""Relative difference of sample times that counts as none when logs are joined."""
BETWEEN_LOGS = 1.0
"""s between logs in the joined time."""
SLOWEST, FASTEST = 5.0, 1e6
"""Hz; rates outside are a time in another unit."""
OPTIONAL = ("dq", "dtheta", "tau_link", "temperature", *INERTIAL, *COMMANDS)


@dataclass(frozen=True)
class Options:
    """How to read, the same for every log of a call."""

    robot: Robot
    mapping: Mapping[str, Any] | None
    strict: bool
    rate: float | None
    time_source: str = "auto"
    spans: Spans = ()
    """What is left out, s."""


@dataclass
class _Part:
    """One contiguous source of samples (a file, or an episode of one), checked."""

    aligned: Aligned
    checked: Checked
    plan: ReadPlan
    source: int
    repairs: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_recording(
    paths: Sequence[str | Path],
    robot: Robot,
    mapping: Mapping[str, Any] | None = None,
    *,
    strict: bool = False,
    rate: float | None = None,
    time_source: str = "auto",
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Read one or more logs of a robot into one recording.

    Parameters
    ----------
    paths
        Files or rosbag2 folders, in order; ``-`` is CSV on standard input. Formats are told by content.
    robot
        Whose joints and default mapping (`robot.log`) are used.
    mapping
        The mapping of ``--map`` as written in YAML (`read_map_options`); tried before the robot's own.
    strict
        Refuse logs that are cut or damaged, do not fit `mapping`, lack a signal of some joint, or have samples that are
        missing, wrong, repeated or out of order.
    rate
        Sample rate, Hz, of a log that has no time.
    time_source
        ``auto``, ``header`` (header stamps) or ``log`` (log times).
    progress
        Told the share of all logs that has been read (0 to 1).

    Raises
    ------
    LogError
        If a log cannot be used.
    UsageError
        If the mapping is wrong, or an argument is of another kind.
    """
    check_robot(robot)
    check_word("read_recording: time_source", time_source, ("auto", "header", "log"))
    if isinstance(paths, str | Path):
        paths = [paths]
    check_list("read_recording: paths", paths, "logs")
    optional(number(above=0))("read_recording: rate", rate)
    sources = (
        open_source(path, None if progress is None else _part_of(progress, index, len(paths)))
        for index, path in enumerate(paths)
    )
    spans = left_out_of(mapping, len(paths))
    return read_sources(sources, Options(robot, mapping, strict, rate, time_source, spans))


def read_sources(opening: Iterable[Source], options: Options) -> Recording:
    """Return the logs of some sources as one recording; see `read_recording`."""
    robot, mapping = options.robot, options.mapping
    parts: list[_Part] = []
    sources = []
    for index, source in enumerate(opening):
        sources.append(source)
        opened = recognise(source).open(source)
        left_out_of(mapping, len(opened), "episodes of a file")
        for raw in opened:
            parts.append(_read(raw, _part_name(source, raw), index, options))
    if not parts:
        raise LogError("no log given", hint="elid identify LOG --robot ROBOT")
    return _joined(parts, sources, robot)


def _part_of(progress: Callable[[float], None], index: int, count: int) -> Callable[[float], None]:
    return lambda share: progress((index + share) / count)


def _believable(dt: float, name: str, plan: ReadPlan) -> None:
    """Refuse a sample time that no recorder of a robot has: time in another unit (LogError)."""
    if 1 / FASTEST <= dt < 1 / SLOWEST:
        return
    slow = dt >= 1 / SLOWEST
    place = plan.time.source or plan.time.field if plan.time is not None else "t"
    given = plan.time.factor if plan.time is not None and plan.time.factor else 1.0
    unit = next((u for u, f in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if dt / given * f < 1 / SLOWEST), "")
    raise LogError(
        f"{name}: time advances by {dt:.4g} s per sample, too {'slow' if slow else 'fast'} for a robot's motion",
        detail=f"between {SLOWEST:g} Hz and {FASTEST / 1e6:g} MHz can be used" + ("; is it in s?" if slow else ""),
        hint=f"if it is in {unit}, put this in a mapping: t: {{from: {place}, unit: {unit}}}"
        if slow and unit
        else "name another clock: --map t=PLACE",
    )


def _part_name(source: Source, raw: RawLog) -> str:
    own = str(getattr(raw, "name", "") or source.name)
    return "standard input" if own == "-" else own


def _read(raw: RawLog, name: str, index: int, options: Options) -> _Part:
    robot = options.robot
    raw = reshaped(raw, options.mapping, robot.log)
    plan = _plan_of(raw, robot, options.mapping)
    if not {"q", "theta"} & set(plan.placements):
        try:
            check({}, robot, plan, raw, name, strict=options.strict)
        except LogError as error:
            raise _with_rate(error, raw, plan, options.rate) from error
    streams = raw.load([pick for placement in plan.placements.values() for pick in placement.picks])
    if options.strict:
        refuse(name, [*raw.losses, *plan.unfit])
    notes = [*raw.notes, *plan.notes, *told_torques(plan)]
    factor, mended = plan.time.factor if plan.time is not None else None, list[str]()
    try:
        seconds = in_seconds(
            streams, source=options.time_source, factor=factor, rate=options.rate, name=name, notes=notes,
            repairs=mended,
        )  # fmt: skip
    except LogError as error:
        line = proposal(raw, robot, raw.channels, ("t",), lambda _: True)[0]
        if plan.time is None and line:
            error.detail = next((said for said in plan.unfit if ": t: " in said), error.detail)
            error.hint = f"--map {shlex.quote(line)}, or give the sample rate: --rate 1000"
        raise
    other = another_clock(streams, options.time_source)
    streams = [
        replace(stream, clocks={}) for stream in streams
    ]  # their stamps take as much memory as a joint's signals
    aligned = align(converted(plan, streams, seconds, robot), robot.joint_names, name, other, options.spans)
    aligned = at_even_times(aligned)
    if options.strict:
        refuse(name, [said for said in [*mended, *aligned.repairs] if isinstance(said, Damage)])
    _believable(aligned.dt, name, plan)
    signals = dict(aligned.signals)
    for signal, placement in plan.placements.items():
        _add(signals, signal, placement)
    checked = check(signals, robot, plan, raw, name, segments=aligned.segments, dt=aligned.dt, strict=options.strict)
    notes += checked.notes
    checked.warnings.extend(written_units(getattr(raw, "units", {}), plan, robot.joint_names))
    checked.warnings.extend(suspicions(checked, aligned, robot, plan))
    let_go(*signals.values())
    return _Part(aligned, checked, plan, index, [*raw.losses, *plan.unfit, *mended, *aligned.repairs], notes)


def _with_rate(error: LogError, raw: RawLog, plan: ReadPlan, rate: float | None) -> LogError:
    """Return an error whose mapping to paste asks for the sample rate too, where the log cannot have a time."""
    mapped = "--map" in error.hint and "=PLACE" not in error.hint and "--map 't:" not in error.hint
    if mapped and plan.time is None and rate is None and getattr(raw, "timeless", False):
        error.hint += " --rate 1000"
        error.detail += "; it holds no time: put its own sample rate, Hz, in place of the hint's 1000"
    return error


_PLANS: Recent[tuple[Robot, ReadPlan]] = Recent(8)
"""Where signals were found, with the robot, so that its identity stands for it."""


def _plan_of(raw: RawLog, robot: Robot, mapping: Mapping[str, Any] | None) -> ReadPlan:
    """Return where every signal is; logs of one recorder have the same channels, for which it is decided once."""
    key = (id(robot), repr(mapping), repr(raw.canonical), tuple(raw.channels))
    return _PLANS.of(key, lambda: (robot, resolve(raw.channels, layers_of(raw, robot, mapping), robot)))[1]


def layers_of(raw: RawLog, robot: Robot, mapping: Mapping[str, Any] | None) -> list[Layer]:
    """Return the mappings to try in turn: the user's, the robot's, the format's canonical names, known messages."""
    layers = []
    for where, given in (("--map", mapping), (f"the log block of {robot.name}", robot.log)):
        if given:
            layers.append(Layer(where, *parse_mapping(given, robot, where), asked=given is mapping))
    for given in raw.canonical:
        layers.append(Layer("canonical names", *parse_mapping(given, robot, "canonical"), canonical=True))
    for where, given in known_messages(raw.channels, robot):
        layers.append(Layer(where, *parse_mapping(given, robot, where), canonical=True, profile=True))
    return layers


def converted(plan: ReadPlan, streams: Sequence[Stream], seconds: Sequence[Array], robot: Robot) -> list[Sampled]:
    """Return the streams in SI units at the joint; columns sampled together of one signal become one stream."""
    sampled: list[Sampled] = []
    remaining = iter(zip(streams, seconds, strict=True))
    for signal, placement in plan.placements.items():
        gain, offset = placement.spec.gain(robot), placement.spec.offsets(robot)
        pieces: list[tuple[tuple[int, ...], Array, Array]] = []
        for joints in placement.joints:
            stream, t = next(remaining)
            chosen = list(joints)
            values = _unwrapped(stream.values, placement.spec.turn) if placement.spec.unwrap else stream.values
            if (gain[chosen] != 1).any() or offset[chosen].any():
                values = values * gain[chosen] + offset[chosen]
            pieces.append((joints, values, t))
        for clock in dict.fromkeys(id(t) for _, _, t in pieces):
            together = [piece for piece in pieces if id(piece[2]) == clock]
            joints = tuple(j for piece in together for j in piece[0])
            values = together[0][1] if len(together) == 1 else side_by_side([p[1] for p in together])
            sampled.append(Sampled(signal, joints, values, together[0][2]))
    return sampled


def _unwrapped(values: Array, turn: float) -> Array:
    """Return angles without their jumps by a turn; NaN stay where they are."""
    result = values.copy()
    for column in result.T:
        known = np.isfinite(column)
        column[known] = np.unwrap(column[known], period=turn)
    return result


def _add(signals: dict[str, Array], signal: str, placement: Placement) -> None:
    """Add the other signal of a mapping's `add` (a deflection sensor: q = theta + deflection)."""
    other = placement.spec.add
    if other and signal in signals:
        if other not in signals:
            raise LogError(f"{signal} is mapped with add: {other}, which the log does not hold")
        signals[signal] = signals[signal] + signals[other]


def _joined(parts: Sequence[_Part], sources: Sequence[Source], robot: Robot) -> Recording:
    dt = parts[0].aligned.dt
    several = len(parts) > 1
    if several:
        lacking = np.array([robot.elastic & np.isnan(part.checked.q).all(axis=0) for part in parts])
        refuse_mixed([sources[part.source].name for part in parts], lacking, robot.joint_names)
    blocks: dict[str, list[Array]] = {}
    times: list[Array] = []
    segments: list[Segment] = []
    said: dict[str, list[tuple[str, Sequence[str]]]] = {"repairs": [], "notes": [], "warnings": []}
    bridged: list[tuple[str, int, Array]] = []
    begin, samples = 0.0, 0
    optional = [s for s in OPTIONAL if any(s in part.checked.optional for part in parts)]
    for part in parts:
        name = sources[part.source].name if several else ""
        said["repairs"].append((name, part.repairs))
        said["notes"].append((name, part.notes))
        said["warnings"].append((name, part.checked.warnings))
        aligned = part.aligned
        signals = {s: getattr(part.checked, s) for s in ("q", "theta", "tau")}
        empty = np.full_like(part.checked.q, np.nan) if optional else part.checked.q
        signals |= {s: part.checked.optional.get(s, empty) for s in optional}
        t, bounds = aligned.t, list(aligned.segments)
        if abs(aligned.dt - dt) > SAME_RATE * dt:
            words = f"{1 / aligned.dt:.6g} Hz resampled to {1 / dt:.6g} Hz, the rate of the first log"
            said["repairs"].append((name, [words]))
            t, signals, bounds = resampled(aligned, signals, dt)
        times.append(t + begin)
        bridged += [(signal, joint, when + begin) for signal, joint, when in aligned.bridged]
        for signal, values in signals.items():
            blocks.setdefault(signal, []).append(values)
        segments.extend(Segment(samples + a, samples + b, part.source) for a, b in bounds)
        begin += float(t[-1]) + BETWEEN_LOGS
        samples += t.size
    whole = {s: values[0] if len(values) == 1 else np.concatenate(values) for s, values in blocks.items()}
    places = {signal: p.places for signal, p in parts[0].plan.placements.items() if p.spec.value is None}
    for signal in set(INERTIAL) - set(whole):  # an Imu has room for what its sensor does not measure
        places.pop(signal, None)
    if parts[0].checked.computed:
        places["tau"] = parts[0].checked.computed
    elif efforts := parts[0].checked.efforts:
        places["tau"] = efforts
        if "tau_link" not in optional:
            places.pop("tau_link")
    files, sha256 = tuple(source.name for source in sources), tuple(source.sha256 for source in sources)
    return Recording(
        joints=robot.joint_names,
        dt=dt,
        t=times[0] if len(times) == 1 else np.concatenate(times),
        **{signal: whole.get(signal) for signal in MEASURED},  # type: ignore[arg-type]
        gyro={signal: whole[signal] for signal in GYRO if signal in whole},
        accel={signal: whole[signal] for signal in ACCEL if signal in whole},
        commands={signal: whole[signal] for signal in COMMANDS if signal in whole},
        segments=tuple(segments),
        files=files,
        sha256=sha256,
        repairs=tuple(unique_notices(said["repairs"])),
        notes=tuple(unique_notices(said["notes"])),
        warnings=(*unique_notices(said["warnings"]), *repeated(files, sha256)),
        sources=places,
        bridged=tuple(bridged),
        parts=len(parts),
    )
