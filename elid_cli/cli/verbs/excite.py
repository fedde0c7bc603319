"""Find an exciting trajectory within the robot's limits, optimised to show its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from click.core import ParameterSource

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot
from elid_cli.cli.options import Output, Reading
from elid_cli.cli.values import File, Number, Share

if TYPE_CHECKING:
    from elid_cli.experiment.excitation import Excitation, ExciteOptions
    from elid_cli.experiment.last_log import LastLog
    from elid_cli.experiment.resolve import Resolution
    from elid_cli.robot.robot import Robot

MOTION = "Trajectory"
SHOWN_FOR = 10.0
"""Length of a motion that shows stiffnesses, s."""


@dataclass(frozen=True)
class MotionChoice:
    """Which trajectory is wanted; `after` what, to `resolve` what, or for which joints' stiffness."""

    aims: tuple[str, ...] = ()
    after: str | None = None
    resolve: str | None = None
    show_stiffness: tuple[str, ...] = ()
    duration: float = 20.0
    rate: float = 250.0
    interval: float | None = None
    residual: float = 0.02
    seed: int = 0


@verb(
    "elid excite --robot puma560 -o excite.csv",
    "elid excite --robot puma560 -o wrist.csv --for Izz6 --for Jm6 --duration 30",
    "elid excite --robot puma560 -o next.csv --after run07.mcap",
    "elid excite --robot puma560 -o next.csv --resolve diagnosis.json",
    "elid excite --robot arm.yaml -o stiffness.csv --show-stiffness elbow:15",
)
@options.robot
@options.reading
@options.gathered(
    "motion", MotionChoice,
    options.option(MOTION, "--for", "aims", multiple=True, metavar="NAME",
                   help="Parameter that the log must show above all, such as Izz6. Repeatable."),
    options.option(MOTION, "--after", type=File(), metavar="LOG",
                   help="The last log, or its result saved with --json. The trajectory aims at what that log could not "
                   "show; residuals of the same size are expected."),
    options.option(MOTION, "--resolve", type=File(), metavar="FILE",
                   help="A diagnosis saved with --json: plan the motion that decides between the effects that it "
                   "could not tell apart."),
    options.option(MOTION, "--show-stiffness", multiple=True, metavar="JOINT[:HZ]",
                   help="Plan the motion from which this joint's stiffness is found without a sensor on the link: slow "
                   "motion, and a multisine with frequencies up to beyond the antiresonance. HZ: the highest "
                   "antiresonance to expect. Default: from the stiffness in the robot file. Repeatable."),
    options.option(MOTION, "--duration", type=Number(above=0), default=20.0, show_default=True, metavar="S",
                   help="Length of the trajectory."),
    options.option(MOTION, "--rate", type=Number(above=0), default=250.0, show_default=True, metavar="HZ",
                   help="Samples per second in the file."),
    options.option(MOTION, "--interval", type=Number(above=0), metavar="S",
                   help="Time between the splines' way-points. Default: from each joint's limits."),
    options.option(MOTION, "--residual", type=Share(above=0), default="2%", show_default=True, metavar="SHARE",
                   help="Torque residual to expect after filtering, as a share of the torque. The expected standard "
                   "errors grow with it."),
    options.seed,
)  # fmt: skip
@options.out("The trajectory to write, CSV: t, q, dq, ddq of every joint.", metavar="TRAJ.csv")
@options.output
def excite(robot: str, reading: Reading, motion: MotionChoice, out: str, output: Output) -> None:
    """Find a trajectory that is optimised to show the base parameters in a log.

    It starts and ends at rest and stays within the joints' limits.

    Limits and reference values come from the robot file. The report says which standard errors to expect. With
    --resolve it says how probable it is that the next log decides between the effects; with --show-stiffness, which
    multisine is used.
    """
    from elid_cli.cli.output import emit, illustrated
    from elid_cli.cli.progress import progress
    from elid_cli.files import check_target

    check_target(out, (".csv",), "a trajectory")
    if motion.show_stiffness and motion.resolve is None:
        _show_stiffness(robot, motion, out, output)
        return
    if motion.resolve is not None:
        detail = "it plans for effects with the noise that the diagnosis found; they plan for parameters"
        _alone("--resolve", ("aims", "after", "residual", "show_stiffness"), detail)
    with progress(output, "optimising") as advance:
        from elid_cli.experiment.reference import write_trajectory

        machine = load_robot(robot)
        told = None if advance is None else lambda share: advance("optimising", share)
        found: Excitation | Resolution
        if motion.resolve is not None:
            from elid_cli.experiment.resolve import ResolveOptions, read_question, resolve
            from elid_cli.report.answers.resolution import resolution_report

            chosen = ResolveOptions(duration=motion.duration, interval=motion.interval, seed=motion.seed)
            found = resolve(read_question(motion.resolve, machine), chosen, told)
            report = resolution_report(found, robot, motion.resolve, out, motion.rate)
        else:
            from elid_cli.experiment.excitation import excite as find
            from elid_cli.report.answers.excitation import excitation_report

            found = find(machine, _options(motion, machine, reading, output), told)
            report = excitation_report(found, robot, out, motion.rate)
        write_trajectory(out, machine.joint_names, *found.trajectory.sampled(motion.rate))
        report = illustrated(report, output, lambda build: build.figures_of(build.FigureInput(excitation=found)))
    emit(report, output)


