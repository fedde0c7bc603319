"""A mapping to paste where elid cannot tell a signal's channel: guessed from names, never applied."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from elid_cli.errors import nearest
from elid_cli.logs.contract import Channel, RawLog
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
    lacking += [s for s in sides if s not in placed and not (rigid and placed & {"q", "theta"})]
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
        for score, k in sorted((-_score(signal, places[k]), k) for k in free):
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
        unit = _unit(channel, units.get(channel.source, ""))
        family, source, named = _family(channel, channels, joints)
        done |= {(member, channel.field) for member in family}
        if len(family) > 1:
            own = [_unit(Channel(member, channel.field, 1), units.get(member, "")) for member in family]
            if len(set(own)) > 1 and len(own) == len(joints):  # lengths beside angles, say
                unit = (
                    "{" + ", ".join(f"{_quoted(j)}: {_quoted(u)}" for j, u in zip(joints, own, strict=True) if u) + "}"
                )
            yield _Place(Channel(family[0], channel.field, 1, kind=channel.kind), source, named, unit)
        elif channel.labels and joints and not set(joints) <= set(channel.labels):
            names = _called(joints, channel.labels, names)
            yield _Place(channel, _quoted(channel.source), _pairs(joints, names), unit)
        elif (
            len(joints) > 1 and not channel.labels and channel.width % len(joints) == 0 and channel.width > len(joints)
        ):
            blocks = BLOCKS.get(channel.width // len(joints), ())
            for number, signal in enumerate(blocks):
                first = number * len(joints)
                pairs = _pairs(joints, range(first, first + len(joints)))
                yield _Place(channel, _quoted(channel.source), pairs, unit, signal)
        else:
            yield _Place(channel, _quoted(channel.source), "", unit)


def _called(joints: Sequence[str], labels: Sequence[str], before: Sequence[str | None]) -> list[str | None]:
    """Return what a channel calls each joint, None where it has none left for it; no two joints share a name.

    `before` is what another channel calls them, empty for the first: a joint is the same one in all of them.
    """
    labels = list(dict.fromkeys(labels))
    wanted = [name or joint for name, joint in zip(before or joints, joints, strict=True)]
    own = [name if name in labels else None for name in wanted]
    if before and any(own):
        return own
    left = [name for name in labels if name not in own]
    close = [name or nearest(like, left) for name, like in zip(own, wanted, strict=True)]
    if None not in close and len(set(close)) == len(close):
        return close
    return [name or (left.pop(0) if left else None) for name in own]


def _family(channel: Channel, channels: Sequence[Channel], joints: Sequence[str]) -> tuple[list[str], str, str]:
    """Return the columns that are a channel's at every joint, how a mapping writes them, and its `joints`."""
    source, alone = channel.source, ([channel.source], channel.source, "")
    names = [c.source for c in channels if c.field == channel.field and c.width == 1]
    if channel.width > 1:
        return alone
    named = _named_alike(source, names, joints)
    if named is None and len(joints) > 1:
        named = _numbered_alike(source, names, len(joints)) or _peers(source, names, joints)
    return named or alone


def _named_alike(source: str, names: Sequence[str], joints: Sequence[str]) -> tuple[list[str], str, str] | None:
    """Return the columns whose names differ from `source` in a joint's name alone, if every joint has one."""
    for joint in sorted(joints, key=len, reverse=True):
        if re.search(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", source):
            pattern = source.replace(joint, "{joint}", 1)
            members = [name for other in joints if (name := pattern.replace("{joint}", other)) in names]
            if len(members) == len(joints):
                return members, f'"{pattern}"', ""
    return None


def _numbered_alike(source: str, names: Sequence[str], joints: int) -> tuple[list[str], str, str] | None:
    """Return the columns whose names differ from `source` in a number alone that counts the joints."""
    for match in reversed(list(re.finditer(r"\d+", source))):
        before, after = source[: match.start()], source[match.end() :]
        like = re.compile(rf"{re.escape(before)}(\d+){re.escape(after)}")
        numbers = sorted(int(found[1]) for name in names if (found := like.fullmatch(name)))
        count = min(len(numbers), joints)  # fewer: of the first joints, as the others are held
        if count > 1 and numbers[:count] == list(range(numbers[0], numbers[0] + count)):
            mark = {0: "{i0}", 1: "{i}"}.get(numbers[0])
            members = [f"{before}{number}{after}" for number in numbers]
            if mark or count == joints:
                listed = f"[{', '.join(map(_quoted, members[:joints]))}]"
                return members, f'"{before}{mark}{after}"' if mark else listed, ""
    return None


def _peers(source: str, names: Sequence[str], joints: Sequence[str]) -> tuple[list[str], str, str] | None:
    """Return the columns of the same group as `source` whose names are like the joints', each like another one's."""
    for cut in (".", "/"):
        head, _, own = source.rpartition(cut)
        peers = [name.rpartition(cut)[2] for name in names if head and own and name.rpartition(cut)[0] == head]
        close = [nearest(joint, peers) for joint in joints]
        if None not in close and len(set(close)) == len(close):
            return [f"{head}{cut}{name}" for name in peers], f'"{head}{cut}{{joint}}"', _pairs(joints, close)
    return None


def _pairs(joints: Sequence[str], names: Sequence[object]) -> str:
    """Return the `joints` of a mapping; those without a name are left out."""
    return ", ".join(f"{joint}: {name}" for joint, name in zip(joints, names, strict=False) if name is not None)


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


def _unit(channel: Channel, written: str) -> str:
    """Return the unit that a header or the end of a name tells, as the mapping language writes it; empty: none."""
    last = re.split(r"[_\s(\[]", re.sub(r"[\])]$", "", channel.address))
    ending = last[-1] if len(last) > 1 else ""
    for text in (written, ending, re.sub(r"(?<=[^\W\d]{3})\d+$", "", ending)):  # pos_deg1 as pos_deg
        known = UNIT_WORDS.get(re.sub(r"[\s*·.]", "", text.lower().strip("[]()")))
        if known is not None:
            return known
    return "counts:4096" if re.search(r"counts|ticks", channel.address.lower()) else ""


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


def _quoted(name: str) -> str:
    from elid_cli.robot.yaml import quoted

    return quoted(name)
