"""Options of ``elid simulate``, and what they mean to the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from elid_cli.cli.options import INPUT, gathered, option, robot
from elid_cli.cli.values import File, Number, Share, completing, effects

if TYPE_CHECKING:
    from elid_cli.experiment.simulation import ControlOptions, SensorOptions, SimulationOptions
    from elid_cli.robot.robot import EffectSpec, Robot

MOTION, CONTROL, SENSORS = "Motion", "Control", "Sensors"


class Numbers(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.5
    """One positive number for all joints, or one per joint: ``200`` or ``200,150,80``."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers, or fail with the one that is none."""
        if isinstance(value, tuple):
            return value
        number = Number(above=0)
        return tuple(number.convert(part.strip(), param, ctx) for part in str(value).split(","))


@dataclass(frozen=True)
class MotionChoice:
    """What the robot is asked to do."""

    duration: float | None = None
    rate: float = 1000.0
    seed: int = 0
    amplitude: float = 0.7
    speed: float = 1.0
    interval: float | None = None
    reference: str | None = None


@dataclass(frozen=True)
class Machine:
    """Which robot is simulated."""

    robot: str
    ideal_drives: bool = False
    effects: tuple[str, ...] = ()


motion = gathered(
    "motion", MotionChoice,
    option(MOTION, "--duration", type=Number(above=0), metavar="S",
           help="Length of the log. Default: 10 s, or that of --reference."),
    option(MOTION, "--rate", type=Number(above=0), default=1000.0, show_default=True, metavar="HZ",
           help="Samples per second of log and controller."),
    option(MOTION, "--seed", type=click.IntRange(min=0), default=0, show_default=True,
           help="Seed of way-points and noise; the same seed gives the same bytes."),
    option(MOTION, "--amplitude", type=Share(above=0), default=0.7, metavar="SHARE", show_default=True,
           help="Share of the joints' ranges in which way-points lie."),
    option(MOTION, "--speed", type=Number(above=0), default=1.0, metavar="FACTOR", show_default=True,
           help="Speed of the motion; 1: as fast as the joints' limits allow."),
    option(MOTION, "--interval", type=Number(above=0), metavar="S",
           help="Time between way-points. Default: from the joints' limits."),
    option(MOTION, "--reference", type=File(), metavar="TRAJ.csv",
           help="Follow this trajectory instead of random way-points: columns t and q.JOINT, as elid excite writes."),
)  # fmt: skip


control = gathered(
    "control", "elid_cli.experiment.simulation:ControlOptions",
    option(CONTROL, "--kp", type=Numbers(), metavar="N[,N…]",
           help="Position gains at the joints, N·m/rad. Default: from the inertia."),
    option(CONTROL, "--kd", type=Numbers(), metavar="N[,N…]", help="Velocity gains, N·m·s/rad."),
    option(CONTROL, "--feedforward", type=click.Choice(("model", "gravity", "none")), default="model",
           show_default=True,
           help="What the controller adds to its feedback: the torque of the whole model, of gravity alone, or none."),
    option(CONTROL, "--continuous", is_flag=True,
           help="Let the control torque change at every instant. Default: it is held over a sample, which delays it by "
           "half a sample."),
    option(CONTROL, "--friction-width", type=Number(above=0), default=5e-3, show_default=True, metavar="V",
           help="Speed over which Coulomb friction changes its sign, rad/s; for sliding joints a tenth of it, m/s."),
)  # fmt: skip


def _torque_noise(ctx: click.Context, _: click.Parameter, text: str) -> float:
    """Return N·m of a torque noise; one that is a share goes where the core takes shares."""
    size = Share(least=0).convert(text, None, None)
    ctx.params["torque_noise_relative"] = size if text.endswith("%") else 0.0
    return 0.0 if text.endswith("%") else size


