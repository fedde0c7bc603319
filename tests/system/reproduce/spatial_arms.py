"""Stiffness of spatial arms from motors, gyroscopes and accelerometers: how often it is given, how often it is wrong.

    python -m tests.system.reproduce.spatial_arms [LOGS] [FIRST] [--quiet]

LOGS logs (default 12), from number FIRST on (default 0), of `elid simulate`'s own dynamics: arms of two and three
joints in turn with a vertical first axis, fast motion that ends below the antiresonances, rotor inertias told up to
15 % wrongly, no link position. The log has accelerometers (20 mm/s²), both kinds (gyroscopes 2 mrad/s) or no sensors on
the links, in turn, positions to 2e-5 rad and torques to 0.3 %.

--quiet: positions to 2e-6 rad and torques to 0.05 %, and, after these arms, as many logs of `planar2` without sensors
on links. So little noise shows what the equations and the splines leave out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elid_cli.estimation.motor_side.estimate import motor_side
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Joint, Limits, Robot
from tests.system.reproduce.motor_side import Joint as Told
from tests.system.reproduce.motor_side import table

FAST = ReferenceOptions(speed=2.0, interval=0.35)
LOUD, QUIET = (2e-5, 0.003), (2e-6, 0.0005)
"""Noise of positions, rad, and of torques, share."""
SENSORS = {"accelerometers": (False, True), "gyros and accel.": (True, True), "no sensors": (False, False)}
ALPHA, A, D = (np.pi / 2, 0.0, np.pi / 2), (0.0, 0.4, 0.1), (0.4, 0.0, 0.0)
MASSES, WIDTHS, INERTIAS = (8.0, 7.0, 5.0), (0.3, 0.4, 0.3), (0.25, 0.2, 0.1)
CENTRES = ((0.0, -0.15, 0.0), (-0.2, 0.0, 0.02), (-0.03, 0.02, 0.08))
LIMITS = Limits(position=(-2.0, 2.0), velocity=2.5, acceleration=12.0, torque=2000.0)


def spatial_arm(seed: int, n: int) -> Robot:
    """Return an arm of up to three elastic joints with antiresonances of 4 to 14 Hz."""
    generator = np.random.default_rng([seed, 3])
    masses = generator.uniform(0.7, 1.3, 3) * MASSES
    joints = []
    for i, (mass, width) in enumerate(zip(masses[:n], WIDTHS, strict=False)):
        centre = np.array(CENTRES[i]) * generator.uniform(0.7, 1.3)
        own = mass * width**2 * generator.uniform(0.05, 0.12, 3)
        own[2] = min(own[2], 0.9 * (own[0] + own[1]))
        about = np.diag(own) + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        moved = 0.6 * masses[i:n].sum() * INERTIAS[i]
        gear = generator.uniform(60.0, 120.0)
        values = {
            "m": mass, "cx": mass * centre[0], "cy": mass * centre[1], "cz": mass * centre[2],
            "Ixx": about[0, 0], "Iyy": about[1, 1], "Izz": about[2, 2],
            "Ixy": about[0, 1], "Ixz": about[0, 2], "Iyz": about[1, 2],
            "Jm": moved * generator.uniform(0.2, 1.0) / gear**2,
            "K": moved * (2 * np.pi * generator.uniform(4.0, 9.0) * (1 + 0.25 * i)) ** 2,
            "fs": 0.15 * moved + 0.2, "fv": 0.12 * moved + 0.05,
        }  # fmt: skip
        joints.append(
            Joint(
                f"joint{i + 1}", a=A[i], alpha=ALPHA[i], d=D[i], gear_ratio=gear, transmission="elastic",
                parameters={name: float(value) for name, value in values.items()}, limits=LIMITS,
            )
        )  # fmt: skip
    return Robot(f"arm{seed}", tuple(joints), gravity=(0.0, 0.0, -9.81))


def judged(kind: str, robot: Robot, options: SimulationOptions) -> tuple[list[Told], float]:
    """Return what is said of the joints of one log without link positions, and the processor time, s."""
    log, rotors = simulate(robot, options), np.random.default_rng(options.seed)
    known = [{"Jm": joint.parameters["Jm"] * rotors.uniform(0.85, 1.15)} for joint in robot.joints]
    told = replace(
        robot, joints=tuple(replace(joint, parameters=own) for joint, own in zip(robot.joints, known, strict=True))
    )
    start = time.process_time()
    found = motor_side(told, replace(log, q=np.full_like(log.q, np.nan)), np.zeros(robot.n, dtype=bool))
    spent = time.process_time() - start
    assert found is not None
    rows = []
    for joint in found.joints:
        true = robot.joints[joint.number].parameters["K"]
        error = joint.stiffness / true - 1
        rows.append(Told(kind, joint.verdict, error, abs(error) * true / joint.std_error))
    return rows, spent


def logs(first: int, many: int, *, quiet: bool) -> Iterator[tuple[str, Robot, SimulationOptions]]:
    """Yield kind, robot and how it is simulated."""
    position, torque = QUIET if quiet else LOUD
    sensors = SensorOptions(position_noise=position, torque_noise_relative=torque)
    for number in range(first, first + many):
        kind = list(SENSORS)[number % len(SENSORS)]
        gyros, accelerometers = SENSORS[kind]
        robot = spatial_arm(number, 2 + number % 2)
        carried = replace(
            sensors,
            gyro=robot.joint_names if gyros else (), gyro_noise=2e-3,
            accel=robot.joint_names if accelerometers else (), accel_noise=0.02,
        )  # fmt: skip
        yield kind, robot, SimulationOptions(seed=number, reference=FAST, sensors=carried)
    for number in range(first, first + many) if quiet else ():
        yield "planar2", read_robot("planar2"), SimulationOptions(seed=number, sensors=sensors)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("logs", type=int, nargs="?", default=12)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("--quiet", action="store_true")
    asked = parser.parse_args()
    joints: list[Told] = []
    seconds: dict[str, list[float]] = {}
    for kind, robot, options in logs(asked.first, asked.logs, quiet=asked.quiet):
        found, spent = judged(kind, robot, options)
        joints += found
        seconds.setdefault(kind, []).append(spent)
        said = ", ".join(f"{joint.verdict} {100 * joint.error:+.2f}% ({joint.sigmas:.1f} errors)" for joint in found)
        print(f"{options.seed:4d} {kind:20} {spent:5.1f} s  {said}", file=sys.stderr, flush=True)
    print(table(joints, seconds, [*SENSORS, "planar2"]))


if __name__ == "__main__":
    main()
