"""Decide which channel each signal is taken from: the user's mapping, the robot's, canonical names, known messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from elid_cli.errors import UsageError, first_of, nearest
from elid_cli.logs.contract import Channel, Pick
from elid_cli.logs.mapping.find import ABSENT, LISTED, as_held, find
from elid_cli.logs.mapping.language import SIGNALS, SignalMap, TimeMap, parse_mapping
from elid_cli.logs.mapping.plan import Layer, Placement, ReadPlan
from elid_cli.robot.robot import Robot

PATTERNS = ("{joint}", "{i}", "{i0}")
"""What stands for a joint's name, its number from 1 and its number from 0."""
COMPUTED = "command"
"""What ``--map tau=command`` names: the torque is to be computed although the log holds one."""
RATE = "rate"
"""What ``--map dq_des=rate`` names: the drives are told the rate of their positions."""


def resolve(channels: Sequence[Channel], layers: Sequence[Layer], robot: Robot) -> ReadPlan:
    """Place every signal with the first layer that fits it."""
    by_source = _by_source(channels)
    time, unfit, notes = _place_time(by_source, layers)
    placing = _Placing(by_source)
    for signal in SIGNALS:
        for layer in layers:
            spec = layer.signals.get(signal)
            if spec is None:
                continue
            found = place(spec, by_source, robot, time, near=signal not in placing.reasons)
            if not isinstance(found, Placement):
                placing.fail(signal, layer, found)
            elif placing.take(signal, layer, found):
                break
    placements = placing.placements
    unfit += _unfit(placing.failed, placements)
    notes += placing.chosen()
    placing.settle_sensor()
    for signal, placement in placements.items():
        if placement.unnamed:
            order = "the order of the joints that are not held" if placement.left else "the robot's joint order"
            notes.append(f"{signal}: values of {placement.places} have no names: taken in {order}")
    reasons = {signal: reason for signal, reason in placing.reasons.items() if signal not in placements}
    return ReadPlan(
        placements, time, tuple(unfit), tuple(notes), reasons, frozenset(placing.unusable - set(placements)),
        frozenset(signal for layer in layers if layer.asked for signal in layer.signals),
    )  # fmt: skip


@dataclass
class _Placing:
    """Where signals were placed so far, and why others were not."""

    by_source: Mapping[str, Sequence[Channel]]
    placements: dict[str, Placement] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    unusable: set[str] = field(default_factory=set)
    either: bool = False
    """Whether the torque may be the motor's or a sensor's."""
    used: dict[str, str] = field(default_factory=dict)
    """Signal -> what is known of the message that holds it; empty: nothing was needed."""
    failed: dict[str, tuple[str, str]] = field(default_factory=dict)
    passed: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    """(Where signals would have been read from too, why they are not) -> the signals."""

    def take(self, signal: str, layer: Layer, found: Placement) -> bool:
        """Keep a placement if it is worth more than the last; return whether no other is looked for."""
        best = self.placements.get(signal)
        if best is not None:
            new, old = _worth(found, self.by_source), _worth(best, self.by_source)
            if not _same_place(best, found):
                self._pass_over(signal, found if new <= old else best, new, old)
            if new <= old:
                return False
        self.placements[signal] = replace(found, told=not (layer.canonical or layer.profile))
        if signal == "tau_link":
            self.either = layer.canonical and "joint_states" in found.places
        self.used[signal] = layer.where if layer.profile else ""
        return not layer.canonical

    def chosen(self) -> Iterator[str]:
        """Yield a note for every message that is known, and for every one that another one is taken in place of."""
        for where in dict.fromkeys(filter(None, self.used.values())):
            known = [self._as_known(signal) for signal, by in self.used.items() if by == where]
            yield f"{' '.join(known)} are taken as known of {where}"
        for (topic, why), signals in self.passed.items():
            yield f"{' '.join(signals)} could be read from {topic} as well, which has {why}"

    def _as_known(self, signal: str) -> str:
        """Return what a message is known to hold: of an effort it is the robot that tells whose torque it is."""
        return "effort" if signal == "tau_link" and self.either else signal

    def _pass_over(self, signal: str, lesser: Placement, *worths: tuple[int, int]) -> None:
        """Keep which message is not used for a signal, of two with these worths, and why."""
        (joints, rows), (others, other_rows) = worths
        why = "fewer joints" if joints != others else "fewer samples" if rows != other_rows else "no more samples"
        if topics := dict.fromkeys(pick.source for pick in lesser.picks if pick.field):
            self.passed.setdefault((", ".join(topics), why), []).append(signal)

    def fail(self, signal: str, layer: Layer, why: str) -> None:
        """Keep why a layer does not place a signal that none has placed yet."""
        if signal in self.placements:
            return
        if layer.profile:
            self.reasons[signal] = f"{layer.where}: {why}"
        self.reasons.setdefault(signal, why if layer.canonical else f"{layer.where}: {why}")
        if layer.asked or not why.startswith(ABSENT):
            self.unusable.add(signal)
        if not layer.canonical and signal not in self.failed:
            self.failed[signal] = (layer.where, why)

    def settle_sensor(self) -> None:
        """Tell a torque that may be a sensor's from the motor's: what is mapped as the motor's is no sensor's."""
        if not self.either:
            return
        if "tau" in self.placements and _same_place(self.placements["tau"], self.placements["tau_link"]):
            del self.placements["tau_link"]
        else:
            self.placements["tau_link"] = replace(self.placements["tau_link"], either=True)


