"""Find the physical effect that the model lacks; error before and after."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.options import FIT, GATES, Files, Gates, Output, Source
from elid_cli.cli.values import completing, effects

if TYPE_CHECKING:
    from collections.abc import Sequence

    from elid_cli.cli.robot_files import Written
    from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
    from elid_cli.report.answers.diagnosis_input import DiagnosisInput


@dataclass(frozen=True)
class Search:
    """What is tried, how far, and on which further logs the result is judged."""

    checks: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    lookup: bool = False
    accurate: bool = False
    jobs: int = 1


@dataclass(frozen=True)
class Limits(Gates):
    """Gates of a diagnosis."""

    fail_on_effect: bool = False
    fail_on_unexplained: bool = False


@verb(
    "elid diagnose run07.mcap --robot puma560",
    "elid diagnose run07.mcap --robot puma560 --check run08.mcap --write-robot refined.yaml",
)
@options.source()
@options.gathered(
    "search", Search,
    options.check,
    options.option(FIT, "--only", multiple=True, metavar="EFFECT", shell_complete=completing(effects),
                   help="Try this effect and no other. Repeatable."),
    options.option(FIT, "--lookup", is_flag=True, help="Fit a smooth curve to what no effect explains."),
    options.option(FIT, "--accurate", is_flag=True,
                   help="Look for a second term of friction curves by spline collocation, however long it takes. On "
                   "short logs of small robots this is always done."),
    options.option(FIT, "--jobs", type=click.IntRange(min=1), default=1, metavar="N",
                   help="Processes that try effects in parallel (on Linux); the result does not depend on N."),
)  # fmt: skip
@options.gathered(
    "gates", Limits,
    options.max_error,
    options.option(GATES, "--fail-on-effect", is_flag=True, help="Fail when the model lacks an effect."),
    options.option(GATES, "--fail-on-unexplained", is_flag=True,
                   help="Fail when part of the residual is more than noise and no effect explains it."),
)  # fmt: skip
@options.files
@options.output
def diagnose(source: Source, search: Search, gates: Limits, files: Files, output: Output) -> None:
    """Find the effect that the model lacks: look at the residual of each joint, try every effect that could have left
    it, and report the error before and after on stretches that the search never saw.
    """  # noqa: D205
    from dataclasses import replace

    from elid_cli.cli.inputs import check_effects, load_recording, load_robot, load_signals, sharp
    from elid_cli.cli.output import emit, illustrated, note
    from elid_cli.cli.progress import progress, tell_plain_steps
    from elid_cli.cli.robot_files import check_described, write_found

    check_described(files)
    with progress(output, "reading") as advance:
        from elid_cli.diagnosis import DiagnoseOptions, Diagnosis
        from elid_cli.diagnosis import diagnose as find
        from elid_cli.diagnosis.by_motion.able import by_motion
        from elid_cli.estimation.identify import EstimateOptions, identify
        from elid_cli.estimation.refined_robot import remarks
        from elid_cli.estimation.validation.prediction import validate
        from elid_cli.report.answers.diagnosis import diagnosis_report, event_words
        from elid_cli.report.answers.diagnosis_input import Check, DiagnosisInput

        check_effects(search.only)
        machine, options = load_robot(source.robot), source.conditioning
        recording = load_recording(source.logs, machine, source.reading, output, options.rate, advance)
        moving = by_motion(machine, recording) and not (search.checks or search.lookup)
        if moving:
            tell_plain_steps(output)
        if moving and (search.accurate or search.jobs > 1):
            note(["--accurate and --jobs are of the search by torques, not of this one by motion"], output)
        others = [
            load_recording((log,), machine, source.reading, output, options.rate, label=log, others=True)
            for log in search.checks
        ]
        signals = load_signals(recording, machine, options if moving else sharp(options, recording), advance)
        recording = signals.recording or recording
        if advance is not None and not moving:
            advance("fitting", 0.0)
        chosen = DiagnoseOptions(
            search.lookup, search.only, search.accurate, search.jobs, "motion" if moving else "torque"
        )
        usual = None if moving else load_signals(recording, replace(machine, effects=()), options, advance)
        found = find(machine, signals, chosen, advance, usual)
        if not isinstance(found, Diagnosis):
            _tell_motion(found, gates, files, source.robot, output)
            return
        judged = []
        for other in others:
            seen = load_signals(other, machine, sharp(options, other), advance)
            before, after = (validate(r, seen).error for r in (found.validation_before.robot, found.written_robot))
            judged.append(Check(other, before, after))
        if advance is not None:
            advance("judging", 0.5)
        published = found.identified_after
        events = [event_words(event) for event in found.events] if files.write_robot and not found.partial else []
        note([f"{path}: {sentence}" for path in files.write_robot for sentence in events], output, "left out")
        said = (*remarks(published), *events) if files.write_robot else ()
        written = write_found(
            Files() if found.partial else files, found.written_robot, said, found.identified_with_effects, found.after,
            lambda plain, _: identify(plain, signals, EstimateOptions(fit="torque")), output, lambda: signals,
        )  # fmt: skip
        told = DiagnosisInput(
            found, found.identified_before, published, found.contributions, recording, source.robot, judged,
            written.own, search.lookup, search.only,
        )  # fmt: skip
        report = diagnosis_report(told)
        report = illustrated(
            report, output, lambda build: build.diagnosis_figures(found, told.after, told.contributions, signals)
        )
    emit(report, output)
    _end(found.partial, written, _broken(told, gates))


def _tell_motion(found: MotionDiagnosis, gates: Limits, files: Files, robot: str, output: Output) -> None:
    """Report and write what the motion simulated under a log's commands says."""
    from elid_cli.cli.gates import broken_gates
    from elid_cli.cli.output import emit, illustrated, note
    from elid_cli.cli.robot_files import write_found
    from elid_cli.diagnosis.by_motion.diagnose import least_squares
    from elid_cli.estimation.refined_robot import BODIES_KEPT, remarks
    from elid_cli.estimation.trajectory.identification import by_trajectory
    from elid_cli.model.effects import effect_that
    from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_report, named_effects

    loads = [e for e in found.effects if e.effect == effect_that(carried=True).name]
    which = "the last one" if not loads or loads[0].joint is None else f"that of {loads[0].joint}"
    more = f"Bodies are those of the file before, {which} with the load that was found." if loads else ""
    said = [line.replace(BODIES_KEPT, more or BODIES_KEPT) for line in remarks(found.after)]
    written = write_found(
        Files() if found.partial else files, found.refined, said if files.write_robot else (),
        found.after, found.after.error,
        lambda other, late: by_trajectory(
            least_squares(other, found.delivered), found.delivered, delays=late, start=found.fit_after.values
        ),
        output, lambda: found.delivered,
    )  # fmt: skip
    if written.files and found.free_bodies is not None:
        others = "elid identify --fit torque --write-robot writes the bodies with which the motion comes nearer"
        note([f"{', '.join(written.files)}: has the bodies of the file; {others}"], output, "warning")
    report = motion_diagnosis_report(found, robot, written.own)
    report = illustrated(report, output, lambda build: build.motion_figures(found))
    emit(report, output)
    broken = [*broken_gates(gates, found.after.error), *(named_effects(found) if gates.fail_on_effect else ())]
    broken += [
        f"{u.joint}: the error of the motion is unexplained" for u in found.unexplained if gates.fail_on_unexplained
    ]
    _end(found.partial, written, broken)


