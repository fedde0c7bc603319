"""The answer of ``elid excite --show-stiffness``: the multisine, the limits it uses, what to do with the log."""

from __future__ import annotations

from typing import Any

from elid_cli.experiment.stiffness_motion import LOWEST, StiffnessMotion
from elid_cli.model.antiresonance import log_rate
from elid_cli.report.answers.excitation import limits_payload, trial_command, use_of_limits
from elid_cli.report.answers.inputs import heading, robot_payload
from elid_cli.report.tree import Cell, Column, KeyValues, Quantity, Report, Section, Table, Text, number_text, picked


def stiffness_motion_report(found: StiffnessMotion, robot_argument: str, file: str, rate: float) -> Report:
    """Return the report of one motion, written to `file` at `rate` samples per second."""
    logged = f"{log_rate(found.top):.0f}"
    facts: tuple[tuple[str, Cell], ...] = (
        ("motion", f"{number_text(found.duration)} s, slow and wide, all joints, from rest to rest"),
        ("multisine", f"{number_text(LOWEST)} to {number_text(found.top, 3)} Hz on top, lines of equal acceleration"),
        ("written", f"{file}, {number_text(rate)} Hz: t, q, dq, ddq of every joint"),
        ("needs", f"a drive that follows ddq (inertia times ddq fed forward); a log of motor position and torque at "
                  f"{logged} Hz"),
    )  # fmt: skip
    following = trial_command(found.robot, robot_argument, file, "--rate", logged, log="try.h5")
    sections: list[Section] = [
        heading(found.robot),
        KeyValues("facts", facts),
        _multisines(found),
        use_of_limits(found.robot, found.used),
        Text("next", following, "next"),
    ]
    return Report("excite", stiffness_motion_payload(found, file=file, rate=rate), tuple(sections))


def _multisines(found: StiffnessMotion) -> Table:
    columns = (
        Column("joint", "joint"),
        Column("antiresonance", "antiresonance up to", "Hz", "right"),
        Column("from", "from"),
        *Column.numbers(acceleration="multisine, rms", torque="as torque, rms"),
    )
    rows: list[tuple[Cell, ...]] = []
    for shown in found.shown:
        joint = found.robot.joints[shown.joint]
        length, torque = joint.units
        rows.append((
            joint.name, Quantity(shown.antiresonance, digits=3), "told" if shown.told else "K of the file",
            Quantity(shown.acceleration, f"{length}/s²", digits=2), Quantity(shown.torque, torque, digits=2),
        ))  # fmt: skip
    return Table("multisines", columns, tuple(rows), title="stiffnesses that the motion is to show")


def stiffness_motion_payload(found: StiffnessMotion, **written: str | float) -> dict[str, Any]:
    """Return the JSON object of a motion; `written` is its file and rate."""
    names = found.robot.joint_names
    return {
        **robot_payload(found.robot),
        "trajectory": {**written, "duration": found.duration},
        "show_stiffness": {
            names[shown.joint]: picked(shown, "antiresonance told acceleration torque")
            for shown in found.shown
        },
        "top": found.top,
        "limits_used": limits_payload(found.robot, found.used),
    }  # fmt: skip
