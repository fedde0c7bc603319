"""Parameter sets as tables, and their ranges."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from elid_cli.estimation.sampling.sets import ParameterSets
from elid_cli.files import replacing, write_text
from elid_cli.robot.yaml import inline, quoted

TABLES = (".csv", ".json", ".npz")
"""Suffixes of tables of sets, the usual one first."""
RANGES = (".yaml", ".yml")


def write_csv(sets: ParameterSets, path: str | Path) -> None:
    """Write a set a line, a parameter a column, in full precision; nothing stands for what nobody knows."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(sets.names)
    writer.writerows([["" if np.isnan(v) else repr(v) for v in row] for row in sets.values.tolist()])
    write_text(path, text.getvalue())


def write_npz(sets: ParameterSets, path: str | Path) -> None:
    """Write the arrays ``values`` (N, p), ``names``, ``units`` and ``origin`` (p,)."""
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez(
            file, values=sets.values, names=np.array(sets.names), units=np.array(sets.units),
            origin=np.array(sets.origin),
        )  # fmt: skip


def write_ranges(sets: ParameterSets, path: str | Path) -> None:
    """Write the range of every parameter as YAML: the middle 95 % of the sets."""
    low, high = sets.bounds
    files = ", ".join(inline(name) for name in sets.distribution.files)
    lines = [
        f"# {len(sets.values)} sets drawn by elid sample from {files}, seed {sets.seed}; SI units at the joint.",
        "# low and high hold the middle 95 % of the sets. Ranges lose what parameters have in common: values drawn",
        "# from them one by one are combinations that the logs refute. The sets themselves keep it.",
        "# origin: drawn; split (member of a sum that was drawn); held (at the reference: no log shows it).",
        f"robot: {quoted(sets.distribution.robot)}",
        "parameters:",
    ]
    mean, spread = sets.spread
    for k, name in enumerate(sets.names):
        if sets.origin[k] == "unknown":
            continue
        entry = {"low": float(low[k]), "high": float(high[k]), "mean": float(mean[k]), "std": float(spread[k]),
                 "unit": sets.units[k], "origin": sets.origin[k]}  # fmt: skip
        lines.append(f"  {quoted(name)}: {inline(entry)}")
    write_text(path, "\n".join(lines) + "\n")
