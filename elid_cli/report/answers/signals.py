"""Prepared signals by themselves: what is used of a log, how it was smoothed, and the noise of each channel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from elid_cli.report.answers.inputs import Items, recorded_items, used_items
from elid_cli.report.answers.summary import listed
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Section, Table, Text
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.motion import STATES
from elid_cli.signals.signals import Signals

CHANNELS = ("q", "theta", "tau", "tau_link")
NOTE = "standard deviations at the joint: rad (m) of positions, N·m (N) of torques; –: not logged"


def signals_sections(signals: Signals) -> list[Section]:
    """Return what is used of a log, and a table of what the noise of its channels is."""
    recording = signals.recording
    files = () if recording is None else recording.files
    robot = Robot("log", tuple(Joint(name) for name in signals.joints))
    facts: Items = (
        *(() if recording is None else recorded_items(robot, recording)),
        *used_items(_settings(signals)),
        *((("at rest", listed(_still(signals))),) if signals.still.any() else ()),
        *(("note", sentence) for sentence in signals.notes),
        *(("warning", sentence) for sentence in (() if recording is None else recording.warnings)),
    )
    return [Text("title", ", ".join(files) or "signals", "heading"), KeyValues("inputs", facts), _table(signals)]


def signals_payload(signals: Signals) -> dict[str, Any]:
    """Return how the signals were made, and the noise of each channel, in JSON's types."""
    return {
        "joints": list(signals.joints),
        "files": [] if signals.recording is None else list(signals.recording.files),
        "duration": signals.duration,
        **_settings(signals),
        "still": _still(signals),
        "noise": {
            joint: {name: values[k] for name, values in _noise(signals).items()}
            for k, joint in enumerate(signals.joints)
        },
        "notes": list(signals.notes),
    }


def signals_columns(signals: Signals) -> Mapping[str, Any]:
    """Return columns ``t``, ``q.<joint>``, ``dq.<joint>`` and so on: the smooth motion, and the torque as it was."""
    held = {name: getattr(signals.motion, name) for name in STATES}
    held |= {"tau": signals.tau, **({} if signals.tau_link is None else {"tau_link": signals.tau_link})}
    columns = {f"{name}.{joint}": v[:, k] for name, v in held.items() for k, joint in enumerate(signals.joints)}
    return {"t": signals.motion.t, **columns}


def _settings(signals: Signals) -> dict[str, Any]:
    return {
        "instants": int(signals.outputs.size),
        "rate": signals.rate,
        "cutoff": signals.filter.cutoff,
        "knots": [float(spacing) for spacing in signals.knots],
        "velocity_used": bool(signals.velocity_used.any()),
    }


def _still(signals: Signals) -> list[str]:
    return [name for name, still in zip(signals.joints, signals.still.tolist(), strict=True) if still]


def _noise(signals: Signals) -> dict[str, list[float]]:
    held = {name: getattr(signals.noise, name) for name in CHANNELS}
    return {name: [float(value) for value in values] for name, values in held.items() if values.size}


def _table(signals: Signals) -> Table:
    noise = _noise(signals)
    rows: list[tuple[Cell, ...]] = [
        (joint, *(Quantity(values[k], digits=2) for values in noise.values())) for k, joint in enumerate(signals.joints)
    ]
    columns = (Column("joint", "joint"), *Column.numbers(**{name: name for name in noise}))
    return Table("noise", columns, tuple(rows), title="noise of each channel", note=NOTE)
