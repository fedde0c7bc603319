"""Find an exciting trajectory: within the robot's limits, and telling most about its parameters."""

from __future__ import annotations

from elid_cli.commands import options
from elid_cli.commands.group import verb
from elid_cli.commands.options import Output
from elid_cli.commands.values import Number, Share

MOTION = "Trajectory"


@verb(
    "elid excite --robot puma560 -o excite.csv",
    "elid excite --robot puma560 -o wrist.csv --for Izz6 --for Jm6 --duration 30",
)
@options.robot
@options.option(MOTION, "--for", "aims", multiple=True, metavar="NAME",
                help="Parameter that the log must show above all, such as Izz6. Repeatable.")
@options.option(MOTION, "--duration", type=Number(above=0), default=20.0, show_default=True, metavar="S",
                help="Length of the trajectory.")
@options.option(MOTION, "--rate", type=Number(above=0), default=250.0, show_default=True, metavar="HZ",
                help="Samples per second in the file.")
@options.option(MOTION, "--interval", type=Number(above=0), metavar="S",
                help="Time between the splines' way-points. Default: from each joint's limits.")
@options.option(MOTION, "--residual", type=Share(above=0), default="2%", show_default=True, metavar="SHARE",
                help="Expected torque residual after filtering, as a share of the torque; scales standard errors.")
@options.seed
@options.out("The trajectory to write, CSV: t, q, dq, ddq of every joint.", metavar="TRAJ.csv")
@options.output
def excite(
    robot: str,
    aims: tuple[str, ...],
    duration: float,
    rate: float,
    interval: float | None,
    residual: float,
    seed: int,
    out: str,
    output: Output,
) -> None:
    """Find a trajectory whose log tells most about the base parameters, from rest to rest within the joints' limits.

    Limits and reference values come from the robot file. The report says which standard errors to expect.
    """
    from pathlib import Path

    from elid_cli.atomic import check_writable
    from elid_cli.commands.emit import check_output, emit
    from elid_cli.commands.progress import progress

    check_output(output)
    check_writable(Path(out))
    with progress(output, "optimising") as advance:
        from elid_cli.excitation import ExciteOptions
        from elid_cli.excitation import excite as find
        from elid_cli.reports.excitation import excitation_report
        from elid_cli.robot_file import read_robot
        from elid_cli.trajectory_file import write_trajectory

        machine = read_robot(robot)
        choice = ExciteOptions(duration=duration, interval=interval, aims=aims, residual=residual, seed=seed)
        found = find(machine, choice, None if advance is None else lambda share: advance("optimising", share))
        write_trajectory(out, machine.joint_names, *found.sampled(rate))
    emit(excitation_report(found, robot, out, rate), output)
