"""The answer of ``elid sample``: what the drawn sets hold and how far they reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from elid_cli.estimation.sampling.pool import Distribution
from elid_cli.estimation.sampling.sets import ParameterSets
from elid_cli.report.answers.summary import BIASED, listed, share_text
from elid_cli.report.tree import Cell, Column, KeyValues, Mark, Quantity, Report, Section, Table, Text, picked

SHOWN = 20
WIDEST = 3
"""Parameters that the first answer names."""
ORIGIN = (
    "drawn: from the estimates; split: part of a drawn sum, divided as in the robot file; held: at the robot file's "
    "value, as no log shows it"
)


def sampling_report(sets: ParameterSets, written: Sequence[str] = ()) -> Report:
    """Return the report on drawn sets, with the files that were written."""
    found, several = sets.distribution, len(sets.distribution.files) > 1
    facts: list[tuple[str, Cell]] = [("result", file) for file in found.files]
    facts += [("sets", len(sets.values)), ("seed", sets.seed)]
    facts += [("note", note) for note in sets.notes] + [("written", path) for path in written]
    entries = [entry for entry in parameter_payload(sets) if entry["origin"] != "unknown"]
    marked = any(entry["origin"] != "drawn" or entry["bias_possible"] for entry in entries)
    columns = (
        Column("name", "parameter", span=True),
        *Column.numbers(mean="mean", std="± sd", low="2.5 %", high="97.5 %"),
        *((Column("between", "between recordings", align="right"),) if several else ()),
        Column("unit", "unit"),
        *((Column("origin", "origin"),) if marked else ()),
    )
    rows: list[tuple[Cell, ...]] = []
    for entry in entries:
        spread = entry["std"] or None
        cells: list[Cell] = [entry["name"]]
        cells += [Quantity(entry[key], resolution=spread) for key in ("mean", "std", "low", "high")]
        cells += [Quantity(entry["between"], digits=2)] if several else []
        rows.append((*cells, entry["unit"], *((_mark(entry),) if marked else ())))
    title = "range of the sets: the middle 95 %"
    sections: list[Section] = [
        Text("title", found.robot, "heading"),
        KeyValues("answers", (("what was drawn?", _drawn_words(sets, entries)),)),
        Table("parameters", columns, tuple(rows), title, SHOWN, ORIGIN if marked else ""),
        KeyValues("inputs", tuple(facts), "how they were drawn"),
    ]
    if any(entry["bias_possible"] for entry in entries):
        sections.append(Text("bias", _BIAS, "warning"))
    return Report("sample", _payload(sets, written), tuple(sections))


_BIAS = (
    "the models of these results lack something, which can bias parameters by more than their standard errors. The "
    "sets do not cover that. elid diagnose looks for the cause"
)


def _drawn_words(sets: ParameterSets, entries: Sequence[dict[str, Any]]) -> str:
    """Return how many sets of which parameters, how far they reach, and what does not vary."""
    varied = [entry for entry in entries if entry["origin"] != "held"]
    wide = [(entry["std"] / abs(entry["mean"]), entry["name"]) for entry in varied
            if entry["mean"] and entry["std"] < abs(entry["mean"])]  # fmt: skip
    widest = [f"{name} (± {share_text(share)})" for share, name in sorted(wide, reverse=True)[:WIDEST]]
    held = len(entries) - len(varied)
    said = f"{len(sets.values)} sets of {len(varied)} parameters that vary together as the results say"
    rest = f"; {held} more are held at the robot file's values" if held else ""
    return f"{said}{rest}." + (f" Widest for their size: {listed(widest)}." if widest else "")


def with_samples(report: Report, sets: ParameterSets) -> Report:
    """Return the report with the sets themselves in its JSON."""
    return replace(report, payload={**report.payload, "samples": sets.values})


def _mark(entry: dict[str, Any]) -> Cell:
    if entry["origin"] != "drawn":
        return Mark(entry["origin"], "dim" if entry["origin"] == "held" else "plain")
    return Mark(BIASED, "warn") if entry["bias_possible"] else "drawn"


def _payload(sets: ParameterSets, written: Sequence[str]) -> dict[str, Any]:
    found = sets.distribution
    return {
        **picked(found, "robot joints files"),
        "count": len(sets.values),
        "seed": sets.seed,
        "parameters": parameter_payload(sets),
        "written": list(written),
        "notes": list(sets.notes),
    }


def parameter_payload(sets: ParameterSets) -> list[dict[str, Any]]:
    """Return the list ``parameters`` of JSON."""
    low, high = sets.bounds
    mean, std = sets.spread
    told = _by_leader(sets.distribution)
    entries = []
    for k, name in enumerate(sets.names):
        between, biased = told.get(name, (float("nan"), False))
        entries.append({
            "name": name, "unit": sets.units[k], "origin": sets.origin[k], "mean": float(mean[k]),
            "std": float(std[k]), "low": float(low[k]), "high": float(high[k]), "between": between,
            "bias_possible": biased,
        })  # fmt: skip
    return entries


def _by_leader(found: Distribution) -> dict[str, tuple[float, bool]]:
    """Return the spread between recordings and whether bias is possible of what base parameters are called."""
    values = zip(found.names, found.between.tolist(), found.biased.tolist(), strict=True)
    return {name: (between, biased) for name, between, biased in values}
