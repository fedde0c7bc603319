"""The answer of ``elid init``: what was written beside a URDF or MJCF, and what nobody could say."""

from __future__ import annotations

import shlex
from typing import Any

from elid_cli.report.tree import Cell, KeyValues, Report, Section, Text, picked
from elid_cli.robot.completion import Completion
from elid_cli.robot.files import fingerprint
from elid_cli.robot.robot import Robot


def completion_report(robot: Robot, known: Completion, robot_argument: str, file: str) -> Report:
    """Return the report of a completion.

    Parameters
    ----------
    robot
        As its own file describes it.
    known
        What was written.
    robot_argument, file
        The robot as the user named it, and the file that was written.
    """
    questions = known.open_questions(robot)
    payload: dict[str, Any] = {
        "robot": robot.name,
        "robot_fingerprint": fingerprint(robot),
        "joints": list(robot.joint_names),
        "file": file,
        **picked(known, "tip lock gear_ratios transmissions"),
        "signals": {**known.found, **{signal: str(spec.get("from", "")) for signal, spec in known.log.items()}},
        **picked(known, "guesses missing absent"),
        "open": list(questions),
    }
    facts: list[tuple[str, Cell]] = [("joints", ", ".join(robot.joint_names))]
    facts += [("tip", known.tip)] if known.tip else []
    facts += [("locked", ", ".join(f"{n} at {v:g}" for n, v in known.lock.items()))] if known.lock else []
    facts += [("not in the log", ", ".join(known.absent))] if known.absent else []
    facts += [(signal, place) for signal, place in payload["signals"].items()]
    facts += [("not known", question) for question in questions]
    sections: tuple[Section, ...] = (
        Text("title", f"{file}: beside {robot_argument}", "heading"),
        KeyValues("facts", tuple(facts)),
        Text("next", _next(known, robot_argument, file), "next"),
    )
    return Report("init", payload, sections)


def _next(known: Completion, robot: str, file: str) -> str:
    log = known.logged or "LOG"
    if known.guesses or known.missing:
        return shlex.join(["elid", "info", log, "--robot", robot]) + f"   # then complete {file}"
    gains = ["--kp", "GAIN", "--kd", "GAIN"] if known.gains_missing else []
    return shlex.join(["elid", "identify", log, "--robot", robot, *gains])
