"""A mapping to paste where elid cannot tell a signal's channel: guessed from names, never applied."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from elid_cli.logs.contract import Channel, RawLog
from elid_cli.logs.mapping.families import Family, called, family, pairs, quoted, unit_of, with_units
from elid_cli.logs.mapping.language import COMMANDS, GAINS, UNIT_WORDS
from elid_cli.logs.mapping.nameless import BLOCKS, NamelessTable, proposed
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

WORDS: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestamp", "stamp", "zeit", "temps", "tiempo", "tempo", "clock"),
    "tau": ("tau", "torque", "effort", "taum", "moment", "drehmoment", "couple", "par", "force", "kraft", "tq", "trq",
            "forza", "fuerza", "coppia", "current", "strom", "courant", "corriente", "voltage", "i", "u"),
    "theta": ("theta", "motor", "rotor"),
    "q": ("q", "qpos", "link", "position", "pos", "angle", "winkel", "joint", "achse", "axis", "angulo", "angolo",
          "posicion", "posizione", "posicao", "deflection", "defl"),
}  # fmt: skip
"""Words that name a signal, the surest first."""
CURRENTS = {"current", "strom", "courant", "corriente", "i", "u", "voltage"}
TOLD = {"ref", "cmd", "des", "desired", "target", "soll", "command", "commanded", "reference", "setpoint", "goal",
        "action"}  # fmt: skip
COMMANDED = {"q_des": False, "dq_des": True}
"""What a drive is told of its position loop, and whether it is a rate."""
NO_POSITION = {"tau", "taum", "torque", "effort", "current", "moment", "strom", "force", "voltage", "temperature"}
RATES = {
    "vel",
    "velocity",
    "speed",
    "dq",
    "qd",
    "qvel",
    "dtheta",
    "ddq",
    "qdd",
    "acc",
    "accel",
    "acceleration",
    "rpm",
    "rads",
}
RATES |= {"geschwindigkeit", "drehzahl", "beschleunigung", "velocidad", "velocidade", "velocita", "vitesse"}
RATES |= {"aceleracion", "aceleracao", "accelerazione"}
OTHERS: Mapping[str, set[str]] = {
    "t": RATES,
    "tau": {"link"} | RATES,
    "theta": TOLD | RATES | {"tau", "taum", "torque", "effort", "current", "moment", "strom"},
}
"""Words that a signal's name does not have."""
OTHERS = {**OTHERS, "q": OTHERS["theta"] | {"motor", "rotor", "temperature", "drehmoment", "force", "kraft", "voltage"}}
POSITIONAL = {"position", "positions", "pos", "q", "qpos", "theta", "angle", "angles", "rad", "deg", "counts", "ticks"}
"""Words, some of them units, of which a message's field has one where it may be a position."""
MOST = 2000
"""Channels that a hint is looked for among: every one is compared with every other."""


@dataclass(frozen=True)
class _Place:
    """Somewhere that a signal may be: a channel, a pattern of columns, or columns by name."""

    channel: Channel
    source: str
    """As a mapping writes it, quoted where it must be."""
    joints: str = ""
    unit: str = ""
    block: str | None = None
    """Signal that it holds by its place in a table of all of them; None: told by its name."""
    partial: bool = False
    """Whether some joints have no column in it."""


