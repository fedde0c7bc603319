"""Compare the published models of servo friction on a log."""

from __future__ import annotations

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output, Source


@verb(
    "elid friction run07.mcap --robot puma560",
    "elid friction run07.mcap --robot puma560 --write-robot friction.yaml",
)
@options.source()
@options.option(
    options.OUTPUT, "--write-robot", "written", type=values.File(), metavar="FILE.yaml",
    help="Write a robot file with the chosen member of every joint.",
)  # fmt: skip
@options.output
def friction(source: Source, written: str | None, output: Output) -> None:
    """Compare the family of servo friction models M1 to M6 (Coulomb and viscous, Stribeck, load, both, directional,
    quadratic) on stretches that no fit saw, and say which member the log of each joint supports.
    """  # noqa: D205
    from elid_cli.cli.inputs import load_robot, read_source
    from elid_cli.cli.output import emit, illustrated
    from elid_cli.cli.progress import progress
    from elid_cli.files import check_target

    if written is not None:
        check_target(written, (".yaml", ".yml"), "a robot file with effects")
    with progress(output, "reading") as advance:
        from elid_cli.diagnosis.friction_family import friction_family
        from elid_cli.report.answers.friction import friction_report
        from elid_cli.robot.files import write_robot

        machine = load_robot(source.robot)
        recording, signals = read_source(source, machine, output, advance)
        found = friction_family(machine, signals, advance)
        if written is not None:
            write_robot(found.refined, written, REMARKS)
        report = friction_report(found, recording, source.robot, () if written is None else (written,))
        report = illustrated(report, output, lambda build: build.friction_figures(found))
    emit(report, output)


REMARKS = (
    "Written by elid friction: parameters and friction of the chosen members, fitted to the whole log. Of sums that "
    "a log shows, the parts are those nearest to the file before.",
)
