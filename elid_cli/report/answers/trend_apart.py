"""What ``elid trend`` says of recordings that stand out: which, in what, and by how much."""

from __future__ import annotations

from typing import Any

from elid_cli.estimation.trend.apart import StandsOut
from elid_cli.estimation.trend.trends import Trends
from elid_cli.report.answers.summary import called, listed, signed_share
from elid_cli.report.tree import Cell, Column, Folded, Quantity, Section, Table, number_text, picked

NAMED = 3
"""Parameters of a recording that a sentence names."""
SHOWN = 10


def standing_out_words(found: Trends) -> str:
    """Return which recordings stand out, in sentences; empty where none does."""
    if not found.stands_out:
        return ""
    said = [f"{found.files[item.number]} in {_parameters(item, len(found.trends))}." for item in found.stands_out]
    newest = found.stands_out[-1].number == len(found.files) - 1
    cause = "Either the machine changed at once before it" if newest else "Either the machine was changed for it"
    cause += ", or it is of another robot, load or setup."
    return f"{' '.join(said)} {cause} All that follows is of the other {len(found.files) - len(said)} recordings."


def _parameters(item: StandsOut, every: int) -> str:
    names = [f"{called(d.name)} {_by(item, k)}" for k, d in enumerate(item.parameters[:NAMED])]
    count = len(item.parameters)
    if count > NAMED:
        return f"{count} of {every} parameters ({', '.join(names)} …)"
    return listed(names)


def outlying_words(found: Trends) -> list[str]:
    """Return a phrase on every recording that stands out: its name, and where it does so first."""
    return [
        f"{found.files[item.number]} stands out ({called(item.parameters[0].name)} {_by(item, 0)}"
        f"{f' and {len(item.parameters) - 1} more' if len(item.parameters) > 1 else ''})"
        for item in found.stands_out
    ]


def _by(item: StandsOut, k: int) -> str:
    d = item.parameters[k]
    return change_words(d.value - d.expected, d.expected, d.unit)


def change_words(size: float, before: float, unit: str) -> str:
    """Return a change as a share of what was before; as it is where that was about nothing."""
    if abs(before) > 0.1 * abs(size):
        return signed_share(size / abs(before))
    return f"{number_text(size, 2)} {unit}"


def standing_out_entries(found: Trends) -> list[dict[str, Any]]:
    """Return the entries of ``stands_out`` in JSON."""
    return [
        {
            "file": found.files[item.number],
            "parameters": [picked(d, "name unit value expected deviations") for d in item.parameters],
        }
        for item in found.stands_out
    ]


def standing_out_table(found: Trends) -> list[Section]:
    """Return in which parameters recordings stand out, as a table; none where none does."""
    columns = (
        Column("name", "base parameter", span=True),
        *Column.numbers(value="it says", expected="others say", change="change", deviations="in sd"),
        *Column.texts(unit="unit"),
    )
    tables: list[Section] = []
    for item in found.stands_out:
        rows: list[tuple[Cell, ...]] = [
            (
                Folded(d.name, called(d.name)),
                Quantity(d.value),
                Quantity(d.expected),
                _by(item, k),
                Quantity(d.deviations, digits=2),
                d.unit,
            )
            for k, d in enumerate(item.parameters)
        ]
        title = f"{found.files[item.number]}: where it stands out"
        tables.append(Table(f"stands_out{item.number}", columns, tuple(rows), title=title, shown=SHOWN))
    return tables
