"""Gains of drives from pairs of simulated logs, without and with a known payload: errors, and how often intervals hold.

    python -m tests.system.reproduce.drive_gains --seeds 20
    python -m tests.system.reproduce.drive_gains --robot planar2 --seeds 20 --torque-noise 0.05

Every log's torque is divided by the drives' true gains, which are drawn at random; then `identify --payload` is asked.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.estimation.drive_gains.identification import identify_with_payload
from elid_cli.estimation.drive_gains.payload import Payload
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.logs import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot


def loaded(robot: Robot, joint: str, mass: float, centre: np.ndarray, own: float) -> Robot:
    """Return the robot with a ball of `mass` kg at `centre` (m) on a joint's body, of `own` kg·m²."""
    tensor = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)) + own * np.eye(3)
    six = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    more = dict(zip(LINK_PARAMETERS, [mass, *(mass * centre), *six], strict=True))
    joints = [
        replace(j, parameters={**j.parameters, **{k: j.parameters.get(k, 0.0) + v for k, v in more.items()}})
        if j.name == joint
        else j
        for j in robot.joints
    ]
    return replace(robot, joints=tuple(joints))


def stiff(robot: Robot) -> Robot:
    """Return the robot with rigid joints."""
    kept = ({k: v for k, v in j.parameters.items() if k != "K"} for j in robot.joints)
    joints = (replace(j, transmission="rigid", parameters=p) for j, p in zip(robot.joints, kept, strict=True))
    return replace(robot, joints=tuple(joints))


def pair(
    robot: Robot, payload: tuple[Robot, float], gains: np.ndarray, folder: Path, seed: int, *,
    noise: float, duration: float, rate: float,
) -> list[str]:  # fmt: skip
    """Write two logs, the second of the robot with its payload, torque in units of the gains; return their names."""
    sensors = SensorOptions(noise_db=90, torque_noise_relative=noise)
    paths = []
    for k, machine in enumerate((robot, payload[0])):
        log = simulate(machine, SimulationOptions(duration=duration, rate=rate, seed=2 * seed + k, sensors=sensors))
        path = folder / f"{('empty', 'loaded')[k]}{seed}.h5"
        write_recording(replace(log, tau=log.tau / gains), path)
        paths.append(str(path))
    return paths


def trial(
    robot: Robot, joint: str, mass: float, seed: int, *, noise: float, duration: float, rate: float
) -> tuple[np.ndarray, Identification]:
    """Return the true gains and what was found."""
    rng = np.random.default_rng(seed)
    gains = rng.uniform(0.3, 30.0, robot.n)
    heavy = loaded(robot, joint, mass, rng.uniform(-0.05, 0.1, 3), 0.002 * mass)
    unknown = replace(robot, joints=tuple(replace(j, parameters={}) for j in robot.joints))
    with tempfile.TemporaryDirectory() as folder:
        logs = pair(robot, (heavy, mass), gains, Path(folder), seed, noise=noise, duration=duration, rate=rate)
        request = LogRequest(logs, unknown)
        found = identify_with_payload(request, EstimateOptions(), Payload(mass, joint)).found
    return gains, found


def main() -> None:
    """Print a line per trial and the tally."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="puma560")
    parser.add_argument("--elastic", action="store_true")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--mass", type=float, default=2.805)
    parser.add_argument("--joint", default="")
    parser.add_argument("--torque-noise", type=float, default=0.02)
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=250.0)
    options = parser.parse_args()
    robot = read_robot(options.robot)
    robot = robot if options.elastic else stiff(robot)
    joint = options.joint or robot.joint_names[-1]
    held, total, shares = np.zeros(robot.n), np.zeros(robot.n), []
    for seed in range(options.seeds):
        truth, found = trial(
            robot, joint, options.mass, seed,
            noise=options.torque_noise, duration=options.duration, rate=options.rate,
        )  # fmt: skip
        words = []
        for k, item in enumerate(found.drive_gains):
            if item.gain is None or item.std_error is None or item.interval is None:
                words.append("refused")
                continue
            off, deviation = item.gain / truth[k] - 1, item.std_error / truth[k]
            held[k] += item.interval[0] < truth[k] < item.interval[1]
            total[k] += 1
            shares.append((off, deviation))
            words.append(f"{off:+.2%} ± {deviation:.2%}")
        print(f"seed {seed:2d}  " + "  ".join(words), flush=True)
    for name, inside, count in zip(robot.joint_names, held, total, strict=True):
        print(f"{name}: 95 % interval holds {inside:.0f} of {count:.0f}")
    z = np.array([off / deviation for off, deviation in shares])
    print(
        f"all: {held.sum():.0f} of {total.sum():.0f} ({held.sum() / total.sum():.0%}), rms error over sd {z.std():.2f}"
    )


if __name__ == "__main__":
    main()
