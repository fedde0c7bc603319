"""Trace what the model leaves unexplained to the effect that it lacks; error before and after."""

from __future__ import annotations

from elid_cli.commands import options
from elid_cli.commands.group import verb
from elid_cli.commands.options import FIT, GATES, Conditioning, Gates, Output, Reading
from elid_cli.commands.values import completing, effects


@verb(
    "elid diagnose run07.mcap --robot puma560",
    "elid diagnose run07.mcap --robot puma560 --check run08.mcap --write-robot refined.yaml",
)
@options.logs()
@options.robot
@options.reading
@options.check
@options.conditioning
@options.option(FIT, "--only", multiple=True, metavar="EFFECT", shell_complete=completing(effects),
                help="Try this effect and no other. Repeatable.")
@options.option(FIT, "--lookup", is_flag=True,
                help="Add a smooth curve where structure remains that no named effect explains.")
@options.gathered("gates", Gates, options.max_error)
@options.option(GATES, "--fail-on-effect", is_flag=True, help="Fail when the model lacks an effect.")
@options.write_robot
@options.output
def diagnose(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    checks: tuple[str, ...],
    conditioning: Conditioning,
    only: tuple[str, ...],
    lookup: bool,
    gates: Gates,
    fail_on_effect: bool,
    write_robot: str | None,
    output: Output,
) -> None:
    """Find the effect that the model lacks: look at the residual of each joint, try every effect that could have left
    it, and report the error before and after on stretches that the search never saw.
    """  # noqa: D205
    from pathlib import Path

    from elid_cli.atomic import check_writable
    from elid_cli.commands.emit import LimitError, check_output, emit
    from elid_cli.commands.gates import check_gates
    from elid_cli.commands.inputs import check_effects, load_recording, load_signals
    from elid_cli.commands.progress import progress

    check_output(output)
    if write_robot is not None:
        check_writable(Path(write_robot))
    with progress(output, "reading") as advance:
        from elid_cli.diagnosis import DiagnoseOptions
        from elid_cli.diagnosis import diagnose as search
        from elid_cli.estimate import identify
        from elid_cli.reports.diagnosis import Check, diagnosis_report
        from elid_cli.robot_file import read_robot
        from elid_cli.robot_file import write_robot as write_file
        from elid_cli.validation import validate

        check_effects(only)
        machine = read_robot(robot)
        recording = load_recording(logs, machine, reading, output, conditioning.rate)
        others = [load_recording((log,), machine, reading, output, conditioning.rate) for log in checks]
        signals = load_signals(recording, machine, conditioning, advance)
        found = search(machine, signals, DiagnoseOptions(lookup=lookup, only=only), advance)
        identified = identify(found.refined, signals)
        judged = []
        for other in others:
            seen = load_signals(other, machine, conditioning, advance)
            before, after = (validate(r, seen).error for r in (found.validation_before.robot, found.refined))
            judged.append(Check(other.files[0], before, after))
    if write_robot is not None:
        write_file(found.refined, write_robot)
    emit(diagnosis_report(found, identified, recording, robot, judged, write_robot), output)
    check_gates(gates, found.after)
    if fail_on_effect and found.effects:
        raise LimitError("; ".join(f"{e.joint or machine.name}: the model lacks {e.effect}" for e in found.effects))
