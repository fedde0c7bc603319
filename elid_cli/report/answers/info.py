"""The answer of ``elid info``: what is in a log, and where elid would take each signal from."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from typing import Any

from elid_cli.logs.inspect import ChannelInfo, LogInfo
from elid_cli.logs.mapping.language import GAINS
from elid_cli.report.answers.summary import listed
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, picked
from elid_cli.robot.files import fingerprint
from elid_cli.robot.robot import Robot

SHOWN = 40
"""Channels printed without --all."""
COMPUTED = "tau is computed from q_des with the drives' gains: --kp GAIN --kd GAIN, or control: in the robot file"
"""What is said where a log's commands stand for its torque."""


def info_report(
    infos: Sequence[LogInfo],
    robot: Robot | None,
    robot_argument: str | None,
    maps: Sequence[str] = (),
    written: str | None = None,
) -> Report:
    """Return the report on one or more logs, with the robot whose signals are looked for (if any).

    `maps` are the mappings that they were read with, `written` the file that the mapping was written to.
    """
    payload: dict[str, Any] = {
        "robot": robot.name if robot is not None else None,
        "robot_fingerprint": fingerprint(robot) if robot is not None else None,
        "joints": list(infos[0].joints),
        "log": _log(infos),
        "logs": [inspected_payload(info) for info in infos],
    }
    sections: list[Section] = []
    for number, info in enumerate(infos):
        sections += log_sections(info, number)
    if command := _next(infos, robot_argument, maps, written):
        sections.append(Text("next", command, "next"))
    return Report("info", payload, tuple(sections))


def log_sections(info: LogInfo, number: int = 0) -> list[Section]:
    """Return what is in one log."""
    suffix = str(number) if number else ""
    joints = ", ".join(info.joints) or "none named"
    facts: list[tuple[str, Cell]] = [("format", info.format + (f", {info.parts} parts" if info.parts > 1 else ""))]
    longest = max((c for c in info.channels if c.span is not None), key=lambda c: c.span or 0.0, default=None)
    if longest is not None:
        facts.append(("recorded", f"{number_text(longest.span)} s"))
    facts.append(("joints", joints))
    facts += [(signal, place) for signal, place in info.taken.items()]
    facts += [(signal, f"missing: {info.reasons.get(signal, 'no such channel')}") for signal in info.missing]
    facts += [("lost", sentence) for sentence in info.losses]
    facts += [("note", sentence) for sentence in info.notes]
    sections: list[Section] = [
        Text(f"title{suffix}", info.file, "heading"),
        Text(f"answer{suffix}", _answer(info)),
        KeyValues(f"facts{suffix}", tuple(facts)),
        _channels(info, f"channels{suffix}"),
    ]
    if info.mapping:
        what = f"{', '.join(info.missing)} cannot be placed by name; a guess for --map, to be checked:"
        units = "units that its header names are not taken unless --map says so:"
        sections += [
            Text(f"suggested{suffix}", what if info.missing else units),
            Text(f"mapping{suffix}", info.mapping.rstrip("\n"), "code"),
        ]
    if "\nq_des:" in f"\n{info.mapping}" or info.gains_missing:
        sections.append(Text(f"computed{suffix}", COMPUTED))
    return sections


def _answer(info: LogInfo) -> str:
    """Return whether elid finds in a log what it needs, in a sentence."""
    rate = max((c.rate for c in info.channels if c.rate is not None), default=None)
    longest = max((c.span for c in info.channels if c.span is not None), default=None)
    size = "" if longest is None else f", {number_text(longest, 3)} s"
    size += "" if rate is None else f" at {number_text(rate)} Hz"
    many = f"{len(info.joints)} joint{'s' * (len(info.joints) != 1)}"
    if not info.missing:
        units = ", with the mapping below, which says its units" if info.mapping else ""
        drives = ", with the gains of its drives" if info.gains_missing else ""
        return f"This log can be used{units}{drives}: it has {listed(list(info.taken))} of {many}{size}."
    how = "a guess is below" if info.mapping else "--map can say where that is"
    return f"Not found in this log of {many}{size}: {listed(list(info.missing))}; {how}."


