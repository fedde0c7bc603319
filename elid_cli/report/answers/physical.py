"""What ``--physical`` adds to the report of an identification: a full parameter set, and what it cost."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    Tone,
    number_text,
    picked,
)

if TYPE_CHECKING:
    from elid_cli.estimation.physical.nearest import PhysicalParameters
    from elid_cli.model.base_parameters import BaseParameters

SHOWN = 28
"""Standard parameters printed without --all."""
TONES: dict[str, Tone] = {"data": "good", "split": "plain", "reference": "dim", "assumed": "warn"}
NOTE = (
    "data: the log determines it; split: the log determines the combination that it is in, the reference value the "
    "share; reference: the log says nothing, so the robot file's value, or the nearest that a real body can have; "
    "assumed: neither says anything"
)


def with_physical(report: Report, physical: PhysicalParameters, base: BaseParameters) -> Report:
    """Return the report of an identification with its physical parameters, before the closing next command."""
    sections = list(report.sections)
    place = next((k for k, section in enumerate(sections) if section.key in ("meaning", "next")), len(sections))
    sections[place:place] = physical_sections(physical, base)
    payload = {**report.payload, "physical": physical_payload(physical, base)}
    return replace(report, payload=payload, sections=tuple(sections))


def physical_sections(physical: PhysicalParameters, base: BaseParameters) -> list[Section]:
    """Return the sections on a physical parameter set."""
    items: list[tuple[str, Cell]] = [
        ("given up", f"held-out error {_signed(100 * physical.loss)} % over all joints, worst joint "
                     f"{_signed(100 * max(physical.rises.values(), default=0.0))} %; chi² "
                     f"{number_text(physical.chi2_before, 4)} to {number_text(physical.chi2_after, 4)}"),
        *(
            ("was impossible", f"{i.name} = {number_text(i.estimate, 3)} ± {number_text(i.std_error, 2)}, "
                               f"now {number_text(i.value, 3)}")
            for i in physical.impossible
        ),
        *(("moved", f"{name} by {_signed(z)} sd") for name, z in physical.moved_far(base.names)),
    ]  # fmt: skip
    sections: list[Section] = [KeyValues("physical", tuple(items), "physical parameters"), _table(physical)]
    if physical.contradiction:
        sections.append(
            Text("contradiction", "the data contradict a physical robot: the model lacks an effect (elid diagnose), or "
                 "signs, units, gear ratios or gravity are wrong", "warning")
        )  # fmt: skip
    return sections


def physical_payload(physical: PhysicalParameters, base: BaseParameters) -> dict[str, Any]:
    """Return the JSON object ``physical``."""
    names = physical.robot.parameter_names()
    return {
        "parameters": dict(zip(names, physical.values, strict=True)),
        "origin": dict(zip(names, physical.origin, strict=True)),
        "base_parameters": dict(zip(base.names, physical.base, strict=True)),
        "moved": dict(zip(base.names, physical.moved, strict=True)),
        "impossible": [picked(i, "name estimate std_error value") for i in physical.impossible],
        "chi2": {"before": physical.chi2_before, "after": physical.chi2_after},
        "loss": physical.loss,
        "error": {joint: picked(e, "rms relative") for joint, e in physical.error_after.items()},
        "contradiction": physical.contradiction,
    }


def _table(physical: PhysicalParameters) -> Table:
    columns = (
        Column("name", "parameter"), Column("value", "value", align="right"), Column("unit", "unit"),
        Column("reference", "reference", align="right"), Column("origin", "decided by"),
    )  # fmt: skip
    robot = physical.robot
    rows: list[tuple[Cell, ...]] = [
        (name, Quantity(float(value)), unit, Quantity(float(reference)), Mark(origin, TONES[origin]))
        for name, value, unit, reference, origin in zip(
            robot.parameter_names(), physical.values, robot.parameter_units(), robot.reference(), physical.origin,
            strict=True,
        )
    ]  # fmt: skip
    return Table("physical_parameters", columns, tuple(rows), title="a robot that could be built", shown=SHOWN,
                 note=NOTE)  # fmt: skip


def _signed(value: float) -> str:
    text = number_text(value, 2)
    return f"+{text}" if value > 0 else text
