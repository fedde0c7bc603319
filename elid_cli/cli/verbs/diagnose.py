"""Trace what the model leaves unexplained to the effect that it lacks; error before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import FIT, GATES, Conditioning, Files, Gates, Output, Reading, completing, effects

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from elid_cli._types import Progress
    from elid_cli.diagnosis import Diagnosis
    from elid_cli.estimation.result import JointError
    from elid_cli.report.answers.diagnosis_input import DiagnosisInput
    from elid_cli.robot.robot import Robot
    from elid_cli.signals.recording import Recording


@verb(
    "elid diagnose run07.mcap --robot puma560",
    "elid diagnose run07.mcap --robot puma560 --check run08.mcap --write-robot refined.yaml",
)
@options.logs()
@options.robot
@options.reading
@options.check
@options.conditioning
@options.option(
    FIT,
    "--only",
    multiple=True,
    metavar="EFFECT",
    shell_complete=completing(effects),
    help="Try this effect and no other. Repeatable.",
)
@options.option(
    FIT, "--lookup", is_flag=True, help="Add a smooth curve where structure remains that no named effect explains."
)
@options.option(
    FIT,
    "--accurate",
    is_flag=True,
    help="Complete friction curves by spline collocation however long it takes; on short logs of small "
    "robots that is always done.",
)
@options.option(
    FIT,
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    metavar="N",
    help="Processes that try effects side by side (on Linux); the result is the same for any number.",
)
@options.gathered("gates", Gates, options.max_error)
@options.option(GATES, "--fail-on-effect", is_flag=True, help="Fail when the model lacks an effect.")
@options.option(
    GATES, "--fail-on-unexplained", is_flag=True, help="Fail when the model leaves structure that no effect explains."
)
@options.files
@options.output
def diagnose(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    checks: tuple[str, ...],
    conditioning: Conditioning,
    only: tuple[str, ...],
    lookup: bool,
    accurate: bool,
    jobs: int,
    gates: Gates,
    fail_on_effect: bool,
    fail_on_unexplained: bool,
    files: Files,
    output: Output,
) -> None:
    """Find the effect that the model lacks: look at the residual of each joint, try every effect that could have left
    it, and report the error before and after on stretches that the search never saw.
    """  # noqa: D205
    from dataclasses import replace

    from elid_cli.cli.inputs import check_effects, diagnosis_conditioning, load_recording, load_robot, load_signals
    from elid_cli.cli.output import check_output, emit, note, pictures_wanted
    from elid_cli.cli.progress import progress
    from elid_cli.cli.robot_files import FOREIGN, check_described, write_found

    check_output(output)
    check_described(files)
    with progress(output, "reading") as advance:
        from elid_cli.diagnosis import DiagnoseOptions
        from elid_cli.diagnosis import diagnose as search
        from elid_cli.diagnosis.by_motion.diagnose import by_motion
        from elid_cli.estimation.identify import identify
        from elid_cli.estimation.refined_robot import remarks
        from elid_cli.estimation.validation.prediction import validate
        from elid_cli.report.answers.diagnosis import diagnosis_report
        from elid_cli.report.answers.diagnosis_input import Check, DiagnosisInput

        check_effects(only)
        machine = load_robot(robot)
        recording = load_recording(logs, machine, reading, output, conditioning.rate, advance)
        if by_motion(machine, recording) and not (checks or lookup):
            if accurate or jobs > 1:
                note(["--accurate and --jobs are of the search by torques, not of this one by motion"], output)
            _by_motion(machine, recording, conditioning, only, gates, (fail_on_effect, fail_on_unexplained), files,
                       robot, output, advance)  # fmt: skip
            return
        others = [load_recording((log,), machine, reading, output, conditioning.rate, label=log) for log in checks]
        signals = load_signals(recording, machine, diagnosis_conditioning(conditioning, recording), advance)
        if advance is not None:
            advance("fitting", 0.0)
        found = search(
            machine, signals, DiagnoseOptions(lookup=lookup, only=only, accurate=accurate, jobs=jobs), advance
        )
        found = replace(found, usual=load_signals(recording, replace(machine, effects=()), conditioning, advance))
        judged = []
        for other in others:
            seen = load_signals(other, machine, diagnosis_conditioning(conditioning, other), advance)
            before, after = (validate(r, seen).error for r in (found.validation_before.robot, found.written_robot))
            judged.append(Check(other, before, after))
        if advance is not None:
            advance("judging", 0.5)
        published = found.identified_after
        written = write_found(
            Files() if found.partial else files, found.written_robot, remarks(published) if files.write_robot else (),
            found.identified_with_effects, found.after, lambda plain: identify(plain, signals), output,
        )  # fmt: skip
        told = DiagnosisInput(
            found,
            found.identified_before,
            published,
            found.contributions,
            recording,
            robot,
            judged,
            next((path for path in written.files if not path.lower().endswith(FOREIGN)), None),
            lookup,
            only,
        )
        report = diagnosis_report(told)
        if pictures_wanted(output):
            from elid_cli.report.figures.build import diagnosis_figures, with_figures

            report = with_figures(report, diagnosis_figures(found, told.after, told.contributions, signals))
    emit(report, output)
    if found.partial:
        raise KeyboardInterrupt  # main knows its exit code
    if written.refusal:
        raise written.refusal
    _check(told, gates, [*(_lacks(found) if fail_on_effect else ()), *(_leaves(found) if fail_on_unexplained else ())])


def _by_motion(
    machine: Robot, recording: Recording, conditioning: Conditioning, only: tuple[str, ...], gates: Gates,
    fail: tuple[bool, bool], files: Files, robot: str, output: Output, advance: Progress | None,
) -> None:  # fmt: skip
    """Diagnose a log of commands by the motion simulated under them."""
    from dataclasses import replace

    from elid_cli.cli.gates import broken_gates
    from elid_cli.cli.inputs import load_signals
    from elid_cli.cli.output import LimitError, emit, pictures_wanted
    from elid_cli.cli.robot_files import FOREIGN, write_found
    from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
    from elid_cli.estimation.identify import EstimateOptions, identify
    from elid_cli.estimation.refined_robot import remarks
    from elid_cli.estimation.trajectory.identification import by_trajectory
    from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_report, named_effects

    signals = load_signals(recording, machine, conditioning, advance)
    least_squares = identify(replace(machine, effects=()), signals, EstimateOptions(guards=False))
    found = diagnose_motion(machine, signals, replace(least_squares, robot=machine), only, advance)
    plain = lambda other: by_trajectory(replace(least_squares, robot=other), signals, delays=False)  # noqa: E731
    written = write_found(
        Files() if found.partial else files, found.refined, remarks(found.after) if files.write_robot else (),
        found.after, found.after.error, plain, output,
    )  # fmt: skip
    ours = next((path for path in written.files if not path.lower().endswith(FOREIGN)), None)
    report = motion_diagnosis_report(found, robot, ours)
    if pictures_wanted(output):
        from elid_cli.estimation.refined_robot import identified_robot
        from elid_cli.experiment.replay import replay
        from elid_cli.report.figures.build import replay_figures, with_figures

        before, after = (replay(moving, recording) for moving in (identified_robot(found.before), found.refined))
        report = with_figures(report, replay_figures(after, before))
    emit(report, output)
    if found.partial:
        raise KeyboardInterrupt  # main knows its exit code
    if written.refusal:
        raise written.refusal
    broken = [*broken_gates(gates, found.after.error), *(named_effects(found) if fail[0] else ())]
    broken += [f"{u.joint}: motion left unexplained" for u in found.unexplained] if fail[1] else []
    if broken:
        raise LimitError("; ".join(broken))


def _check(told: DiagnosisInput, gates: Gates, broken: Sequence[str]) -> None:
    """Raise `LimitError` where a limit is broken, or the model after is worse than allowed on any log."""
    from elid_cli.cli.gates import broken_gates
    from elid_cli.cli.output import LimitError

    everything = [*broken, *broken_gates(gates, told.found.after)]
    for check in told.checks:
        everything += broken_gates(gates, _in(check.recording.files[0], check.after))
    if everything:
        raise LimitError("; ".join(everything))


def _lacks(found: Diagnosis) -> list[str]:
    # the terms of one curve are one effect
    return list(dict.fromkeys(f"{e.joint or found.robot.name}: the model lacks {e.effect}" for e in found.effects))


def _leaves(found: Diagnosis) -> list[str]:
    return [f"{u.joint}: {u.rows} row left unexplained" for u in found.unexplained]


def _in(file: str, error: Mapping[str, JointError]) -> dict[str, JointError]:
    return {f"{file}: {joint}": e for joint, e in error.items()}