def needed(plan: ReadPlan, robot: Robot, units: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Return the signals that a log's plan lacks for a robot: positions, and a torque or what one is made of.

    Time counts among them where there is none, or where the header (`units` by column) says that it is not in s.
    """
    placed = set(plan.placements)
    written = UNIT_WORDS.get((units or {}).get(plan.time.source, "s").lower(), "s") if plan.time is not None else ""
    timed = plan.time is not None and (plan.time.factor is not None or written == "s")
    lacking = [] if timed else ["t"]
    rigid = not any(joint.transmission == "elastic" for joint in robot.joints)
    sides = ["q"] if rigid else ["q", "theta"]
    if "tau_link" in placed and "q" in placed:
        sides = ["q"]
    found = {j for s in {"q", "theta"} & placed for joints in plan.placements[s].joints for j in joints}
    whole = {"q", "theta"} <= placed or len(found) == robot.n
    lacking += [s for s in sides if s not in placed and not (rigid and whole)]
    return (*lacking, *(() if placed & {"tau", "tau_link", "q_des"} else ("tau",)))


def untold(plan: ReadPlan) -> str:
    """Return what a log without torque has of commands where it lacks their positions, in words; else nothing."""
    placed = plan.placements
    told = [signal for signal in (*COMMANDS, *GAINS) if signal in placed]
    if "q_des" in placed or {"tau", "tau_link"} & set(placed) or not told:
        return ""
    reason = plan.reasons.get("q_des", "")
    return f"of commands it has {' '.join(dict.fromkeys(told))} and no q_des{f' ({reason})' if reason else ''}"


def proposal(
    raw: RawLog, robot: Robot, channels: Sequence[Channel], signals: Sequence[str], works: Callable[[str], bool]
) -> tuple[str, str]:
    """Return YAML lines that map `signals` (`suggestion`), and the link to whose chain a table without names belongs.

    That is empty where the whole robot is meant, or the channels have names.
    """
    table = NamelessTable.of(channels[:MOST])
    if table is not None:
        link, lines = proposed(table, robot, signals, raw.load)
        if lines:
            return "\n".join(lines), link
    return suggestion(channels, robot.joint_names, signals, works, getattr(raw, "units", {})), ""


def completed(
    plan: ReadPlan,
    channels: Sequence[Channel],
    joints: Sequence[str],
    works: Callable[[str], bool] = lambda line: True,
    units: Mapping[str, str] | None = None,
) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return, by signal, a YAML line that also finds columns which a canonical name misses for the unit at their end.

    With it come the joints that it holds. Arguments are as for `suggestion`.
    """
    names = [channel.source for channel in channels[:MOST] if channel.width == 1 and not channel.field]
    lines: dict[str, tuple[str, tuple[str, ...]]] = {}
    for signal, placement in plan.placements.items():
        if "{joint}" not in placement.places or placement.spec.field or set(placement.spec.written or {}) - {"from"}:
            continue
        found = with_units(placement.places, names, joints)
        if found is not None and len(found.members) > len(placement.picks):
            place = _Place(Channel(found.members[0], "", 1), found.source, "", _units(found, "", joints, units or {}))
            line = f"{signal}: {_spec(signal, place)}"
            if works(line):
                lines[signal] = line, found.held
    return lines


def suggestion(
    channels: Sequence[Channel],
    joints: Sequence[str],
    signals: Sequence[str],
    works: Callable[[str], bool] = lambda line: True,
    units: Mapping[str, str] | None = None,
) -> str:
    """Return YAML lines that map `signals` to the channels whose names fit best; empty where none does.

    Parameters
    ----------
    channels, joints
        Of the log and of the robot.
    signals
        What is looked for.
    works
        Asked whether the log can be read by a line: one that cannot, which may be what has just failed, is none.
    units
        Units that the log's header gives, by column.
    """
    channels = channels[:MOST]
    places = list(_places(channels, joints, units or {}))
    taken: set[str] = set()
    lines = list(_fitting(places, signals, works, taken))
    found = {line.partition(":")[0] for line in lines}
    if "q" in signals and not found & {"q", "theta"} and "theta" not in signals:  # motors' positions are all there are
        return suggestion(channels, joints, ["theta" if s == "q" else s for s in signals], works, units)
    order = {signal: k for k, signal in enumerate(signals)}
    lines.sort(key=lambda line: order[line.partition(":")[0]])
    if "tau" in set(signals) - found and (lines or "q" not in signals):  # of commands a torque can be computed
        told = list(_fitting(places, tuple(COMMANDED), works, taken))
        lines += told if any(line.startswith("q_des:") for line in told) else []  # a rate alone makes no torque
    return "\n".join(lines)


def _fitting(
    places: Sequence[_Place], signals: Sequence[str], works: Callable[[str], bool], taken: set[str]
) -> Iterator[str]:
    """Yield a line for every signal that some free place fits; places are added to those that are `taken`."""
    for signal in sorted(signals, key=lambda name: tuple(WORDS).index(name) if name in WORDS else len(WORDS)):
        free = (k for k, p in enumerate(places) if p.source not in taken or p.block == signal)
        for score, _, k in sorted((-_score(signal, places[k]), places[k].partial, k) for k in free):
            line = f"{signal}: {_spec(signal, places[k])}" if score < 0 else ""
            if line and works(line):
                yield line
                taken.add(places[k].source if not places[k].channel.field else "")
                break


def _places(channels: Sequence[Channel], joints: Sequence[str], units: Mapping[str, str]) -> Iterator[_Place]:
    """Yield channels with one place per family of columns: ``theta1_rad theta2_rad`` become ``theta{i}_rad``."""
    done: set[tuple[str, str]] = set()
    names: Sequence[str | None] = ()
    for channel in channels:
        if (channel.source, channel.field) in done or not channel.width:
            continue
        found = family(channel, channels, joints)
        if found is not None and (len(found.members) > 1 or len(joints) > 1):
            done |= {(member, channel.field) for member in found.members}
            first = Channel(found.members[0], channel.field, 1, kind=channel.kind)
            unit = _units(found, channel.field, joints, units)
            yield _Place(first, found.source, found.joints, unit, partial=0 < len(found.held) < len(joints))
            continue
        unit = unit_of(channel.address, units.get(channel.source, ""))
        if channel.labels and joints and not set(joints) <= set(channel.labels):
            names = called(joints, channel.labels, names)
            yield _Place(channel, quoted(channel.source), pairs(joints, names), unit)
        elif (
            len(joints) > 1 and not channel.labels and channel.width % len(joints) == 0 and channel.width > len(joints)
        ):
            blocks = BLOCKS.get(channel.width // len(joints), ())
            for number, signal in enumerate(blocks):
                start = number * len(joints)
                numbers = pairs(joints, range(start, start + len(joints)))
                yield _Place(channel, quoted(channel.source), numbers, unit, signal)
        else:  # whose values a known message holds must be said, in whatever order they are
            unnamed = channel.kind and channel.field and not channel.labels and channel.width == len(joints) > 1
            numbers = pairs(joints, range(len(joints))) if unnamed else ""
            yield _Place(channel, quoted(channel.source), numbers, unit)


def _units(found: Family, field: str, joints: Sequence[str], units: Mapping[str, str]) -> str:
    """Return the unit of a family's columns, or those of its joints where they differ: lengths beside angles, say."""
    own = [unit_of(Channel(member, field, 1).address, units.get(member, "")) for member in found.members]
    held = found.held or tuple(joints)
    if len(set(own)) > 1 and len(own) == len(held):
        return f"{{{', '.join(f'{quoted(j)}: {quoted(u)}' for j, u in zip(held, own, strict=True) if u)}}}"
    stem = Channel(found.stem, field, 1).address
    return own[0] or unit_of(stem, "") or unit_of(re.sub(r"[\W_\d]+$", "", stem), "")


def words_of(text: str) -> list[str]:
    """Return the words of a name in lower case, without accents: of ``actual_qd_0`` and ``MotorPos``, say."""
    plain = "".join(letter for letter in unicodedata.normalize("NFD", text) if not unicodedata.combining(letter))
    return [word.lower() for word in re.findall(r"[A-Z]?[a-zßµ]+|[A-Z]+", plain)]


def _score(signal: str, place: _Place) -> float:
    """Return how well a place fits a signal; 0: not at all."""
    channel = place.channel
    if place.block is not None:
        return float(place.block == signal)
    words = words_of(f"{channel.source}.{channel.field}")
    if signal in COMMANDED:
        rated = bool(RATES & set(words) or re.search(r"rad_?s$|deg_?s$", channel.address.lower()))
        return float(bool(TOLD & set(words)) and rated == COMMANDED[signal] and not NO_POSITION & set(words))
    if signal not in WORDS or OTHERS[signal] & set(words) or re.search(r"rad_?s$|deg_?s$", channel.address.lower()):
        return 0.0
    position = channel.field and signal in ("q", "theta")
    if position and not POSITIONAL & set(words_of(channel.field)):
        return 0.0
    if signal == "t" and (channel.width > 1 or channel.field or "{" in place.source or place.source.startswith("[")):
        return 0.0
    if signal != "t" and place.unit in ("s", "ms", "us", "ns"):
        return 0.0
    for rank, word in enumerate(WORDS[signal]):
        if word in words or (len(word) > 3 and word in channel.address.lower()):
            score = float(len(WORDS[signal]) - rank)
            # what was told is no measurement, but a torque in N·m is worth more than a current
            return score / (4.0 if word in CURRENTS else 1.0) / (2.0 if TOLD & set(words) else 1.0)
    return 0.0


def _spec(signal: str, place: _Place) -> str:
    channel = place.channel
    parts = [f"from: {place.source}"]
    if channel.field:
        parts.append(f"field: {channel.field}")
    if place.joints:
        parts.append(f"joints: {{{place.joints}}}")
    if signal == "q" and "defl" in channel.address.lower():
        parts.append("add: theta")
    unit = place.unit
    if COMMANDED.get(signal):
        unit = "deg/s" if re.search(r"deg_?s$", channel.address.lower()) else ""
    if signal == "t":
        unit = unit if unit in ("s", "ms", "us", "ns") else "s"
    if signal == "tau" and not unit and CURRENTS & set(words_of(channel.address)) - {"u", "i"}:
        unit = "A"
    if unit and unit not in (("rad", "m") if signal in ("q", "theta", "q_des") else ("N.m", "N")):
        parts.append(f"unit: {unit}" if re.fullmatch(r"[\w./:]+|\{.*\}", unit) else f'unit: "{unit}"')
    if signal == "tau" and unit in ("A", "mA"):
        parts.append("scale: 1.0")
    return "{" + ", ".join(parts) + "}"
