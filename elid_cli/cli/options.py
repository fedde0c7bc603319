"""Shared options and value types.

A verb says ``@options.source() @options.output def verb(source, output)``; options stand before or after the log.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeAlias

import click

from elid_cli.cli.color import CHOICES
from elid_cli.cli.group import Option
from elid_cli.cli.values import File, Held, Number, Numbers, ShareOfOne, Span, completing, robots
from elid_cli.signals.options import SignalOptions

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]

INPUT, SIGNALS, FIT, GATES, OUTPUT = "Input", "Signals", "Fit", "Gates for CI (exit 1)", "Output"


def option(heading: str, *names: str, **kwargs: Any) -> Decorator:
    """Return one option under a heading of the help."""
    return click.option(*names, cls=Option, heading=heading, **kwargs)


def gathered(name: str, kind: type | str, *options: Decorator) -> Decorator:
    """Return a decorator that adds options and hands their values over as one `kind`, as the argument `name`.

    The options are named as the fields of the dataclass `kind`; fields without an option keep their default. One of the
    core may be named, ``module:class``: it is imported when the command runs, not for its help.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(**values: Any) -> Any:
            made: Any = kind
            if isinstance(kind, str):
                module, _, own = kind.partition(":")
                made = getattr(import_module(module), own)
            chosen = {field.name: values.pop(field.name) for field in fields(made) if field.name in values}
            return function(**values, **{name: made(**chosen)})

        wrapped: Callable[..., Any] = call
        for add in reversed(options):
            wrapped = add(wrapped)
        return wrapped

    return decorate


def logs(*, required: bool = True) -> Decorator:
    """Return the argument LOG…; ``-`` reads CSV from stdin."""
    metavar = "LOG…" if required else "[LOG…]"
    return click.argument("logs", nargs=-1, required=required, type=File(), metavar=metavar)


TIP, LOCK = "elid.tip", "elid.lock"
"""Where the context keeps `--tip` and `--lock` for `load_robot`, whatever the command."""


def _kept(key: str) -> Callable[[click.Context, click.Parameter, Any], None]:
    return lambda ctx, _, value: ctx.meta.__setitem__(key, value)


