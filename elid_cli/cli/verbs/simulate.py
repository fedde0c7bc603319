"""Simulate a log: forward dynamics of the described robot, controller, sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from elid_cli.cli import options
from elid_cli.cli import simulate_options as simulating
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot
from elid_cli.cli.options import Output
from elid_cli.cli.simulate_options import Machine, MotionChoice
from elid_cli.cli.values import File

if TYPE_CHECKING:
    from elid_cli.experiment.simulation import ControlOptions, SensorOptions


@dataclass(frozen=True)
class Written:
    """Where the log goes."""

    out: str
    truth: str | None = None


@verb(
    "elid simulate --robot planar2 -o run.mcap",
    "elid simulate --robot puma560 -o run.h5 --duration 60 --counts 65536 --motor-side --torque-noise 1%",
)
@simulating.machine
@simulating.motion
@simulating.control
@simulating.sensors
@options.gathered(
    "written", Written,
    options.out("The log to write: .csv, .csv.gz, .h5 or .mcap.", metavar="LOG"),
    options.option(options.OUTPUT, "--truth", type=File(), metavar="LOG",
                   help="Write the exact signals to another log."),
)  # fmt: skip
@options.output
def simulate(
    machine: Machine,
    motion: MotionChoice,
    control: ControlOptions,
    friction_width: float,
    sensors: SensorOptions,
    written: Written,
    output: Output,
) -> None:
    """Simulate a robot with its reference parameters and effects, and write the log that its sensors would give.

    The reference runs through random way-points within the joints' limits; the motors are under PD control.
    """
    from pathlib import Path

    from elid_cli.cli.output import emit, note
    from elid_cli.cli.progress import progress
    from elid_cli.files import check_writable
    from elid_cli.logs.writing import writer_for

    for name in (written.out, written.truth):
        if name is not None:
            writer_for(name)
            check_writable(Path(name))
    with progress(output, "simulating") as advance:
        from dataclasses import replace

        from elid_cli.experiment import simulation
        from elid_cli.logs import write_recording
        from elid_cli.report.answers.simulation import simulation_report
        from elid_cli.robot.ideal import with_ideal_drives

        described = load_robot(machine.robot)
        if machine.ideal_drives:
            told = len(described.notes)
            described = with_ideal_drives(described)
            note(described.notes[told:], output)
        acting = replace(described, effects=(*described.effects, *simulating.effect_specs(machine.effects)))
        chosen = simulating.options_of(described, motion, control, friction_width, sensors)
        share = None if advance is None else lambda done: advance("simulating", done)
        result = simulation.run(acting, chosen, share)
        digest = write_recording(result.recording, written.out)
        if written.truth is not None:
            write_recording(simulation.exact(result), written.truth)
    emit(simulation_report(acting, simulation.filed(result, written.out, digest), chosen, machine.robot), output)
