"""Judge a robot file on a log: nothing is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import Gates, Output, Source

if TYPE_CHECKING:
    from elid_cli.robot.robot import Robot


@dataclass(frozen=True)
class Part:
    """What is judged: the whole log or what diagnose holds out, of one robot or of several."""

    held_out: bool = False
    against: tuple[str, ...] = ()


@verb(
    "elid validate run08.mcap --robot identified.yaml --max-error 5%",
    "elid validate run08.mcap run09.mcap --robot identified.yaml --against datasheet.yaml --report compared.html",
)
@options.source()
@options.gathered(
    "part", Part,
    options.held_out,
    options.option(options.INPUT, "--against", multiple=True, metavar="ROBOT",
                   help="Another robot file to judge on the same logs, beside the first. Repeatable."),
)  # fmt: skip
@options.gathered("gates", Gates, options.max_error, options.fail_on_insufficient)
@options.output
def validate(source: Source, part: Part, gates: Gates, output: Output) -> None:
    """Say how well a robot file, with its parameters and effects, predicts the motor torques of a log."""
    from elid_cli.cli.gates import check_gates, lacking, motor_rows_told
    from elid_cli.cli.inputs import load_robot, read_source
    from elid_cli.cli.output import emit, illustrated
    from elid_cli.cli.progress import progress

    with progress(output, "reading") as advance:
        from elid_cli.estimation.stretches import search_folds, spans
        from elid_cli.estimation.validation.prediction import ByLog, errors_by_log, where_it_holds
        from elid_cli.estimation.validation.prediction import validate as judge
        from elid_cli.estimation.validation.sufficiency import judge_prediction
        from elid_cli.report.answers.validation import validation_report

        robot = source.robot
        machine = load_robot(robot)
        recording, signals = read_source(source, machine, output, advance)
        if source.conditioning.cutoff is None:
            signals = where_it_holds(machine, signals)
        chosen = search_folds(len(signals.outputs)) < 0 if part.held_out else None
        found = judge(machine, signals, chosen)
        stretches = () if chosen is None else spans(found.observation.t, chosen)
        cases = errors_by_log(machine, signals, recording.files, chosen)
        if part.against:
            named = [(robot, found), *((name, judge(_alike(name, machine), signals, chosen)) for name in part.against)]
            cases = tuple(replace(case, shown=f"{robot} on {case.file}") for case in cases)
            where = " on all logs" if cases else ""
            cases = (*cases, *(ByLog(name, judged.error, f"{name}{where}") for name, judged in named))
        said = judge_prediction(found)
        report = validation_report(found, recording, robot, stretches, cases, said)
        report = illustrated(report, output, lambda build: build.validation_figures(found, signals, cases))
    emit(motor_rows_told(report, gates, found.error, output), output)
    check_gates(gates, found.error, broken=lacking(gates, said.insufficient, said.noise))


def _alike(name: str, first: Robot) -> Robot:
    """Return the robot of that name, with the joints of the first (UsageError where it has others)."""
    from elid_cli.cli.inputs import load_robot
    from elid_cli.errors import UsageError

    other = load_robot(name)
    if other.joint_names != first.joint_names:
        detail = f"{', '.join(other.joint_names)} against {', '.join(first.joint_names)}"
        raise UsageError(f"--against {name}: other joints than those of {first.name}", detail=detail)
    return other