def _worth(placement: Placement, by_source: Mapping[str, Sequence[Channel]]) -> tuple[int, int]:
    """Return how many joints a placement has and how many samples, as far as known: of two the larger is taken."""
    count, rows = 0, [0]
    for pick in placement.picks:
        channel = next(c for c in by_source[pick.source] if c.field == pick.field)
        # messages to come may name more joints than those that were looked at
        count += sum(isinstance(c, int) or not channel.labels or c in channel.labels for c in pick.columns)
        rows.append(channel.rows or 0)
    return count, max(rows)


def _same_place(one: Placement, other: Placement) -> bool:
    return {(p.source, p.field) for p in one.picks} == {(p.source, p.field) for p in other.picks}


def fits(channels: Sequence[Channel], robot: Robot, line: str) -> bool:
    """Return whether a mapping of one signal, a line of YAML, finds a place in a log."""
    from elid_cli.robot.yaml import parse_yaml

    try:
        signals, time = parse_mapping(parse_yaml(line, "mapping", UsageError).plain(), robot, "mapping")
    except UsageError:  # a name that YAML reads as something else
        return False
    by_source = _by_source(channels)
    return time is not None or all(
        isinstance(place(spec, by_source, robot, None, near=False), Placement) for spec in signals.values()
    )


def _by_source(channels: Sequence[Channel]) -> dict[str, list[Channel]]:
    found: dict[str, list[Channel]] = {}
    for channel in channels:
        found.setdefault(channel.source, []).append(channel)
    return found


def place(
    spec: SignalMap,
    by_source: Mapping[str, Sequence[Channel]],
    robot: Robot,
    time: TimeMap | None,
    *,
    near: bool = True,
) -> Placement | str:
    """Return where a signal is, or why its mapping does not fit the log; `near`: with the nearest name, which costs."""
    if spec.value is not None:
        return Placement(spec, (), (), "given")
    if (spec.signal, spec.source) in (("tau", COMPUTED), ("dq_des", RATE)) and spec.source not in by_source:
        return Placement(spec, (), (), str(spec.source))
    if isinstance(spec.source, tuple) or any(mark in spec.source + spec.field for mark in PATTERNS):
        return _place_each(spec, by_source, robot, time, near=near)
    channel = find(spec, spec.source, by_source, near=near)
    if isinstance(channel, str):
        return channel
    chosen = _columns(spec, channel, robot)
    if isinstance(chosen, str):
        return chosen
    columns, joints = chosen
    pick = Pick(channel.source, channel.field, columns, _stamps(spec, channel, by_source, time))
    unnamed = not channel.labels and robot.n > 1 and spec.joints is None
    left = unnamed and bool(robot.held) and channel.width == robot.n
    return Placement(spec, (pick,), (joints,), channel.address, unnamed=unnamed, left=left)


