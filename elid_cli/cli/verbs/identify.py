"""Identify the base parameters from logs, with their uncertainty and the torque they predict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot, log_request, samples_of
from elid_cli.cli.options import Files, Gates, Output, Source, Spread

if TYPE_CHECKING:
    from elid_cli.estimation.identify import Identified
    from elid_cli.estimation.request import LogRequest
    from elid_cli.estimation.result import EstimateOptions, Identification
    from elid_cli.robot.robot import Payload, Robot


@dataclass(frozen=True)
class Beyond:
    """What is found beside the base parameters."""

    physical: bool = False
    payload: tuple[Payload | None] | None = None


@verb(
    "elid identify run07.mcap --robot puma560",
    "elid identify *.mcap --robot puma560 --write-robot mine.yaml --report report.html",
    "elid identify empty.mcap loaded.mcap --robot arm.urdf --payload 2.805@joint6",
)
@options.source()
@options.fit
@options.spread
@options.gathered(
    "beyond", Beyond,
    options.option(options.FIT, "--physical", is_flag=True,
                   help="Also find a physically consistent set of all parameters, of a robot that could be built; what "
                   "the log does not show comes from the robot file. --write-robot then writes this set."),
    options.option(options.FIT, "--payload", type=values.CarriedType(), metavar="KG@JOINT",
                   help="Find the gains of the drives, where the log has a current or a share instead of a torque. "
                   "Takes two logs; the second was recorded with this mass on the joint's body. KG@JOINT:X,Y,Z also "
                   "gives the centre of mass, m in the joint's frame. declared: the payload in the robot file."),
)  # fmt: skip
@options.gates
@options.files
@options.output
def identify(
    source: Source,
    fit: EstimateOptions,
    spread: Spread,
    beyond: Beyond,
    gates: Gates,
    files: Files,
    output: Output,
) -> None:
    """Identify the base parameters of a robot from one or more logs: values, standard errors, comparison with the
    robot file, and the torque error per joint on stretches that the fit never saw.
    """  # noqa: D205
    from dataclasses import replace

    from elid_cli.cli.gates import check_gates, check_names, motor_rows_told
    from elid_cli.cli.output import emit, pictures_wanted
    from elid_cli.cli.progress import progress, tell_plain_steps
    from elid_cli.cli.robot_files import check_described, write_found

    if beyond.physical:
        from elid_cli.estimation.physical.semidefinite import need_solver

        need_solver()
    check_described(files)
    if fit.fit == "auto" and (beyond.physical or beyond.payload is not None or _of_bodies(gates)):
        fit = replace(fit, fit="torque")  # they are about the bodies, or the torque
    if fit.fit == "trajectory":
        tell_plain_steps(output)
    with progress(output, "reading") as advance:
        from elid_cli.estimation.refined_robot import identified_robot, remarks, with_stiffnesses
        from elid_cli.report.answers.identification import identification_report

        machine = load_robot(source.robot)
        check_names(gates, machine)
        request = log_request(source, machine, spread, output, advance)
        found, recording, apart, signals = _identified(request, fit, beyond.payload, pictures_wanted(output))
        predicting = refined = identified_robot(found)
        if beyond.physical:
            from elid_cli.estimation.physical.nearest import make_physical

            built = make_physical(found)
            refined = replace(refined, joints=built.refined_robot().joints)
        again = replace(request.told_as(recording), on_read=None, progress=None)

        def without_effects(plain: Robot, late: bool) -> Identification:
            moving = found.estimator == "trajectory"
            same = replace(fit, fit="trajectory" if moving else "torque", delays=late or not moving)
            return _identified(replace(again, robot=plain), same, beyond.payload, False).found

        elastic = with_stiffnesses(refined, found)
        written = write_found(
            files, elastic, remarks(found, physical=beyond.physical) if files.write_robot else (), found, found.error,
            without_effects, output, lambda: signals or samples_of(source, machine, replace(output, quiet=True), None),
        )  # fmt: skip
        report = identification_report(found, recording, source.robot, apart, written.files)
        if pictures_wanted(output):
            from elid_cli.report.figures.build import identification_figures, with_figures

            signals = signals if beyond.payload or signals else samples_of(source, machine, output, advance)
            if signals is not None:
                report = with_figures(report, identification_figures(found, predicting, signals))
        if beyond.physical:
            from elid_cli.report.answers.physical import with_physical

            report = with_physical(report, built, found.base)
    emit(motor_rows_told(report, gates, found.error, output), output)
    if written.refusal:
        raise written.refusal
    check_gates(gates, found.error, found.this_log, found)


def _of_bodies(gates: Gates) -> bool:
    """Whether parameters of bodies must be known: the fit of the motion takes those of the file."""
    from elid_cli.robot.parameter import LINK_PARAMETERS, parameter_named

    named = (parameter_named(name) for name in gates.require_independent)
    return any(item is not None and item.kind in LINK_PARAMETERS for item in named)


def _identified(
    request: LogRequest, fit: EstimateOptions, payload: tuple[Payload | None] | None, keep: bool
) -> Identified:
    """Identify from the logs, or from the pair of them that a payload makes."""
    if payload is None:
        from elid_cli.estimation.identify import identify_logs

        return identify_logs(request, fit, keep_signals=keep)
    from elid_cli.estimation.drive_gains.identification import identify_with_payload

    return identify_with_payload(request, fit, payload[0], keep_signals=keep)