def held(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that hold joints."""
    tip, lock = option(
        INPUT, "--tip", metavar="LINK", expose_value=False, callback=_kept(TIP),
        help="Keep only the joints from the base to this link (or joint); lock all others.",
    ), option(
        INPUT, "--lock", metavar="NAME=VALUE", multiple=True, type=Held(), expose_value=False, callback=_kept(LOCK),
        help="Lock a joint at a value in rad or m. Repeatable.",
    )  # fmt: skip
    return tip(lock(function))


def _robot(*, required: bool) -> Decorator:
    robot = _robot_option(required=required)
    return lambda function: robot(held(function))


def _robot_option(*, required: bool) -> Decorator:
    return option(
        INPUT, "--robot", metavar="ROBOT", envvar="ELID_ROBOT", required=required, show_envvar=True,
        shell_complete=completing(robots, files=True),
        help="Name of a robot that ships with elid (puma560), or a YAML, URDF or MJCF file.",
    )  # fmt: skip


robot, optional_robot = _robot(required=True), _robot(required=False)

maps = option(
    INPUT, "--map", "maps", metavar="MAP", multiple=True, type=File(),
    help="Where the log keeps its signals: a YAML file, or SIGNAL=PLACE. Repeatable.",
)  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """How logs are read."""

    maps: tuple[str, ...] = ()
    kp: float | list[float] | None = None
    kd: float | list[float] | None = None
    time: Literal["auto", "header", "log"] = "auto"
    strict: bool = False
    leave_out: tuple[tuple[float, float], ...] = ()


reading = gathered(
    "reading", Reading,
    maps,
    option(INPUT, "--kp", type=Numbers(), metavar="GAIN",
           help="Gain of the drives' position loops, N·m/rad at the joint, for logs without torque: one, or one per "
           "joint with commas."),
    option(INPUT, "--kd", type=Numbers(), metavar="GAIN",
           help="Gain of the drives' velocity loops, N·m·s/rad, given like --kp."),
    option(INPUT, "--time", type=click.Choice(("auto", "header", "log")), default="auto",
           help="Clock of an MCAP log: the messages' header stamps, or the times of logging."),
    option(INPUT, "--strict", is_flag=True,
           help="Refuse a log whose file is damaged, or whose samples are missing, wrong, repeated or out of order. "
           "Default: use its undamaged part."),
    option(INPUT, "--leave-out", type=Span(), multiple=True, metavar="START:STOP",
           help="Leave out this part of the log, in s from its first sample: a stop, a collision. Repeatable."),
)  # fmt: skip


commands = option(
    INPUT, "--commands", type=click.Choice(("held", "smooth")),
    help="Commands between the samples: held, or smooth, for a log that holds fewer of them than the drives were told. "
    "Default: from the motion.",
)  # fmt: skip


conditioning = gathered(
    "conditioning", SignalOptions,
    option(SIGNALS, "--cutoff", type=Number(above=0), metavar="HZ",
           help="Cut-off of the zero-phase low-pass. Default: from the log."),
    option(SIGNALS, "--rate", type=Number(above=0), metavar="HZ",
           help="Sample rate after decimation. Default: from the cut-off. For a log without time: its sample rate."),
    option(SIGNALS, "--min-velocity", type=Number(least=0), metavar="V",
           help="Leave out samples slower than V rad/s, where friction is undefined."),
    option(SIGNALS, "--measured-velocity/--no-measured-velocity", default=True,
           help="Use the velocities in the log where it has them, or always differentiate positions."),
    option(SIGNALS, "--knots", type=Number(above=0), metavar="S",
           help="Spacing of the smoothing splines' knots. Default: from the log."),
    commands,
)  # fmt: skip


@dataclass(frozen=True)
class Source:
    """Logs, the robot that made them, and how they are read and filtered."""

    logs: tuple[str, ...]
    robot: str
    reading: Reading
    conditioning: SignalOptions


def source(*, required: bool = True) -> Decorator:
    """Return the argument LOG… and the options of robot, reading and filter, handed over as one `Source`."""
    return gathered("source", Source, logs(required=required), robot, reading, conditioning)


@dataclass(frozen=True)
class Spread:
    """Who reads several logs."""

    jobs: int = 1
    scheduler: str | None = None


spread = gathered(
    "spread", Spread,
    option(INPUT, "--jobs", type=click.IntRange(min=1), default=1, metavar="N",
           help="Processes that read several logs at once."),
    option(INPUT, "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers read the logs: tcp://host:8786."),
)  # fmt: skip


fit = gathered(
    "fit", "elid_cli.estimation.result:EstimateOptions",
    option(FIT, "--estimator", type=click.Choice(("default", "paper")), default="default",
           help="paper: least squares as in Zollo et al. (2014), for comparison; noise biases it."),
    option(FIT, "--fit", type=click.Choice(("auto", "torque", "trajectory")), default="auto",
           help="What is fitted to the log. torque: the measured torque. trajectory: the measured motion, by "
                "simulation under the log's commands (masses and inertias stay those of the robot file); without "
                "commands, under the log's torque in short windows. auto: the torque; of a short log whose torque is "
                "computed from commands the motion."),
    option(FIT, "--accurate", is_flag=True,
           help="Estimate trajectory and parameters together: slower, and accurate also under strong noise."),
)  # fmt: skip


@dataclass(frozen=True)
class Gates:
    """Limits whose breach makes the exit code 1; the report is printed all the same."""

    max_error: float | None = None
    require_independent: tuple[str, ...] = ()
    fail_on_insufficient: bool = False


max_error = option(
    GATES, "--max-error", type=ShareOfOne(least=0), metavar="SHARE",
    help="Largest held-out torque error of any joint, in the worse of its equations, as a share of its torque: 0.05 or "
    "5%.",
)  # fmt: skip
require_independent = option(
    GATES, "--require-independent", multiple=True, metavar="NAME",
    help="Fail unless this parameter can be identified by itself. Repeatable.",
)  # fmt: skip
fail_on_insufficient = option(
    GATES, "--fail-on-insufficient", is_flag=True,
    help="Fail when the model lacks something: what is left follows the motion, or is several times the sensors' "
    "noise.",
)  # fmt: skip
gates = gathered("gates", Gates, max_error, require_independent, fail_on_insufficient)


@dataclass(frozen=True)
class Files:
    """Which files are written of a robot that was found."""

    write_robot: tuple[str, ...] = ()
    write_actuators: str | None = None
    drop_effects: bool = False


write_robot = option(
    OUTPUT, "--write-robot", type=File(), multiple=True, metavar="FILE.yaml",
    help="Write a robot file with the values that were found. .urdf, .xml: a copy of the robot's own file with new "
         "numbers, or a new file. Repeatable.",
)  # fmt: skip
write_actuators = option(
    OUTPUT, "--write-actuators", type=File(), metavar="FILE.json",
    help="Write armature, friction, delay and offset of every joint with standard errors, named as simulators "
         "do, and the effects that a URDF or MJCF cannot hold. .yaml: the same as YAML.",
)  # fmt: skip
drop_effects = option(
    OUTPUT, "--drop-effects", is_flag=True,
    help="Write a URDF or MJCF also where it cannot hold an effect that was found. The values are then those of a fit "
         "without the effect; a note says how much larger the error is.",
)  # fmt: skip
files = gathered("files", Files, write_robot, write_actuators, drop_effects)
check = option(
    INPUT, "--check", "checks", multiple=True, type=File(), metavar="LOG",
    help="Judge the result on this other log as well. Repeatable.",
)  # fmt: skip
held_out = option(
    INPUT, "--held-out", is_flag=True,
    help="Judge only on the stretches of the log that elid diagnose does not use in its search.",
)  # fmt: skip
seed = option(
    FIT, "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the random numbers.",
)  # fmt: skip


def out(meaning: str, *, required: bool = True, metavar: str = "FILE") -> Decorator:
    """Return the option ``-o`` of verbs that make a file."""
    return option(OUTPUT, "-o", "--output", "out", type=File(), metavar=metavar, required=required, help=meaning)


@dataclass(frozen=True)
class Output:
    """Where the report goes, and in which form; a place that could not be written to is refused (UsageError)."""

    json: bool = False
    markdown: bool = False
    report: tuple[str, ...] = ()
    plot: str | None = None
    plot_format: Literal["png", "svg"] = "png"
    everything: bool = False
    color: Literal["auto", "always", "never"] = "auto"
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.json and self.markdown:
            raise click.UsageError("--json and --markdown exclude each other", click.get_current_context(silent=True))
        if self.report or self.plot is not None:  # what could not be written is refused before any work
            from elid_cli.report import formats

            for name in self.report:
                formats.check_destination(Path(name))
            if self.plot is not None:
                formats.check_drawing(Path(self.plot), self.plot_format)


debug = option(OUTPUT, "--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
"""`main` looks for it among the arguments, as it is wanted of errors before they are read, too."""
output = gathered(
    "output", Output,
    option(OUTPUT, "--json", is_flag=True, help="Print one JSON object."),
    option(OUTPUT, "--markdown", is_flag=True, help="Print Markdown, for a pull request's comment."),
    option(OUTPUT, "--report", multiple=True, type=File(), metavar="FILE.html",
           help="Also write the whole report to a file; the suffix gives the format. Repeatable."),
    option(OUTPUT, "--plot", type=File(), metavar="DIR", help="Write the figures into a folder."),
    option(OUTPUT, "--plot-format", type=click.Choice(("png", "svg")), default="png", show_default=True,
           help="Format of the figures of --plot."),
    option(OUTPUT, "--all", "everything", is_flag=True, help="Print every row of long tables."),
    option(OUTPUT, "--color", type=click.Choice(CHOICES), default="auto", help="When to print in colour."),
    option(OUTPUT, "--quiet", is_flag=True, help="Print no progress and no notes on stderr."),
    debug,
)  # fmt: skip
