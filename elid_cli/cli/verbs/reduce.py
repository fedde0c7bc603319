"""Reduce logs to small files, to be identified together later or elsewhere."""

from __future__ import annotations

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot, log_request
from elid_cli.cli.options import Output, Source, Spread


@verb(
    "elid reduce run07.mcap --robot puma560 -o run07.npz",
    "elid reduce fleet/*.mcap --robot puma560 -o fleet.npz --jobs 8",
)
@options.source()
@options.spread
@options.out("The reduced logs to write: NumPy's npz, some hundred kilobytes per log.", metavar="FILE.npz")
@options.output
def reduce(source: Source, spread: Spread, out: str, output: Output) -> None:
    """Reduce logs to what identification needs of them: small triangular matrices, however long the log.

    elid identify and elid classify take such files beside logs and give the same answer as from the logs.
    """
    from elid_cli.cli.output import emit
    from elid_cli.cli.progress import progress
    from elid_cli.errors import UsageError
    from elid_cli.files import check_target

    check_target(out, (".npz",), "reduced logs")
    with progress(output, "reading") as advance:
        from elid_cli.estimation.identify import EstimateOptions, samples_needed
        from elid_cli.estimation.streaming.files import write_triangles
        from elid_cli.estimation.streaming.fleet import reduced_logs
        from elid_cli.estimation.streaming.merge import check_alike, joined_recording
        from elid_cli.report.answers.reduction import reduction_report

        robot = source.robot
        machine = load_robot(robot)
        reason = samples_needed(machine, EstimateOptions())
        if reason:
            raise UsageError(f"{robot}: cannot be reduced for", detail=reason, hint="take the robot without effects")
        found = reduced_logs(log_request(source, machine, spread, output, advance))
        check_alike(machine, found)
        write_triangles(found, out)
        report = reduction_report(machine, found, joined_recording(found), robot, out)
    emit(report, output)