sensors = gathered(
    "sensors", "elid_cli.experiment.simulation:SensorOptions",
    option(SENSORS, "--noise-db", type=Number(), metavar="DB",
           help="White noise on positions and velocities, dB below each channel's rms (80: 1e-4 of it)."),
    option(SENSORS, "--position-noise", type=Number(least=0), default=0.0, metavar="RAD",
           help="White noise on positions, standard deviation."),
    option(SENSORS, "--velocity-noise", type=Number(least=0), default=0.0, metavar="RAD/S",
           help="White noise on logged velocities."),
    option(SENSORS, "--torque-noise", default="0", metavar="N·m|SHARE", callback=_torque_noise,
           help="Noise on torques: in N·m, or as a share of each channel's rms (1%)."),
    option(SENSORS, "--torque-correlation", type=Number(least=0), default=0.0, metavar="S",
           help="Correlation time of the torque noise. Default: white."),
    option(SENSORS, "--counts", type=Number(above=0), metavar="N", help="Encoder counts per turn (per m, prismatic)."),
    option(SENSORS, "--motor-counts", type=Number(above=0), metavar="N", help="Counts of the motor encoders."),
    option(SENSORS, "--motor-side", is_flag=True,
           help="Counts of the motor encoders are per turn of the motor, before the gear."),
    option(SENSORS, "--velocities", is_flag=True, help="Log velocities too."),
    option(SENSORS, "--torque-sensor", "tau_link", is_flag=True, help="Log the torque through the transmissions too."),
    option(SENSORS, "--temperature", is_flag=True, help="Log motor temperatures too (a slow warm-up)."),
    option(SENSORS, "--gyro", multiple=True, metavar="JOINT",
           help="Log a gyroscope on the link that this joint moves, mounted in any direction. Repeatable."),
    option(SENSORS, "--gyro-noise", type=Number(least=0), default=0.0, metavar="RAD/S",
           help="White noise on the rates of gyroscopes."),
    option(SENSORS, "--accelerometer", "accel", multiple=True, metavar="JOINT",
           help="Log an accelerometer on the link that this joint moves, near the link's origin and mounted in any "
           "direction. Repeatable."),
    option(SENSORS, "--accelerometer-noise", "accel_noise", type=Number(least=0), default=0.0, metavar="M/S2",
           help="White noise on accelerometers."),
)  # fmt: skip

ideal_drives = option(
    INPUT, "--ideal-drives", is_flag=True,
    help="Where the robot file gives no friction or no rotor inertia, take 0. A URDF alone needs this.",
)  # fmt: skip

effect = option(
    INPUT, "--effect", "effects", multiple=True, metavar="EFFECT", shell_complete=completing(effects),
    help="Add an effect that the robot file does not declare, such as stribeck@joint1:amplitude=2,velocity=0.05."
    " Repeatable.",
)  # fmt: skip


machine = gathered("machine", Machine, robot, ideal_drives, effect)


def options_of(
    described: Robot, motion: MotionChoice, control: ControlOptions, friction_width: float, sensors: SensorOptions
) -> SimulationOptions:
    """Return the core's options (UsageError where they make no sense)."""
    from elid_cli.experiment.reference import Reference, ReferenceOptions, read_reference
    from elid_cli.experiment.simulation import SimulationOptions

    duration = motion.duration
    reference: Reference | ReferenceOptions = ReferenceOptions(motion.amplitude, motion.speed, motion.interval)
    if motion.reference is not None:
        reference = read_reference(motion.reference, described)
        duration = duration or reference.duration
    return SimulationOptions(
        duration=10.0 if duration is None else duration,
        rate=motion.rate,
        seed=motion.seed,
        reference=reference,
        control=control,
        sensors=sensors,
        friction_width=friction_width,
    )


def effect_specs(texts: tuple[str, ...]) -> tuple[EffectSpec, ...]:
    """Return the effects of ``--effect``, written NAME[@JOINT][:KEY=VALUE,…] (UsageError)."""
    from elid_cli.errors import UsageError, did_you_mean
    from elid_cli.model.effects import effect_classes
    from elid_cli.robot.expressions import evaluate
    from elid_cli.robot.robot import EffectSpec

    specs = []
    for text in texts:
        head, _, rest = text.partition(":")
        name, _, joint = head.partition("@")
        if name not in effect_classes():
            raise UsageError(f"--effect {text}: no effect {name!r}", hint=did_you_mean(name, effect_classes()))
        parameters = {}
        for item in rest.split(",") if rest else []:
            key, equals, value = item.partition("=")
            try:
                parameters[key.strip()] = evaluate(value.strip()) if equals else float("nan")
            except ValueError as problem:
                raise UsageError(f"--effect {text}: {key.strip()}: {problem}") from None
            if not equals:
                raise UsageError(f"--effect {text}: {item!r} is not KEY=VALUE")
        specs.append(EffectSpec(name, joint or None, parameters))
    return tuple(specs)