def _place_each(
    spec: SignalMap, by_source: Mapping[str, Sequence[Channel]], robot: Robot, time: TimeMap | None, *, near: bool
) -> Placement | str:
    picks: list[Pick] = []
    joints: list[tuple[int, ...]] = []
    reason = ""
    numbers, left = _numbers(spec, by_source, robot)
    for j, (joint, source) in enumerate(zip(robot.joint_names, sources_of(spec, robot, numbers), strict=True)):
        if source is None:
            continue
        own = replace(spec, field=_filled(spec, spec.field, numbers[j], joint)) if spec.field else spec
        channel = find(own, source, by_source, near=near and not reason)
        if isinstance(channel, str):
            reason = reason or channel
            continue
        column: int | str = 0
        if channel.labels:
            column = log_name(spec, joint)
            if column not in channel.labels and channel.width == 1:
                column = channel.labels[0]
        elif channel.width != 1:
            reason = reason or f"{channel.address} holds {channel.width} values per sample, not one"
            continue
        stamps = _stamps(spec, channel, by_source, time)
        picks.append(Pick(channel.source, channel.field, (column,), stamps, spec.signal))
        joints.append((j,))
    if not picks:
        return reason or "no column is named"
    pattern = spec.source if isinstance(spec.source, str) else ", ".join(place for place in spec.source if place)
    pattern += f".{spec.field}" if spec.field else ""
    unnamed = ("{i0}" in pattern and robot.n > 1 and spec.joints is None) or left
    return Placement(spec, tuple(picks), tuple(joints), pattern, unnamed=unnamed, left=left)


def _numbers(spec: SignalMap, by_source: Mapping[str, Sequence[Channel]], robot: Robot) -> tuple[tuple[int, ...], bool]:
    """Return the numbers of the joints, from 1, and whether they had to be counted without those that are held.

    They are those of the whole robot, unless the log has more columns by the numbers of the joints that are left.
    """
    left, whole = tuple(range(1, robot.n + 1)), robot.numbers
    written = spec.source + spec.field if isinstance(spec.source, str) else ""
    if left == whole or spec.joints is not None or not any(mark in written for mark in ("{i}", "{i0}")):
        return whole, False

    def held(numbers: Sequence[int]) -> int:
        names = zip(robot.joint_names, sources_of(spec, robot, numbers), numbers, strict=True)
        places = ((source, replace(spec, field=_filled(spec, spec.field, k, name))) for name, source, k in names)
        return sum(isinstance(find(own, source or "", by_source, near=False), Channel) for source, own in places)

    return (whole, False) if held(whole) >= held(left) else (left, True)


def _stamps(spec: SignalMap, channel: Channel, by_source: Mapping[str, Sequence[Channel]], time: TimeMap | None) -> str:
    """Return the column, dataset or message field with a channel's stamps; empty: the log's own."""
    if not channel.field:
        return as_held(spec.time, by_source) or (time.source if time else "")
    wanted = spec.time or (time.field or time.source if time else "")
    return wanted if any(other.field == wanted for other in by_source[channel.source]) else ""


def sources_of(spec: SignalMap, robot: Robot, numbers: Sequence[int]) -> list[str | None]:
    """Return the column, dataset or topic of every joint, by its number, that a pattern or list stands for."""
    if isinstance(spec.source, tuple):
        return list(spec.source)
    return [_filled(spec, spec.source, k, joint) for k, joint in zip(numbers, robot.joint_names, strict=True)]


