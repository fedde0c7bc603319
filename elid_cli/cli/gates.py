"""Limits that a CI job sets: checked after the report is out, so that it is always printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from elid_cli.cli.options import Gates, Output
from elid_cli.cli.output import LimitError, note
from elid_cli.errors import UsageError, did_you_mean
from elid_cli.report.tree import Report, Text
from elid_cli.robot.parameter import StandardParameter

if TYPE_CHECKING:
    from elid_cli.estimation.judgement import Insufficient, JointError, RowNoise
    from elid_cli.estimation.result import Identification
    from elid_cli.robot.robot import Robot


def check_names(gates: Gates, robot: Robot) -> None:
    """Refuse, before any work on the log, a required parameter that the robot does not have (UsageError)."""
    names = robot.parameter_names()
    rigid = {str(StandardParameter("K", k)): joint.name for k, joint in enumerate(robot.joints) if not joint.elastic}
    for name in gates.require_independent:
        if name in rigid:
            raise UsageError(
                f"--require-independent: no parameter {name!r}: {rigid[name]} of {robot.name!r} is declared rigid",
                hint=f"set 'transmission: elastic' of {rigid[name]} {robot.place_to_say} if its transmission bends",
            )
        if name not in names:
            raise UsageError(f"--require-independent: no parameter {name!r}", hint=did_you_mean(name, names))


def motor_rows_told(report: Report, gates: Gates, error: Mapping[str, JointError], output: Output) -> Report:
    """Return the report with a warning of every joint whose motor row is above ``--max-error`` by noise alone.

    No limit is broken by it: the whole model keeps the limit, and no other one would leave less there.
    """
    from elid_cli.report.answers.summary import only_noise

    limit = gates.max_error
    if limit is None:
        return report
    said = [
        f"{joint}: the motor side, {100 * e.spring_relative:.3g} %, exceeds --max-error {100 * limit:.3g} % by the "
        f"noise of the encoders alone; the error of the whole joint, {100 * e.relative:.3g} %, does not"
        for joint, e in error.items()
        if e.spring_relative is not None and limit < e.spring_relative and only_noise(e, limit)
    ]
    note(said, output, "warning")
    warnings = [Text(f"motor_row{k}", line, "warning") for k, line in enumerate(said)]
    last = [section for section in report.sections if isinstance(section, Text) and section.role == "next"]
    rest = [section for section in report.sections if section not in last]
    return replace(report, sections=(*rest, *warnings, *last))


def check_gates(
    gates: Gates,
    error: Mapping[str, JointError] | None = None,
    classes: Mapping[str, str] | None = None,
    found: Identification | None = None,
    broken: Sequence[str] = (),
) -> None:
    """Raise `LimitError` where a limit is broken: joints above ``--max-error``, parameters not independent.

    `broken` are limits that the caller found broken.
    """
    broken = [*broken_gates(gates, error, classes), *(_lacking(gates, found) if found else ()), *broken]
    if broken:
        raise LimitError("; ".join(broken))


def _lacking(gates: Gates, found: Identification) -> list[str]:
    """Return the limits that an insufficient model breaks, in words."""
    broken = [
        f"{item.leader}: may be biased, the model is insufficient"
        for item in found.parameters
        if item.bias_possible and item.leader in gates.require_independent
    ]
    by_rows = lacking(gates, found.insufficient, found.noise)
    if gates.fail_on_insufficient and not by_rows and found.model == "insufficient":  # by the simulated motion
        from elid_cli.report.answers.lacking import words_of

        by_rows = [f"the model is insufficient: {words_of(found)}"]
    return [*broken, *by_rows]


def lacking(gates: Gates, insufficient: Sequence[Insufficient], noise: Sequence[RowNoise]) -> list[str]:
    """Return the limit that rows break whose residual follows the motion, or is far above the noise, in words."""
    from elid_cli.report.answers.lacking import is_unclear, rows_words

    if not gates.fail_on_insufficient:
        return []
    if insufficient:
        return [f"the model is insufficient: {rows_words(insufficient)}"]
    if not is_unclear(noise):
        return []
    loud = max(noise, key=lambda item: item.ratio)
    return [
        f"it is not clear that the model suffices: {loud.ratio:.2g} times the sensors' noise is left at {loud.joint}"
    ]


def broken_gates(
    gates: Gates, error: Mapping[str, JointError] | None = None, classes: Mapping[str, str] | None = None
) -> list[str]:
    """Return the limits that are broken, in words."""
    broken: list[str] = []
    if gates.max_error is not None and error is not None:
        broken += _too_large(gates.max_error, error)
    if classes is not None:
        broken += [
            f"{name}: {classes[name]}, not independent"
            for name in gates.require_independent
            if classes[name] != "independent"
        ]
    return broken


def _too_large(limit: float, error: Mapping[str, JointError]) -> list[str]:
    """Return which joints are above ``--max-error``, in words: by the error that the report's first answer names."""
    from elid_cli.estimation.judgement import EQUATIONS
    from elid_cli.report.answers.summary import largest_share, only_noise

    broken = []
    for joint, e in error.items():
        share, row = largest_share(e)
        if not share <= limit and not only_noise(e, limit):
            where = f" ({EQUATIONS[row]})" if row != "sum" else ""
            broken.append(f"{joint}: torque error {100 * share:.3g} %{where} exceeds --max-error {100 * limit:.3g} %")
    return broken
