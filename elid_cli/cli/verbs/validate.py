"""Judge a robot file on a log: nothing is fitted."""

from __future__ import annotations

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import Conditioning, Gates, Output, Reading


@verb("elid validate run08.mcap --robot identified.yaml --max-error 5%")
@options.logs()
@options.robot
@options.reading
@options.conditioning
@options.held_out
@options.gathered("gates", Gates, options.max_error)
@options.output
def validate(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    conditioning: Conditioning,
    held_out: bool,
    gates: Gates,
    output: Output,
) -> None:
    """Say how well a robot file, with its parameters and effects, predicts the motor torques of a log."""
    from elid_cli.cli.gates import check_gates, motor_rows_told
    from elid_cli.cli.inputs import diagnosis_conditioning, load_recording, load_robot, load_signals
    from elid_cli.cli.output import check_output, emit, pictures_wanted
    from elid_cli.cli.progress import progress

    check_output(output)
    with progress(output, "reading") as advance:
        from elid_cli.estimation.stretches import search_folds, spans
        from elid_cli.estimation.validation.prediction import validate as judge
        from elid_cli.report.answers.validation import validation_report

        machine = load_robot(robot)
        recording = load_recording(logs, machine, reading, output, conditioning.rate, advance)
        signals = load_signals(recording, machine, diagnosis_conditioning(conditioning, recording), advance)
        chosen = search_folds(len(signals.outputs)) < 0 if held_out else None
        found = judge(machine, signals, chosen)
        stretches = () if chosen is None else spans(found.observation.t, chosen)
        report = validation_report(found, recording, robot, stretches)
        if pictures_wanted(output):
            from elid_cli.report.figures.build import validation_figures, with_figures

            report = with_figures(report, validation_figures(found, signals))
    emit(motor_rows_told(report, gates, found.error, output), output)
    check_gates(gates, found.error)