def _filled(spec: SignalMap, pattern: str, number: int, joint: str) -> str:
    """Return a pattern with the name and number of one joint."""
    name = log_name(spec, joint)
    number = name if isinstance(name, int) else number
    return pattern.replace("{joint}", str(name)).replace("{i}", str(number)).replace("{i0}", str(number - 1))


def log_name(spec: SignalMap, joint: str) -> str | int:
    """Return what a mapping says that the log calls a joint, or its column's number."""
    return spec.joints.get(joint, joint) if spec.joints else joint


def _columns(spec: SignalMap, channel: Channel, robot: Robot) -> tuple[tuple[int | str, ...], tuple[int, ...]] | str:
    names = [log_name(spec, joint) for joint in robot.joint_names]
    if spec.joints is not None:
        names = [name if joint in spec.joints else None for joint, name in zip(robot.joint_names, names, strict=True)]  # type: ignore[misc]
    if all(isinstance(name, int) for name in names if name is not None) and any(name is not None for name in names):
        pairs = [(name, j) for j, name in enumerate(names) if name is not None]
    elif channel.labels:
        pairs = [(name, j) for j, name in enumerate(names) if name in channel.labels]
        if not pairs:
            return f"{channel.address} holds {_listed(channel.labels)}, none of them {_listed(names)}"
        if channel.open_ended:
            pairs = [(name, j) for j, name in enumerate(names) if name is not None]
    elif channel.width == robot.n and spec.joints != {}:
        pairs = [(j, j) for j in range(robot.n)]
    elif channel.width == len(robot.order) and spec.joints != {}:  # the joints that are held have columns too
        pairs = [(number - 1, j) for j, number in enumerate(robot.numbers)]
    else:
        which = ", ".join(f"{name}: {k}" for k, name in enumerate(robot.joint_names[: channel.width][:LISTED]))
        said = f"{channel.address} holds {channel.width} unnamed values per sample for {robot.n} joints"
        return f"{said}; say which is whose in a mapping, by joints: {{{which}}}"
    beyond = [name for name, _ in pairs if isinstance(name, int) and not 0 <= name < channel.width]
    if beyond:
        return f"{channel.address} holds {channel.width} values per sample, counted from 0: no {beyond[0]}"
    return tuple(name for name, _ in pairs), tuple(j for _, j in pairs)


def _listed(names: Sequence[object]) -> str:
    return first_of([str(name) for name in names if name is not None], LISTED, " ")


def _place_time(
    by_source: Mapping[str, Sequence[Channel]], layers: Sequence[Layer]
) -> tuple[TimeMap | None, list[str], list[str]]:
    unfit: list[str] = []
    for layer in layers:
        if layer.time is None:
            continue
        wanted = layer.time.field or layer.time.source
        in_messages = any(channel.field == wanted for found in by_source.values() for channel in found)
        source = as_held(layer.time.source, by_source)
        if source in by_source or in_messages:
            own = source.lstrip("/") in ("t", "")
            said = [] if own or not layer.canonical else [f"time is taken from {source}"]
            return replace(layer.time, source=source), unfit, said
        if not layer.canonical:
            near = nearest(layer.time.source, by_source)
            unfit.append(f"{layer.where}: t: the log has no {wanted!r}" + (f" (nearest: {near!r})" if near else ""))
    return None, unfit, []


def _unfit(failed: Mapping[str, tuple[str, str]], placements: Mapping[str, Placement]) -> list[str]:
    """Say once per mapping which of its signals fell back to other places."""
    said: list[str] = []
    for where in dict.fromkeys(where for where, _ in failed.values()):
        signals = [signal for signal, (place_of, _) in failed.items() if place_of == where]
        fallen = [signal for signal in signals if signal in placements]
        if not fallen:
            continue
        places = ", ".join(f"{signal} from {placements[signal].places}" for signal in fallen)
        said.append(f"{where} does not fit this log ({failed[fallen[0]][1]}): canonical names used instead, {places}")
    return said