def _end(partial: bool, written: Written, broken: Sequence[str]) -> None:
    """Leave with the exit code of what went wrong: a search that was ended, a file not written, a limit broken."""
    from elid_cli.cli.output import LimitError

    if partial:
        raise KeyboardInterrupt  # main knows its exit code
    if written.refusal:
        raise written.refusal
    if broken:
        raise LimitError("; ".join(broken))


def _broken(told: DiagnosisInput, gates: Limits) -> list[str]:
    """Return the limits that are broken, the model after being worse than allowed on any log among them."""
    from elid_cli.cli.gates import broken_gates
    from elid_cli.estimation.judgement import EQUATIONS

    found = told.found
    broken: list[str] = []
    if gates.fail_on_effect:  # the terms of one curve are one effect
        lacks = [f"{e.joint or found.robot.name}: the model lacks {e.effect}" for e in found.effects]
        broken += dict.fromkeys(lacks)
    if gates.fail_on_unexplained:
        broken += [f"{u.joint}: the residual of the {EQUATIONS[u.rows]} is unexplained" for u in found.unexplained]
    broken += broken_gates(gates, found.after)
    for check in told.checks:
        file = check.recording.files[0]
        broken += broken_gates(gates, {f"{file}: {joint}": e for joint, e in check.after.items()})
    return broken
