"""What every report opens with: which robot, which logs, what was recorded and what was used of it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from elid_cli.logs.mapping.resolve import RATE
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.report.tree import Cell, KeyValues, Section, Text, number_text, picked
from elid_cli.robot.files import fingerprint
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import INERTIAL, MEASURED, Recording

Items = tuple[tuple[str, Cell], ...]
SIGNALS = (*MEASURED, *INERTIAL)


def robot_payload(robot: Robot) -> dict[str, Any]:
    """Return the keys of JSON that name the robot."""
    return {
        "robot": robot.name,
        "robot_fingerprint": fingerprint(robot),
        "robot_notes": list(robot.notes),
        "joints": list(robot.joint_names),
    }


def log_payload(recording: Recording) -> dict[str, Any]:
    """Return the object ``log`` of JSON."""
    means, way = recording.mean_temperatures(), None
    if recording.interpolated or recording.smooth is not None:
        way = "interpolated" if recording.interpolated else "smooth" if recording.smooth else "held"
    return {
        **picked(recording, "files sha256 samples duration rate"),
        "segments": len(recording.segments),
        **picked(recording, "sources repairs notes warnings"),
        **({"temperature": means} if means else {}),
        **({} if way is None else {"commands": way}),
    }


def heading(robot: Robot, recording: Recording | None = None) -> Text:
    """Return the first line of a report."""
    names = ", ".join(recording.files) if recording is not None else ""
    return Text("title", f"{robot.name} · {names}" if names else robot.name, "heading")


def recorded_items(robot: Robot, recording: Recording) -> Items:
    """Return what the logs hold and what was repaired."""
    computed = recording.commanded
    between = " (smooth between samples)" if recording.smooth else ""
    between = " (interpolated by the drives)" if recording.interpolated else between
    present = [name for name in SIGNALS if _has(recording, name) and not (name == "tau" and computed.all())]
    present += [f"commands{between}"] if computed.any() else []
    stretches = f" in {len(recording.segments)} segments" if len(recording.segments) > 1 else ""
    line = (
        f"{_value(recording.duration)} s at {_value(recording.rate)} Hz{stretches}, "
        f"{robot.n} joint{'s' * (robot.n != 1)}, {_listed(present)}"
    )
    items: list[tuple[str, Cell]] = [("recorded", line)]
    for label, sentences in (("repaired", recording.repairs), ("note", recording.notes)):
        items += [(label, sentence) for sentence in sentences]
    return (*items, *note_items(robot))


def note_items(robot: Robot) -> Items:
    """Return how the robot's file was read, where anything had to be decided."""
    return tuple(("note", sentence) for sentence in robot.notes)


def recording_sections(robot: Robot, recording: Recording) -> list[Section]:
    """Return a recording by itself."""
    facts = (*recorded_items(robot, recording), *(("warning", line) for line in recording.warnings))
    return [Text("title", ", ".join(recording.files) or "recording", "heading"), KeyValues("inputs", facts)]


def used_items(settings: Mapping[str, object]) -> Items:
    """Return how the signals were conditioned; every figure of it has an option."""
    facts = [f"{settings['instants']} samples at {_value(settings['rate'])} Hz",
             f"zero-phase low-pass {_value(settings['cutoff'])} Hz"]  # fmt: skip
    masked = _numbers(settings.get("masked"))
    if masked and max(masked) > 0:
        facts.append(f"reversals left out ({_span([100 * share for share in masked], 2)} %)")
    knots = _numbers(settings.get("knots"))
    items: list[tuple[str, Cell]] = [("used", ", ".join(facts))]
    if knots:
        velocity = "measured velocities too" if settings.get("velocity_used") else "positions only"
        items.append(("smoothing", f"quintic splines, knots every {_span([1e3 * k for k in knots], 3)} ms, {velocity}"))
    return tuple(items)


