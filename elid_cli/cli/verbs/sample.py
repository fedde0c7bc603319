"""Draw parameter sets from results, for simulations that vary parameters."""

from __future__ import annotations

import click

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot
from elid_cli.cli.options import Output
from elid_cli.cli.values import File


@verb(
    "elid sample result.json -n 200 -o sets.csv --ranges ranges.yaml",
    "elid sample monday.json tuesday.json -n 50 --robot go2.xml -o robots",
)
@click.argument("results", nargs=-1, required=True, type=File(), metavar="RESULT.json…")
@options.optional_robot
@options.option(
    options.FIT, "-n", "--count", type=click.IntRange(1, 100_000), default=200, show_default=True,
    help="Number of sets.",
)  # fmt: skip
@options.seed
@options.out(
    "The sets: a table (.csv, .json, .npz), or with --robot a folder of robot files with their values; one that holds "
    "sets already is refused.",
    required=False, metavar="FILE|FOLDER",
)  # fmt: skip
@options.option(
    options.OUTPUT, "--ranges", type=File(), metavar="FILE.yaml", help="Write the range of every parameter as YAML."
)
@options.output
def sample(
    results: tuple[str, ...],
    robot: str | None,
    count: int,
    seed: int,
    out: str | None,
    ranges: str | None,
    output: Output,
) -> None:
    """Draw random parameter sets from saved results.

    The sets keep the correlations of the results and are physically possible. With several results, the spread between
    recordings counts as well. Parameters that no result shows keep the value of the robot file. With --robot, each
    set holds all parameters of the robot.
    """
    from pathlib import Path

    from elid_cli.cli.output import emit, illustrated, note
    from elid_cli.cli.set_files import check_sets, write_sets
    from elid_cli.estimation.sampling.files import RANGES, write_ranges
    from elid_cli.estimation.sampling.sets import sample as draw
    from elid_cli.files import check_target
    from elid_cli.report.answers.sampling import sampling_report, with_samples
    from elid_cli.report.formats import write_report

    check_sets(out, robot)
    if ranges is not None:
        check_target(ranges, RANGES, "ranges")
    sets = draw(results, count, None if robot is None else load_robot(robot), seed)
    note(sets.notes, output)
    written = [name for name in (out, ranges) if name is not None]
    report = sampling_report(sets, written)
    if out is not None and Path(out).suffix.lower() == ".json":
        write_report(with_samples(report, sets), Path(out))
    elif out is not None:
        note(write_sets(sets, Path(out)), output, "left out")
    if ranges is not None:
        write_ranges(sets, ranges)
    report = illustrated(report, output, lambda build: build.sampling_figures(sets))
    emit(report if out is not None else with_samples(report, sets), output)
