"""Simulate a described robot under what a log commanded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import click

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output, Reading

if TYPE_CHECKING:
    from elid_cli.experiment.replay import Replay
    from elid_cli.robot.robot import Robot

SCALES = {"mrad": 1e-3, "rad": 1.0, "deg": 0.017453292519943295, "mm": 1e-3, "m": 1.0}

FAR = 0.1
"""rad or m that no replay is meant to be off by: whoever writes more without a unit means another one."""


class Distance(click.ParamType):  # type: ignore[type-arg]
    """An angle or a length: ``5mrad``, ``0.3deg``, ``2mm``; a bare number is in rad or m, and a small one."""

    name = "distance"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the value in rad or m."""
        text = str(value).strip()
        unit = next((name for name in SCALES if text.endswith(name)), "")
        try:
            number = float(text.removesuffix(unit))
        except ValueError:
            number = math.nan
        if not (0 < number < math.inf):
            self.fail(f"{value!r} is no distance; write 5mrad, 0.3deg or 2mm", param, ctx)
        if not unit and number > FAR:
            self.fail(f"{value} would be {value} rad, or m; write {value}mrad, {value}deg or {value}mm", param, ctx)
        return number * SCALES.get(unit, 1.0)


@dataclass(frozen=True)
class Way:
    """How a log is replayed, and beside which other robot."""

    against: str | None = None
    horizon: float | None = None
    engine: Literal["elid", "mujoco"] = "elid"
    commands: Literal["held", "smooth"] | None = None
    actuators: str | None = None


@verb(
    "elid replay run08.h5 --robot identified.xml",
    "elid replay run08.h5 run09.h5 --robot identified.yaml --against datasheet.yaml --max-error 5mrad",
)
@options.logs()
@options.robot
@options.reading
@options.gathered(
    "how", Way,
    options.option(options.INPUT, "--against", metavar="ROBOT",
                   help="Another robot file to replay on the same logs, beside the first."),
    options.option(options.FIT, "--horizon", type=values.Number(above=0), metavar="SECONDS",
                   help="Restart the simulation from the measured state at this interval. Default: never; every 0.5 s "
                   "for logs without commands, whose torque drives the robot."),
    options.option(options.FIT, "--engine", type=click.Choice(("elid", "mujoco")), default="elid", show_default=True,
                   help="Simulator: elid, or MuJoCo where it is installed. MuJoCo runs an MJCF as it is, in 1 ms "
                   "steps, and other robot files as exported to MJCF."),
    options.commands,
    options.option(options.INPUT, "--actuators", type=values.File(), metavar="FILE.json",
                   help="File of --write-actuators: offsets, delays and effects that a URDF or MJCF cannot hold."),
)  # fmt: skip
@options.option(
    options.GATES, "--max-error", type=Distance(), metavar="DISTANCE",
    help="Largest mean absolute error that is allowed at any joint: 5mrad, 0.3deg, 2mm.",
)  # fmt: skip
@options.output
def replay(
    logs: tuple[str, ...],
    robot: str,
    reading: Reading,
    how: Way,
    max_error: float | None,
    output: Output,
) -> None:
    """Simulate a robot file under what a log commanded, and say how far its positions are from the measured ones.
    Logs that hold no commands are replayed with their torque, in short pieces.
    """  # noqa: D205
    from elid_cli.cli.inputs import load_recording, load_robot
    from elid_cli.cli.output import LimitError, emit, illustrated
    from elid_cli.cli.progress import progress

    with progress(output, "reading") as advance:
        from elid_cli.errors import UsageError
        from elid_cli.estimation.smooth_commands import recorded_as_told
        from elid_cli.experiment.replay import ReplayOptions
        from elid_cli.experiment.replay import replay as simulate
        from elid_cli.experiment.replay.replay import pooled
        from elid_cli.report.answers.replay import replay_report

        machines = [load_robot(name) for name in (robot, *((how.against,) if how.against else ()))]
        if machines[-1].joint_names != machines[0].joint_names:
            detail = f"{', '.join(machines[-1].joint_names)} against {', '.join(machines[0].joint_names)}"
            raise UsageError(f"--against {how.against}: other joints than those of {machines[0].name}", detail=detail)
        if how.actuators is not None:
            from elid_cli.experiment.replay.actuators import with_actuators

            machines[0] = with_actuators(machines[0], how.actuators)
        found: list[list[Replay]] = [[] for _ in machines]
        for log in logs:
            like = None  # what was decided for the first robot counts for all
            for machine, replays in zip(machines, found, strict=True):
                recording = load_recording((log,), machine, reading, output, None, advance, label=log)
                like = recording = recorded_as_told(machine, recording, how.commands, like)
                way = ReplayOptions(how.horizon, how.engine, _as_it_stands(machine), how.commands)
                replays.append(simulate(machine, recording, way))
        report = replay_report(found[0], found[1] if how.against else (), (robot, how.against or ""))
        report = illustrated(
            report, output, lambda build: build.replay_figures(found[0][0], found[1][0] if how.against else None)
        )
    emit(report, output)
    sizes = {name: e.mean_abs for name, e in pooled(found[0]).items()}
    worst = max(sizes, key=lambda name: sizes[name])
    if max_error is not None and not sizes[worst] <= max_error:
        beyond = sum(not size <= max_error for size in sizes.values())
        raise LimitError(
            f"mean absolute error of {beyond} of {len(sizes)} joints exceeds --max-error {1e3 * max_error:.3g} mrad or "
            f"mm: {worst} {f'has {1e3 * sizes[worst]:.3g}' if math.isfinite(sizes[worst]) else 'ran away'}"
        )


def _as_it_stands(machine: Robot) -> str | None:
    """Return the MJCF that a robot is from, which MuJoCo can simulate itself."""
    from pathlib import Path

    from elid_cli.robot.files import is_mjcf

    return machine.source if machine.source and is_mjcf(Path(machine.source)) else None
