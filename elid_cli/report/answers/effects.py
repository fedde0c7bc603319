"""The library of effects as reports: a list, or one effect in full."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from elid_cli.model.effects import twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.report.tree import Column, KeyValues, Report, Table, Text, picked

WHERE = {
    "motor": "motor side", "link": "link side", "spring": "transmission: link and motor side",
    "chain": "links of the whole chain", "torque": "torque signal", "encoder": "position signals",
    "sensor": "joint torque sensor",
}  # fmt: skip


def effects_report(library: Mapping[str, type[Effect]]) -> Report:
    """Return the list of effects."""
    columns = Column.texts(effect="effect", summary="what it is", twins="easily confused with")
    rows = tuple((name, kind.summary, ", ".join(twins_of(kind))) for name, kind in library.items())
    return Report(
        command="effects",
        payload={"effects": [_payload(kind) for kind in library.values()]},
        sections=(
            Text("title", f"{len(library)} effect{'s' * (len(library) != 1)} that a model may lack", "heading"),
            Table("effects", columns, rows),
            Text("next", "elid effects NAME", "next"),
        ),
    )


def effect_report(kind: type[Effect]) -> Report:
    """Return one effect in full: what it is, how it shows, what to record to see it."""
    facts = (
        ("equation", kind.equation),
        ("acts on", WHERE.get(kind.place, kind.place)),
        ("physics", kind.physics),
        ("typical", kind.typical),
        ("residual", kind.fingerprint),
        ("confused with", ", ".join(twins_of(kind)) or "nothing"),
        ("record", kind.record),
    )
    columns = Column.texts(parameter="parameter", unit="unit", meaning="meaning")
    parameters = tuple((p.name, p.unit, p.meaning) for p in (*kind.amplitudes, *kind.shapes))
    where = "" if kind.whole_robot else ", joint: joint1"
    values = ", ".join(f"{p.name}: …" for p in (*kind.amplitudes, *kind.shapes))
    return Report(
        command="effects",
        payload={"effects": [_payload(kind)]},
        sections=(
            Text("title", f"{kind.name} · {kind.summary}", "heading"),
            KeyValues("facts", facts),
            Table("parameters", columns, parameters),
            Text("declare", f"effects:\n  - {{effect: {kind.name}{where}, parameters: {{{values}}}}}", "code"),
        ),
    )


def _payload(kind: type[Effect]) -> dict[str, Any]:
    return {
        "effect": kind.name,
        **picked(kind, "summary equation place physics typical fingerprint record"),
        "twins": list(twins_of(kind)),
        "parameters": [
            {**picked(p, "name unit meaning"), "kind": "amplitude" if p in kind.amplitudes else "shape"}
            for p in (*kind.amplitudes, *kind.shapes)
        ],
    }