def _options(motion: MotionChoice, machine: Robot, reading: Reading, output: Output) -> ExciteOptions:
    """Return what to look for, after the last log where one is named."""
    from dataclasses import replace

    from elid_cli.cli.output import note
    from elid_cli.experiment.excitation import ExciteOptions

    choice = ExciteOptions(
        duration=motion.duration, interval=motion.interval, aims=motion.aims, residual=motion.residual, seed=motion.seed
    )
    if motion.after is None:
        return choice
    last = _last(motion.after, machine, reading, output)
    if not last.hidden and not motion.aims:
        note([f"{motion.after} shows every parameter that the robot can show; nothing special is aimed at"], output)
    choice = replace(choice, aims=tuple(dict.fromkeys((*motion.aims, *last.hidden))))
    return choice if _given("residual") else replace(choice, measured=last.residual)


def _show_stiffness(robot: str, motion: MotionChoice, out: str, output: Output) -> None:
    """Write the motion that shows stiffnesses, and say what it is."""
    from elid_cli.cli.output import emit
    from elid_cli.errors import UsageError
    from elid_cli.experiment.reference import write_trajectory
    from elid_cli.experiment.stiffness_motion import stiffness_motion
    from elid_cli.model.antiresonance import log_rate
    from elid_cli.report.answers.stiffness_motion import stiffness_motion_report

    _alone("--show-stiffness", ("aims", "after", "interval", "residual"), "it plans a motion of its own kind")
    duration = motion.duration if _given("duration") else SHOWN_FOR
    found = stiffness_motion(load_robot(robot), motion.show_stiffness, duration, motion.seed)
    rate = motion.rate if _given("rate") else log_rate(found.top)
    if rate < found.least_rate:
        raise UsageError(f"--rate {rate:g}: the multisine goes to {found.top:.3g} Hz",
                         hint=f"--rate {found.least_rate:.0f} or more")  # fmt: skip
    write_trajectory(out, found.robot.joint_names, *found.sampled(rate))
    emit(stiffness_motion_report(found, robot, out, rate), output)


def _alone(option: str, others: tuple[str, ...], detail: str) -> None:
    """Refuse options that do not go with one (UsageError)."""
    from elid_cli.errors import UsageError

    unused = ["--for" if name == "aims" else f"--{name.replace('_', '-')}" for name in others if _given(name)]
    if unused:
        raise UsageError(f"{option} does not go with {' and '.join(unused)}", detail=detail)


def _given(name: str) -> bool:
    """Return whether an option was on the command line."""
    import click

    return click.get_current_context().get_parameter_source(name) is ParameterSource.COMMANDLINE


def _last(after: str, machine: Robot, reading: Reading, output: Output) -> LastLog:
    """Return what the last log could not show, from its saved result or by identifying it."""
    from elid_cli.cli.inputs import load_recording
    from elid_cli.estimation.saved_results import is_result
    from elid_cli.experiment.last_log import last_of, read_last

    if is_result(after):
        return read_last(after, machine)
    from elid_cli.estimation.identify import EstimateOptions, identify
    from elid_cli.signals.signals import prepare

    signals = prepare(load_recording((after,), machine, reading, output), machine)
    return last_of(identify(machine, signals, EstimateOptions(fit="torque")))
