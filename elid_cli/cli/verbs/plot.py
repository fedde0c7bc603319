"""Draw a log before anything is fitted to it."""

from __future__ import annotations

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output, Reading


@verb("elid plot run07.mcap --robot puma560 --report run07.html", "elid plot run07.csv --plot figures")
@options.logs()
@options.optional_robot
@options.reading
@options.output
def plot(logs: tuple[str, ...], robot: str | None, reading: Reading, output: Output) -> None:
    """Draw a log before anything is fitted to it: positions, velocities, torques and deflections over time, where the
    joints have been, gaps and what was repaired. --report FILE.html makes a page, --plot DIR a picture of each figure.
    Without --robot, for the joints that the log names.
    """  # noqa: D205
    from elid_cli.cli.inputs import load_recording, load_robot
    from elid_cli.cli.output import emit, illustrated
    from elid_cli.cli.progress import progress

    with progress(output, "reading") as advance:
        from elid_cli.logs.inspect import guessed_robot
        from elid_cli.report.answers.log import log_report

        machine = guessed_robot(logs[0]) if robot is None else load_robot(robot)
        recording = load_recording(logs, machine, reading, output, None, advance)
        report = log_report(recording, machine, robot)
        report = illustrated(report, output, lambda build: build.log_figures(recording, machine))
    emit(report, output)
