"""The answer of ``elid excite``: how far the trajectory goes, and what a log of it will show."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from elid_cli._types import Array
from elid_cli.experiment.excitation import Excitation
from elid_cli.experiment.resolve import Resolution
from elid_cli.report.answers.inputs import heading, robot_payload
from elid_cli.report.answers.summary import listed
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, percent
from elid_cli.robot.robot import Robot

SHOWN = 20


def excitation_report(found: Excitation, robot_argument: str, file: str, rate: float) -> Report:
    """Return the report of one trajectory, written to `file` at `rate` samples per second."""
    e, r = found.evaluation, found.random
    facts: tuple[tuple[str, Cell], ...] = (
        ("trajectory", f"{number_text(found.trajectory.duration)} s, quintic splines, from rest to rest"),
        ("written", f"{file}, {number_text(rate)} Hz: t, q, dq, ddq of every joint"),
        (
            "condition",
            f"{number_text(e.condition, 3)}; of random splines as long {number_text(r.condition, 3)}",
        ),
        ("standard errors", f"{_times(found.gain)} than after random splines (geometric mean)"),
        ("assumed", _assumed(found)),
        *_guessed(found),
        *((("aimed at", ", ".join(found.options.aims)),) if found.options.aims else ()),
    )
    sections: list[Section] = [
        heading(found.robot),
        Text("answer", _answer(found)),
        KeyValues("facts", facts),
        limits_table(found),
        expected_table(found),
        Text("next", trial_command(found.robot, robot_argument, file), "next"),
    ]  # fmt: skip
    return Report("excite", excitation_payload(found, file=file, rate=rate), tuple(sections))


def _answer(found: Excitation) -> str:
    """Return what the motion is worth, in a sentence."""
    length = number_text(found.trajectory.duration)
    if found.gain < 1:
        return (
            f"A motion of {length} s within the limits; for the parameters it is no better than random motion as long."
        )
    return (
        f"A motion of {length} s within the limits. Its log will show the parameters with standard errors "
        f"{_times(found.gain)} than random motion as long (geometric mean)."
    )


def trial_command(robot: Robot, argument: str, file: str, *options: str, log: str = "try.mcap") -> str:
    """Return the command to try a motion with, or what to do where too little is known of the robot to simulate."""
    from elid_cli.model.dynamics import unknown_parameters
    from elid_cli.model.regressor import Regressor
    from elid_cli.robot.ideal import DRIVE

    missing = unknown_parameters(Regressor(robot), robot.reference())
    simulate = ["elid", "simulate", "--robot", argument, "--reference", file, *options, "-o", log]
    if all(name.kind in DRIVE and not robot.elastic[name.joint] for name in missing):
        return shlex.join([*simulate, *(["--ideal-drives"] if missing else [])])
    return f"move the robot along {file} and record it, then: elid identify LOG --robot {shlex.quote(argument)}"


def _times(gain: float) -> str:
    return f"{number_text(gain, 3)} times smaller" if gain >= 1 else f"{number_text(1 / gain, 3)} times larger"


def _assumed(found: Excitation) -> str:
    if found.options.measured is None:
        return f"residuals of {number_text(100 * found.options.residual, 2)} % of each torque after filtering"
    return "residuals as in the last log"


def _guessed(found: Excitation) -> tuple[tuple[str, Cell], ...]:
    """Return which of the parameters that matter had to be guessed."""
    acting, unknown = found.unknown
    taken = ((("guessed", f"{listed(found.massless)}: 0 in the robot file, those of a typical arm are taken, since "
               "without mass a body's load looks like its rotor's"),) if found.massless else ())  # fmt: skip
    if not unknown:
        return taken
    words = (
        f"{unknown} of {acting} parameters that act on the torques are not in the robot file: those of a typical arm "
        "are taken, so torques and errors below are rough"
    )
    return (*taken, ("guessed", words))


def limits_table(found: Excitation | Resolution) -> Table:
    """Return how much of every limit the trajectory uses."""
    return use_of_limits(found.robot, found.used)


def use_of_limits(robot: Robot, used: Mapping[str, Array]) -> Table:
    """Return how much of every limit a motion uses, shares by kind, (n,) each; NaN where there is no limit."""
    columns = [Column("joint", "joint")]
    columns += [Column(kind, kind, "% of limit", "right") for kind in used]
    rows: list[tuple[Cell, ...]] = []
    for k, joint in enumerate(robot.joint_names):
        rows.append((joint, *(Quantity(100 * float(share[k]), digits=3) for share in used.values())))
    note = "limits that the robot file does not give are elid's defaults; –: no limit"
    return Table("limits", tuple(columns), tuple(rows), title="use of the limits", note=note)


def limits_payload(robot: Robot, used: Mapping[str, Array]) -> dict[str, dict[str, float]]:
    """Return the object ``limits_used`` of JSON."""
    return {joint: {kind: share[k] for kind, share in used.items()} for k, joint in enumerate(robot.joint_names)}


def expected_table(found: Excitation) -> Table:
    """Return the standard errors to expect, those aimed at where there are aims."""
    columns = (
        Column("name", "base parameter"),
        *Column.numbers(std_error="expected ± sd", relative="rel", random="random splines ± sd"),
        Column("unit", "unit"),
    )
    rows: list[tuple[Cell, ...]] = []
    relative = found.relative
    aimed = set(found.options.aims)
    for k, name in enumerate(found.base.names):
        if aimed and not aimed & set(found.base.terms[k]):
            continue
        rows.append((
            name, Quantity(float(found.std_error[k]), digits=2), percent(float(relative[k]), 2),
            Quantity(float(found.random_std_error[k]), digits=2), found.base.units[k],
        ))  # fmt: skip
    return Table("std_error", columns, tuple(rows), title="what a log of it will show", shown=SHOWN)


def excitation_payload(found: Excitation, **written: str | float) -> dict[str, Any]:
    """Return the JSON object of a trajectory; `written` is its file and rate, where there is one."""
    relative = found.relative
    return {
        **robot_payload(found.robot),
        "trajectory": {**written, "duration": found.trajectory.duration},
        "aims": list(found.options.aims),
        "residual": found.options.residual,
        "condition": found.evaluation.condition,
        "log_det": found.evaluation.log_det,
        "random": {"condition": found.random.condition, "log_det": found.random.log_det},
        "limits_used": limits_payload(found.robot, found.used),
        "base_parameters": [
            {"name": name, "terms": dict(found.base.terms[k]), "unit": found.base.units[k],
             "std_error": found.std_error[k], "relative_std_error": relative[k]}
            for k, name in enumerate(found.base.names)
        ],
    }  # fmt: skip
