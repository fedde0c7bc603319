"""Compare the published models of servo friction on a log."""

from __future__ import annotations

from pathlib import Path

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.options import Conditioning, Output, Reading


@verb(
    "elid friction run07.mcap --robot puma560",
    "elid friction run07.mcap --robot puma560 --write-robot friction.yaml",
)
@options.logs()
@options.robot
@options.reading
@options.conditioning
@options.option(
    options.OUTPUT, "--write-robot", "written", type=values.File(), metavar="FILE.yaml",
    help="Write a robot file with the supported member of every joint.",
)  # fmt: skip
@options.output
def friction(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    conditioning: Conditioning,
    written: str | None,
    output: Output,
) -> None:
    """Compare the family of servo friction models M1 to M6 (Coulomb and viscous, Stribeck, load, both, directional,
    quadratic) on stretches that no fit saw, and say which member the log of each joint supports.
    """  # noqa: D205
    from elid_cli.cli.inputs import diagnosis_conditioning, load_recording, load_robot, load_signals
    from elid_cli.cli.output import check_output, emit, pictures_wanted
    from elid_cli.cli.progress import progress
    from elid_cli.files import check_suffix, check_writable

    check_output(output)
    if written is not None:
        check_suffix(Path(written), (".yaml", ".yml"), "a robot file with effects")
        check_writable(Path(written))
    with progress(output, "reading") as advance:
        from elid_cli.diagnosis.friction_family import friction_family
        from elid_cli.report.answers.friction import friction_report
        from elid_cli.robot.files import write_robot

        machine = load_robot(robot)
        recording = load_recording(logs, machine, reading, output, conditioning.rate, advance)
        signals = load_signals(recording, machine, diagnosis_conditioning(conditioning, recording), advance)
        found = friction_family(machine, signals, advance)
        if written is not None:
            write_robot(found.refined, written, REMARKS)
        report = friction_report(found, recording, robot, () if written is None else (written,))
        if pictures_wanted(output):
            from elid_cli.report.figures.build import friction_figures, with_figures

            report = with_figures(report, friction_figures(found))
    emit(report, output)


REMARKS = (
    "Written by elid friction: parameters and friction of the supported members, fitted to the whole log. Of sums that "
    "a log shows, the parts are those nearest to the file before.",
)
