"""The answer of ``elid excite --resolve``: which effects the planned log will tell apart, and how surely."""

from __future__ import annotations

import shlex
from typing import Any

from elid_cli.experiment.resolve.plan import Pair, Resolution
from elid_cli.report.answers.excitation import limits_payload, limits_table
from elid_cli.report.answers.inputs import heading, robot_payload
from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    number_text,
    percent,
    picked,
)

NOTE = (
    "σ: how far the two effects' predictions lie apart beyond what either can imitate of the other, in standard "
    "deviations of the noise; last log: as the diagnosis found it; decides: how probably a diagnosis of the next log "
    "names the right one alone"
)


def resolution_report(found: Resolution, robot_argument: str, diagnosis: str, file: str, rate: float) -> Report:
    """Return the report of a motion that was planned for `diagnosis` and written to `file`."""
    idle = all(pair.verdict == "no motion" for pair in found.pairs)
    written = f"{file}, {number_text(rate)} Hz: t, q, dq, ddq of every joint"
    facts: tuple[tuple[str, Cell], ...] = (
        ("to decide", f"what {diagnosis} leaves open"),
        ("trajectory", f"{number_text(found.trajectory.duration)} s, quintic splines, from rest to rest"),
        ("written", f"{written}; this motion decides none of it: record what is said below" if idle else written),
        ("chosen from", f"{found.tried} motions within the limits"),
        ("assumed", "the noise of that log, and its estimates with their errors"),
    )
    following = Text("next", shlex.join(["elid", "diagnose", "NEXT_LOG", "--robot", robot_argument]), "next")
    sections: list[Section] = [
        heading(found.robot),
        KeyValues("facts", facts),
        *resolution_sections(found),
        *([] if idle else [following]),
    ]
    payload = resolution_payload(found, diagnosis=diagnosis, file=file, rate=rate)
    return Report("excite", payload, tuple(sections))


def resolution_sections(found: Resolution) -> list[Section]:
    """Return what the planned log will decide, what would decide the rest, and the limits that the motion uses."""
    return [pairs_table(found), *_words(found), limits_table(found)]


def pairs_table(found: Resolution) -> Table:
    """Return a line per pair of effects."""
    columns = (
        *Column.texts(first="is it", second="or"),
        *Column.numbers("σ", last="last log", random="random", planned="planned"),
        Column("decides", "decides", align="right"),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            pair.first.name, pair.second.name, _sigma(pair.last), _sigma(pair.random), _sigma(pair.planned),
            _decides(pair),
        )
        for pair in found.pairs
    ]  # fmt: skip
    return Table("pairs", columns, tuple(rows), title="what the next log will decide", note=NOTE)


def _decides(pair: Pair) -> Cell:
    """Return how probably the planned log decides, in words where it is neither promised nor known well enough."""
    return pair.verdict if pair.alike or pair.verdict == "no motion" else percent(pair.probability, 2)


def _sigma(value: float) -> Cell:
    return Quantity(value, digits=2 if value >= 1 else 1)


def _words(found: Resolution) -> list[Section]:
    """Return a paragraph for every pair of which no decision is promised."""
    return [Text(f"otherwise{k}", _pair_words(pair, found)) for k, pair in enumerate(found.pairs) if pair.otherwise]


def _pair_words(pair: Pair, found: Resolution) -> str:
    names = f"{pair.first.name} or {pair.second.name}"
    if pair.twins:
        said = "no motion tells them apart: the two are the same in every equation"
    elif pair.verdict == "no motion":
        said = f"none of the {found.tried} motions tried tells them apart by more than the noise"
    elif pair.alike:
        why = "one imitates the other" if pair.named else "the diagnosis named neither, so sizes are rough"
        said = f"{pair.verdict} to be decided; no more is promised: {why}"
    else:
        said = f"the planned log decides with {percent(pair.probability, 2)}"
    computed = [r for r in pair.otherwise if r.kind != "record"]
    would = [f"{r.words} would ({percent(r.probability or 0.0, 2)})" for r in computed]
    records = [r.words for r in pair.otherwise if r.kind == "record"]
    return "\n".join([f"{names}: {'; '.join([said, *would])}", *(f"  to record: {words}" for words in records)])


def resolution_payload(found: Resolution, **written: str | float) -> dict[str, Any]:
    """Return the JSON object of a plan; `written` is the diagnosis, and the file and its rate, where there is one."""
    return {
        **robot_payload(found.robot),
        "trajectory": {**written, "duration": found.trajectory.duration},
        "tried": found.tried,
        "pairs": [_pair_payload(pair) for pair in found.pairs],
        "limits_used": limits_payload(found.robot, found.used),
    }


def _pair_payload(pair: Pair) -> dict[str, Any]:
    return {
        "first": {"effect": pair.first.effect, "joint": pair.first.joint},
        "second": {"effect": pair.second.effect, "joint": pair.second.joint},
        "named": pair.named,
        "behind": pair.behind,
        "sigma": picked(pair, "last random planned"),
        "probability": {"random": pair.chance, "planned": pair.probability},
        "verdict": pair.verdict,
        "otherwise": [
            picked(r, "kind words probability") for r in pair.otherwise
        ],
    }  # fmt: skip
