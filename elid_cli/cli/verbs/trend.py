"""Parameters of one machine over its recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output, Reading, Source, Spread
from elid_cli.cli.values import File

if TYPE_CHECKING:
    from elid_cli.estimation.comparison import SavedResult
    from elid_cli.estimation.trend.trends import Trends
    from elid_cli.signals.options import SignalOptions


@verb("elid trend monday.json tuesday.json wednesday.json --fail-on-trend", "elid trend logs/*.mcap --robot arm.yaml")
@click.argument("recordings", nargs=-1, required=True, type=File(), metavar="LOG|RESULT.json…")
@options.optional_robot
@options.option(
    options.INPUT, "--by", type=click.Choice(("order", "time")), default="order", show_default=True,
    help="Slopes per recording in the order given, or per hour of the files' modification times.",
)  # fmt: skip
@options.option(
    options.GATES,
    "--fail-on-trend",
    is_flag=True,
    help="Fail when a parameter changes or has changed, or a recording stands out.",
)
@options.option(
    options.GATES,
    "--fail-on-disagreement",
    is_flag=True,
    help="As --fail-on-trend, and where recordings differ by more than their errors along no certain trend.",
)
@options.reading
@options.conditioning
@options.output
def trend(
    recordings: tuple[str, ...],
    robot: str | None,
    by: str,
    fail_on_trend: bool,
    fail_on_disagreement: bool,
    reading: Reading,
    conditioning: SignalOptions,
    output: Output,
) -> None:
    """Say which parameters of a machine change over its recordings, gradually or in a jump, and which recordings
    disagree. Recordings are results saved with --json, or logs, which are identified with --robot.
    """  # noqa: D205
    from pathlib import Path

    from elid_cli.cli.output import LimitError, emit, illustrated, note
    from elid_cli.cli.progress import progress
    from elid_cli.errors import UsageError
    from elid_cli.estimation.saved_results import is_result
    from elid_cli.logs.source import open_source

    logs = [name for name in recordings if not is_result(name)]
    folder = next((name for name in recordings if Path(name).is_dir()), None)
    if folder is not None:
        raise UsageError(f"trend: {folder} is a folder", hint=f"give its files: {Path(folder) / '*'}.json")
    if logs and robot is None:
        open_source(logs[0])  # where there is none, that is what is said
        raise UsageError(f"trend: {logs[0]} is a log: it is identified first, which needs --robot",
                         hint=f"elid trend {logs[0]} … --robot ROBOT")  # fmt: skip
    with progress(output, "reading") as advance:
        from elid_cli.estimation.comparison import read_result
        from elid_cli.estimation.trend.trends import trend as over_recordings
        from elid_cli.report.answers.trend import trend_report

        results = []
        for k, name in enumerate(recordings):
            if advance is not None:
                advance("reading", k / len(recordings))
            saved = name not in logs
            source = Source((name,), robot or "", reading, conditioning)
            results.append(read_result(name) if saved else _identified(source, output))
        hours = [Path(name).stat().st_mtime / 3600.0 for name in recordings] if by == "time" else None
        places = None if hours is None else [value - min(hours) for value in hours]
        found = over_recordings(results, places, "recording" if hours is None else "hour")
        remarks = _unused(len(recordings) - len(logs), len(logs))
        remarks += _let_pass(found) if fail_on_trend and not fail_on_disagreement else []
        report = trend_report(found, remarks)
        report = illustrated(report, output, lambda build: build.trend_figures(found))
    note((*remarks, *found.warnings), output, "warning")
    emit(report, output)
    broken = _broken(found) if fail_on_trend or fail_on_disagreement else []
    broken += _disagreeing(found) if fail_on_disagreement else []
    if broken:
        raise LimitError("; ".join(broken))


def _unused(results: int, logs: int) -> list[str]:
    """Return a sentence on options of the command line that only logs use, where some recordings are results."""
    from click.core import ParameterSource

    from elid_cli.errors import in_words

    context = click.get_current_context()
    given = [
        max(param.opts, key=len)
        for param in context.command.params
        if getattr(param, "heading", "") in (options.INPUT, options.SIGNALS) and param.name != "by"
        and context.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE
    ]  # fmt: skip
    if not results or not given or (logs and given == ["--robot"]):
        return []
    use = "is" if len(given) == 1 else "are"
    them = f"for {results} of the {results + logs} recordings: they" if logs else "here: all recordings"
    return [f"{in_words(given)} {use} not used {them} are results, which were identified before"]


def _broken(found: Trends) -> list[str]:
    """Return what ``--fail-on-trend`` fails on: recordings that stand out, and changes of the others."""
    from elid_cli.report.answers.trend_apart import outlying_words

    moved = [item.series.name for item in found.of("trend", "step")]
    moved += [f"{item.kind} of all joints" for item in found.families if item.word == "trend"]
    return [*outlying_words(found), *([f"{', '.join(moved)}: changed over the recordings"] if moved else [])]


def _disagreeing(found: Trends) -> list[str]:
    """Return what ``--fail-on-disagreement`` fails on, what is a change apart."""
    from elid_cli.report.answers.trend import disagreeing_words

    alike = [f"{item.kind} of all joints" for item in found.families if item.word == "together"]
    said = [f"{', '.join(alike)}: differs between recordings"] if alike else []
    return [*said, *([f"recordings disagree: {disagreeing_words(found)}"] if found.disagreeing else [])]


def _let_pass(found: Trends) -> list[str]:
    """Return a sentence on what may be a trend, where ``--fail-on-trend`` does not fail on it."""
    from elid_cli.report.answers.summary import called, counted

    names = [called(item.series.name) for item in found.disagreeing if item.series.undecided]
    if not names:
        return []
    return [f"--fail-on-trend lets recordings that disagree pass ({counted(names, ', ')}): "
            "--fail-on-disagreement fails on them"]  # fmt: skip


def _identified(source: Source, output: Output) -> SavedResult:
    """Return what identification says of one log, as a saved result would."""
    from elid_cli.cli.inputs import load_robot, log_request
    from elid_cli.estimation.comparison import result_of
    from elid_cli.estimation.identify import EstimateOptions, identify_logs
    from elid_cli.report.answers.identification_json import identification_payload

    request = log_request(source, load_robot(source.robot), Spread(), output, None)
    found = identify_logs(request, EstimateOptions(fit="torque"))
    return result_of(identification_payload(found.found, found.recording), source.logs[0])
