"""The answer of ``elid trend``: which parameters changed over recordings, and how."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from elid_cli.estimation.trend.families import JOINTS
from elid_cli.estimation.trend.trends import Trend, Trends
from elid_cli.report.answers.summary import called, counted
from elid_cli.report.answers.trend_apart import (
    change_words,
    standing_out_entries,
    standing_out_table,
    standing_out_words,
)
from elid_cli.report.answers.trend_families import family_entries, family_sentences
from elid_cli.report.tree import (
    Cell,
    Column,
    Folded,
    KeyValues,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    Tone,
    number_text,
    warned,
)

WORDS = {
    "trend": "changes steadily",
    "step": "changed at once",
    "disagrees": "recordings disagree",
    "steady": "steady",
}


def trend_report(found: Trends, remarks: Sequence[str] = ()) -> Report:
    """Return the report on recordings; `remarks` of the command line stand before the warnings of results."""
    warnings = (*remarks, *found.warnings)
    together = family_sentences(found, "together")
    answers = [
        ("what stands out?", standing_out_words(found)), ("what has changed?", _changed(found)),
        ("what do joints share?", " ".join(together)), ("what disagrees?", _disagreeing(found)),
    ]  # fmt: skip
    sections: list[Section] = [
        Text("title", f"{found.robot} · {len(found.files)} recordings", "heading"),
        KeyValues("answers", tuple((question, answer) for question, answer in answers if answer)),
        *warned(warnings),
        *standing_out_table(found),
        *_tables(found),
    ]
    return Report("trend", trend_payload(found, warnings), tuple(sections))


def trend_payload(found: Trends, warnings: Sequence[str]) -> dict[str, Any]:
    """Return the JSON object of a trend with what is warned of."""
    return {
        "robot": found.robot,
        "joints": found.joints,
        "log": {"files": [file for file, _ in found.logs], "sha256": [digest for _, digest in found.logs]},
        "files": found.files,
        "slope_per": found.axis,
        "stands_out": standing_out_entries(found),
        "parameters": [_entry(item, found) for item in found.trends],
        "families": family_entries(found),
        "warnings": warnings,
    }


def _entry(item: Trend, found: Trends) -> dict[str, Any]:
    s, files = item.series, found.files
    step = None
    if s.step is not None:
        step = {"after": files[item.number(s.step.after)], "size": s.step.size, "p": s.step.p}
    far = [(abs(d.deviations), r.number) for r in found.stands_out for d in r.parameters if d.name == s.name]
    return {
        "name": s.name,
        "unit": s.unit,
        "recordings": len(s.values),
        "mean": s.mean,
        "within_session": s.within,
        "between_sessions": s.between,
        "slope": s.slope,
        "slope_interval": s.interval,
        "slope_p": s.slope_p,
        "step": step,
        "stands_out": files[max(far)[1]] if far else None,
        "verdict": item.word,
    }


def _changed(found: Trends) -> str:
    moved = found.of("trend", "step")
    together = family_sentences(found, "trend")
    if not moved and together:
        return f"{' '.join(together)} No parameter alone."
    if not moved and found.disagreeing:
        names = counted([called(item.series.name) for item in found.disagreeing], ", ")
        return f"No trend and no step is certain, but recordings disagree in {names}."
    if not moved:
        return (
            f"Nothing, of {len(found.trends)} parameters: at most one machine in a hundred is called changed by chance."
        )
    said = [f"{item.series.name} {changed_by(item)}" for item in moved[:4]]
    more = f"; {len(moved) - 4} more below" if len(moved) > 4 else ""
    return " ".join([*together, f"{'; '.join(said)}{more}."])


def changed_by(item: Trend) -> str:
    """Return by how much a parameter changed, as a share of what it was before, or at first."""
    s = item.series
    if item.word == "step" and s.step is not None:
        before = float(s.values[: s.step.after + 1].mean())
        return f"by {change_words(s.step.size, before, s.unit)} at once after recording {item.number(s.step.after) + 1}"
    reach = float(s.place[-1] - s.place[0])
    first = s.mean - s.slope * float(s.place.mean() - s.place[0])
    return f"by {change_words(s.slope * reach, first, s.unit)} from the first to the last"


def _disagreeing(found: Trends) -> str:
    apart = found.disagreeing
    if not apart:
        return "No parameter scatters farther than errors, trends and steps explain."
    told = f"{disagreeing_words(found)}: recordings differ by more than their errors say{_whether_a_trend(found)}."
    together = {name for family in found.families for name in family.names}
    if "temperature" in found.conditions and not any(item.series.name in together for item in apart):
        told += f" Their temperature was not tried: that needs parameters of one kind at {JOINTS} joints."
    return told


def disagreeing_words(found: Trends) -> str:
    """Return the parameters in which recordings disagree, the clearest first, and by how much of the first few."""
    told = []
    for item in found.disagreeing:
        s = item.series
        size, before, deviations = s.widest
        by = change_words(size, before, s.unit).removeprefix("+")
        told.append((deviations, f"{called(s.name)} by up to {by} ({number_text(deviations, 3)} standard errors)"))
    told.sort(key=lambda one: -one[0])
    return counted([words for _, words in told], ", ")


def _whether_a_trend(found: Trends) -> str:
    """Return whether what disagrees may be a trend of time, which few recordings do not show."""
    unclear = [item.series for item in found.disagreeing if item.series.undecided]
    if not unclear:
        return ", and no trend explains it"
    who = "it" if len(found.disagreeing) == 1 else counted([called(s.name) for s in unclear], ", ")
    count = max(len(s.values) for s in unclear)
    return f"; {count} recordings are too few to tell whether {who} follow{'s' * (len(unclear) == 1)} time"


def _tables(found: Trends) -> list[Section]:
    """Return a table of the parameters of every verdict; without a column for it, rows fit into 80 columns."""
    columns = (
        Column("name", "base parameter", span=True),
        *Column.numbers(mean="mean"),
        *Column.texts(unit="unit"),
        *Column.numbers(within="within", between="between", slope="slope", reach="± 95 %"),
    )
    note = (
        "within: standard error of one recording; between: spread of recordings beyond that, any trend included; "
        f"slope: per {found.axis}, with the half width of its 95 % interval"
    )
    tables: list[Section] = []
    groups = {word: [item for item in found.trends if _of_others(item) == word] for word in WORDS}
    present = [word for word, items in groups.items() if items]
    for word in present:
        rows = tuple(_row(item) for item in groups[word])
        title = f"{WORDS[word]}: {len(rows)} of {len(found.trends)} parameters"
        tables.append(
            Table(f"parameters_{word}", columns, rows, title, shown=20, note=note if word == present[-1] else "")
        )
    return tables


def _of_others(item: Trend) -> str:
    """Return the verdict without recordings that stand out, which have a table of their own."""
    return "steady" if item.word == "disagrees" and not item.scattered else item.word


def _row(item: Trend) -> tuple[Cell, ...]:
    s = item.series
    reach = (s.interval[1] - s.interval[0]) / 2
    tone: Tone = "plain" if _of_others(item) == "steady" else "warn"
    return (
        Folded(s.name, called(s.name)), Quantity(s.mean, resolution=s.within), s.unit, Quantity(s.within, digits=2),
        Quantity(s.between, digits=2), Quantity(s.slope, digits=2, tone=tone),
        number_text(reach, 2) if isfinite(reach) else "–",
    )  # fmt: skip
