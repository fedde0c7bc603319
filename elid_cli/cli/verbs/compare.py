"""Compare saved results: which parameters moved by more than their uncertainty."""

from __future__ import annotations

import click

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output
from elid_cli.cli.values import File, Number


@verb("elid compare january.json june.json --fail-on-change")
@click.argument("results", nargs=-1, required=True, type=File(), metavar="RESULT.json…")
@options.option(
    options.FIT,
    "--sigmas",
    type=Number(above=0),
    default=3.0,
    show_default=True,
    help="Report a change only if it is larger than this many standard deviations.",
)
@options.option(options.GATES, "--fail-on-change", is_flag=True, help="Fail when any parameter has changed.")
@options.output
def compare(results: tuple[str, ...], sigmas: float, fail_on_change: bool, output: Output) -> None:
    """Compare results saved with --json: one robot at different times, or two robots of one type.

    Every result is compared with the first. Listed are the parameters that changed by more than their uncertainty.
    """
    from elid_cli.cli.output import LimitError, emit, illustrated, note
    from elid_cli.estimation.comparison import compare as compare_results
    from elid_cli.estimation.comparison import read_result
    from elid_cli.report.answers.comparison import comparison_report, doubts_of

    comparisons = compare_results([read_result(result) for result in results])
    report = comparison_report(comparisons, sigmas)
    report = illustrated(report, output, lambda build: build.comparison_figures(comparisons))
    note(doubts_of(comparisons), output, "warning")
    emit(report, output)
    moved = {c.other.file: len(c.moved(sigmas)) for c in comparisons if c.moved(sigmas)}
    if fail_on_change and moved:
        raise LimitError("; ".join(f"{file}: {n} parameter{'s' * (n != 1)} moved" for file, n in moved.items()))
