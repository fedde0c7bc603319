"""Identify the base parameters from logs, with their uncertainty and the torque they predict."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.commands import options
from elid_cli.commands.group import verb
from elid_cli.commands.options import Conditioning, Fit, Gates, Output, Reading

if TYPE_CHECKING:
    from elid_cli.identification import Identification
    from elid_cli.robot import Robot


@verb(
    "elid identify run07.mcap --robot puma560",
    "elid identify *.mcap --robot puma560 --write-robot mine.yaml --report report.html",
)
@options.logs()
@options.robot
@options.reading
@options.conditioning
@options.fit
@options.option(options.FIT, "--physical", is_flag=True,
                help="Also find all parameters of a robot that could be built, what the log leaves open from the robot "
                     "file; --write-robot then writes them.")
@options.gates
@options.write_robot
@options.output
def identify(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    conditioning: Conditioning,
    fit: Fit,
    physical: bool,
    gates: Gates,
    write_robot: str | None,
    output: Output,
) -> None:
    """Identify the base parameters of a robot from one or more logs: values, standard errors, comparison with the
    robot file, and the torque error per joint on stretches that the fit never saw.
    """  # noqa: D205
    from dataclasses import replace
    from pathlib import Path

    from elid_cli.atomic import check_writable
    from elid_cli.commands.emit import check_output, emit, pictures_wanted
    from elid_cli.commands.gates import check_gates, check_names
    from elid_cli.commands.inputs import load_recording, load_signals
    from elid_cli.commands.progress import progress

    check_output(output)
    if physical:
        from elid_cli.semidefinite import need_solver

        need_solver()
    if write_robot is not None:
        check_writable(Path(write_robot))
    with progress(output, "reading") as advance:
        from elid_cli import estimate, robot_file
        from elid_cli.by_log import errors_by_log
        from elid_cli.reports.identification import identification_report

        machine = robot_file.read_robot(robot)
        check_names(gates, machine.parameter_names())
        recording = load_recording(logs, machine, reading, output, conditioning.rate)
        signals = load_signals(recording, machine, conditioning, advance)
        choice = estimate.EstimateOptions(estimator=fit.estimator, accurate=fit.accurate)
        found = estimate.identify(machine, signals, choice)
        refined = _refined(found)
        logs_apart = errors_by_log(refined, signals, recording.files)
        report = identification_report(found, recording, robot, logs_apart)
        if pictures_wanted(output):
            from elid_cli.reports.figures import identification_figures, with_figures

            report = with_figures(report, identification_figures(found, refined, signals))
        if physical:
            from elid_cli.physical import make_physical
            from elid_cli.reports.physical import with_physical

            built = make_physical(found)
            report = with_physical(report, built, found.base)
            refined = replace(refined, joints=built.refined_robot().joints)
    if write_robot is not None:
        robot_file.write_robot(refined, write_robot)
    emit(report, output)
    check_gates(gates, found.error, found.this_log)


def _refined(found: Identification) -> Robot:
    """Return the robot with what was found: values nearest to its own, nuisances as effects of the measurement."""
    from elid_cli.refined import refined_robot, representative
    from elid_cli.robot import EffectSpec

    standard = representative(found.base, found.base.transform @ found.standard, found.robot.reference())
    new = [
        *(EffectSpec(e.effect, e.joint, e.parameters) for e in found.effects),
        *(EffectSpec(n.effect, n.joint, n.parameters) for n in found.nuisances),
    ]
    replaced = {(spec.effect, spec.joint) for spec in new}
    kept = [spec for spec in found.robot.effects if (spec.effect, spec.joint) not in replaced]
    return refined_robot(found.robot, standard, (*kept, *new))
