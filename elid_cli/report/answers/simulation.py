"""What ``elid simulate`` did: the log, the motion and the effects that acted."""

from __future__ import annotations

from typing import Any

from elid_cli.experiment.simulation import Simulation, SimulationOptions
from elid_cli.report.answers.inputs import command, heading, log_payload, recorded_items, robot_payload
from elid_cli.report.answers.missing import whose
from elid_cli.report.answers.summary import listed
from elid_cli.report.tree import Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, picked, warned
from elid_cli.robot.robot import EffectSpec, Robot

FOLLOWED = 0.1
"""Part of a joint's range by which it may be off its reference, rms."""


def simulation_report(robot: Robot, result: Simulation, options: SimulationOptions, robot_argument: str) -> Report:
    """Return the report of ``elid simulate``; `robot` with all effects that acted."""
    payload: dict[str, Any] = robot_payload(robot)
    payload["log"] = log_payload(result.recording)
    payload["simulation"] = {
        "seed": options.seed,
        "step": result.step,
        "control_period": result.period,
        "continuous": options.control.continuous,
        "feedforward": options.control.feedforward,
        "friction_width": options.friction_width,
        "sensors": options.sensors,
        "motion": dict(zip(robot.joint_names, result.facts, strict=True)),
    }
    payload["effects"] = [picked(spec, "effect joint parameters") for spec in robot.effects]
    sections: list[Section] = [
        heading(robot, result.recording),
        Text("answer", _answer(robot, result)),
        *warned(_lost(robot, result)),
        KeyValues("inputs", (*recorded_items(robot, result.recording), *_items(robot, result, options))),
        _motion_table(robot, result),
        Text("next", command("identify", result.recording, robot_argument), "next"),
    ]
    return Report("simulate", payload, tuple(sections))


def _answer(robot: Robot, result: Simulation) -> str:
    """Return what was simulated and how closely the joints follow, in a sentence."""
    size = f"{number_text(result.recording.duration, 3)} s at {number_text(result.recording.rate)} Hz"
    acting = listed(list(dict.fromkeys(whose(spec.effect, spec.joint) for spec in robot.effects)))
    worst = max(range(robot.n), key=lambda k: result.facts[k].tracking)
    off = f"{number_text(1e3 * result.facts[worst].tracking, 2)} m{robot.joints[worst].units[0]} (rms)"
    return (
        f"Simulated {size} of {robot.name}, {f'with {acting}' if acting else 'with no effect beyond its parameters'}; "
        f"the joints follow their reference to {off} or better."
    )


def _lost(robot: Robot, result: Simulation) -> list[str]:
    """Return which joints do not follow their reference: what their log shows is the controller's."""
    lost = [
        f"{joint.name} by {number_text(1e3 * facts.tracking, 2)} m{joint.units[0]} of {number_text(facts.range, 3)} "
        f"{joint.units[0]}"
        for joint, facts in zip(robot.joints, result.facts, strict=True)
        if facts.tracking > FOLLOWED * facts.range
    ]
    if not lost:
        return []
    return [
        f"the reference is not followed ({listed(lost)}, rms): the loop swings or its torque is at a limit; lower the "
        "gains (--kp, --kd) or the motion's speed"
    ]


def _items(robot: Robot, result: Simulation, options: SimulationOptions) -> tuple[tuple[str, str], ...]:
    held = f"held for {number_text(1e3 * result.period, 3)} ms, logged at its start"
    torque = "acts at every instant" if options.control.continuous else held
    scheme = "at most, exponential Runge-Kutta of order four" if result.exact_springs else "fourth-order Runge-Kutta"
    step = f"{number_text(1e6 * result.step, 3)} µs{' ' if result.exact_springs else ', '}{scheme}"
    effects = [("effect", _effect_text(spec)) for spec in robot.effects] or [("effects", "none")]
    return (("seed", str(options.seed)), ("step", step), ("torque", torque), *effects)


def _effect_text(spec: EffectSpec) -> str:
    values = ", ".join(f"{name} {number_text(value)}" for name, value in spec.parameters.items())
    return " ".join(part for part in (spec.effect, spec.joint or "", values) if part)


def _motion_table(robot: Robot, result: Simulation) -> Table:
    columns = (
        Column("joint", "joint"),
        *Column.numbers(
            range="range", speed="top speed", deflection="deflection", tau="torque rms", tracking="tracking rms"
        ),
    )
    rows = []
    for joint, facts in zip(robot.joints, result.facts, strict=True):
        length, force = joint.units
        deflection = Quantity(1e3 * facts.deflection if joint.elastic else None, f"m{length}", 3)
        rows.append(
            (
                joint.name,
                Quantity(facts.range, length, 3),
                Quantity(facts.speed, f"{length}/s", 3),
                deflection,
                Quantity(facts.tau, force, 3),
                Quantity(1e3 * facts.tracking, f"m{length}", 2),
            )
        )
    return Table("motion", columns, tuple(rows))
