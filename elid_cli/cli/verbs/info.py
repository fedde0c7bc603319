"""Show what is in a log: channels, rates, gaps, and where elid finds each signal."""

from __future__ import annotations

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot
from elid_cli.cli.options import Output


@verb("elid info run07.mcap", "elid info run07.mcap --robot puma560")
@options.logs()
@options.optional_robot
@options.maps
@options.option(
    options.OUTPUT, "--write-map", type=values.File(), metavar="FILE.yaml",
    help="Write a mapping for --map: what was found, and what is guessed and must be checked.",
)  # fmt: skip
@options.output
def info(
    logs: tuple[str, ...], robot: str | None, maps: tuple[str, ...], write_map: str | None, output: Output
) -> None:  # fmt: skip
    """Show what is in a log: its channels with rates and gaps, and where elid would find each signal. Where it
    cannot decide, it proposes a mapping to paste. With --robot, for that robot's joints.
    """  # noqa: D205
    from elid_cli.cli.output import emit, note
    from elid_cli.cli.progress import progress

    with progress(output, "reading"):
        from elid_cli.files import write_text
        from elid_cli.logs import read_map_options
        from elid_cli.logs.inspect import inspect_log
        from elid_cli.report.answers.info import info_report, mapping_lines

        machine = None if robot is None else load_robot(robot, any_size=True)
        mapping = read_map_options(maps) or None
        found = [inspect_log(log, machine, mapping) for log in logs]
    if write_map is not None:
        if not (found[0].mapping or found[0].resolved):
            from elid_cli.errors import LogError

            raise LogError(
                f"{found[0].file}: no signal can be placed by its name, so there is no mapping to write",
                detail=found[0].notes[-1] if found[0].chain else "",
                hint="say where each one is, in words of the log: --map 'q: {from: [COLUMN, …]}'",
            )
        write_text(write_map, "".join(f"{line}\n" for line in mapping_lines(found[0])))
    note((sentence for log in found for sentence in log.losses), output, "lost")
    emit(info_report(found, machine, robot, maps, write_map), output)