def effect_text(
    robot: Robot, effect: str, joint: str | None, values: Mapping[str, float], errors: Mapping[str, float]
) -> str:
    """Return an effect's parameters with units and standard errors: ``amplitude 0.25 ± 0.02 N·m, velocity …``."""
    kind = effect_classes().get(effect)
    slides = joint in robot.joint_names and not robot.joint(joint).revolute
    units = {} if kind is None else {p.name: p.unit_at(slides=slides) for p in (*kind.amplitudes, *kind.shapes)}
    parts = []
    for name, value in values.items():
        unit, scale = units.get(name, ""), 1.0
        if unit == "s" and abs(value) < 0.1:
            unit, scale = "ms", 1e3
        error = errors.get(name)
        spread = "" if error is None else f" ± {number_text(scale * error, resolution=scale * error)}"
        # beside values with errors a shape without one is no better known than they are
        number = number_text(scale * value, 3 if errors else 4, None if error is None else scale * error)
        parts.append(f"{name} {number}{spread} {unit}".rstrip())
    return ", ".join(parts)


def nuisance_items(robot: Robot, nuisances: Sequence[Any]) -> Items:
    """Return what of the measurement was estimated along and corrected, one line per kind."""
    kinds: dict[str, list[str]] = {}
    for n in nuisances:
        errors = n.std_error if nuisance_of(n.effect) == "delay" else {}
        doubt = " (may be biased)" if n.bias_possible else ""
        kinds.setdefault(n.effect, []).append(
            f"{n.joint} {effect_text(robot, n.effect, n.joint, n.parameters, errors)}{doubt}"
        )
    return tuple((kind.replace("_", " "), f"{'; '.join(found)}; corrected") for kind, found in kinds.items())


def nuisance_payload(nuisances: Sequence[Any]) -> list[dict[str, Any]]:
    """Return the list ``nuisances`` of JSON."""
    names = "effect joint parameters std_error"
    return [picked(n, f"{names} bias_possible" if getattr(n, "bias_possible", False) else names) for n in nuisances]


def span_words(spans: Sequence[tuple[float, float]]) -> str:
    """Return stretches of time in words: ``1.38 to 2.03 s, 4.01 to 4.65 s``."""
    return ", ".join(f"{number_text(a, 3)} to {number_text(b, 3)} s" for a, b in spans)


def command(verb: str, recording: Recording | None, robot: str, *options: str) -> str:
    """Return a command line to paste, which takes commands as they were taken."""
    files = recording.files if recording is not None else ("LOG",)
    smooth = ("--commands", "smooth") if recording is not None and recording.smooth else ()
    rates = recording is not None and recording.sources.get("dq_des") == RATE
    told = ("--map", f"dq_des={RATE}") if rates else ()
    return shlex.join(["elid", verb, *files, "--robot", robot, *options, *smooth, *told])


def fullest(written: Sequence[str]) -> str:
    """Return the robot file that holds most of what was found: the first YAML, else the first of all."""
    return next((path for path in written if not path.lower().endswith((".urdf", ".xml", ".mjcf"))), written[0])


def keeping(robot: Robot, word: str, effects: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the options that write what was found: as YAML, which holds all, and into the user's own URDF or MJCF.

    Parameters
    ----------
    robot
        As described.
    word
        What the files are called after the robot: ``refined``, say.
    effects
        Names of the effects that they are to hold. Those that neither format knows go into the file of actuators where
        that holds them all, else the second file is that of the fit without.
    """
    options: tuple[str, ...] = ("--write-robot", f"{robot.name}-{word}.yaml")
    if not robot.source:
        return options
    own = Path(robot.source)
    options += ("--write-robot", str(own.with_name(f"{own.stem}-{word}{own.suffix}")))
    kinds = [effect_classes()[name] for name in effects]
    if not kinds:
        return options
    held = all(kind.acts_as or kind.nuisance == "delay" for kind in kinds)
    return (*options, *(("--write-actuators", f"{robot.name}-{word}.json") if held else ("--drop-effects",)))


def _has(recording: Recording, name: str) -> bool:
    if name in recording.sources:
        return True
    values = recording.signal(name)
    return values is not None and not recording.sources and bool((values == values).any())


def _listed(names: Sequence[str]) -> str:
    return " and ".join(names)


def _numbers(values: object) -> list[float]:
    found = values if isinstance(values, list | tuple) else [values]
    return [float(v) for v in found if isinstance(v, int | float)]


def _span(values: Sequence[float], digits: int) -> str:
    low, high = number_text(min(values), digits), number_text(max(values), digits)
    return low if low == high else f"{low} to {high}"


def _value(value: object) -> str:
    return number_text(float(value), 4) if isinstance(value, int | float) else str(value)