def _channels(info: LogInfo, key: str) -> Table:
    """Return the table of channels, without columns that would be empty for this log."""
    candidates: list[tuple[Column, Callable[[ChannelInfo], Cell]]] = [
        (Column("channel", "channel"), lambda c: c.name),
        (Column("kind", "kind"), lambda c: c.kind),
        (Column("labels", "names"), lambda c: " ".join(c.labels)),
        (Column("count", "samples", align="right"), lambda c: c.count),
        (Column("rate", "rate", "Hz", align="right"), lambda c: None if c.rate is None else Quantity(c.rate, "Hz", 4)),
        (Column("gaps", "gaps", align="right"), lambda c: c.gaps or ""),
        (Column("signals", "signal"), lambda c: " ".join(c.signals)),
    ]
    kept = [(column, cell) for column, cell in candidates if any(cell(c) not in ("", None) for c in info.channels)]
    kept = kept or candidates[:1]  # a log without channels
    if len({c.kind for c in info.channels}) == 1:
        kept = [(column, cell) for column, cell in kept if column.key != "kind"]
    rows = tuple(tuple(cell(channel) for _, cell in kept) for channel in info.channels)
    return Table(key, tuple(column for column, _ in kept), rows, shown=SHOWN)


def mapping_lines(info: LogInfo) -> list[str]:
    """Return the lines of a mapping file: where each signal is taken from, and guesses for those that are missing."""
    from elid_cli.robot.yaml import emit

    guessed = info.mapping.splitlines()
    names = {line.partition(":")[0] for line in guessed}
    found = {signal: entry for signal, entry in info.resolved.items() if signal not in names}
    lines = [f"# where {info.file} keeps its signals", *emit(found)] if found else []
    lines += ["# guessed from names, to be checked", *guessed] if guessed else []
    computed = {"tau"} if "q_des" in names else set()
    left = [s for s in info.missing if s not in names | computed]
    lines += [f"# {COMPUTED}"] if computed else []
    return lines + [f"# {signal}: {{from: …}}   # not found" for signal in left]


def _next(infos: Sequence[LogInfo], robot: str | None, maps: Sequence[str], written: str | None) -> str:
    """Return the next command; empty where only the user knows where the signals are."""
    files = [info.file for info in infos]
    named = ["--robot", robot or "ROBOT"]
    given = [part for one in maps for part in ("--map", one)]
    missing = {signal for info in infos for signal in info.missing}
    guessed = {line.partition(":")[0] for info in infos for line in info.mapping.splitlines()}
    rate = ["--rate", "HZ"] if "t" in missing - guessed else []
    lacking = {gain for info in infos for gain in info.gains_missing}
    gains = [part for gain in GAINS if gain in lacking for part in (f"--{gain}", "GAIN")]
    if written:
        return shlex.join(["elid", "identify", *files, *named, "--map", written, *gains, *rate])
    if robot and (link := next((info.chain for info in infos if info.chain), "")):
        return shlex.join(["elid", "info", *files, *named, "--tip", link, *given])
    if missing - {"t"} and not any(info.mapping or info.resolved for info in infos):
        return ""
    if guessed or missing - {"t"}:
        name = next(name for k in range(len(maps) + 1) if (name := f"map{k or ''}.yaml") not in maps)
        own = ["--robot", robot] if robot else []
        return shlex.join(["elid", "info", *files, *own, *given, "--write-map", name])
    return shlex.join(["elid", "identify", *files, *named, *given, *gains, *rate])


def _log(infos: Sequence[LogInfo]) -> dict[str, Any]:
    channels = [channel for info in infos for channel in info.channels]
    return {
        "files": [info.file for info in infos],
        "sha256": [info.sha256 for info in infos],
        "samples": max((c.count for c in channels if c.count is not None), default=None),
        "duration": max((c.span for c in channels if c.span is not None), default=None),
        "rate": max((c.rate for c in channels if c.rate is not None), default=None),
        "repairs": [sentence for info in infos for sentence in info.losses],
    }


def inspected_payload(info: LogInfo) -> dict[str, Any]:
    """Return the JSON object of one log."""
    return {
        **picked(info, "file sha256 format parts joints"),
        "channels": [
            {**picked(c, "name kind labels"), "samples": c.count, **picked(c, "rate gaps span signals")}
            for c in info.channels
        ],
        **picked(info, "taken missing reasons mapping losses notes"),
    }
