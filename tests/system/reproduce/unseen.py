"""Robots that nobody has seen: random arms with offset axes and general inertias, identified blind.

    python -m tests.system.reproduce.unseen [--three 8] [--six 3] [--first 1]

Every arm is simulated in two motions with encoders of 1.25 M counts and 0.4 % torque noise. The first is identified
without any parameter value known; the second is predicted. Prints a line per arm: the worst error of a stiffness that
was given an answer, stiffnesses refused, and the worst joint's error of the motor torque of the unseen motion.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.robot import Joint, Limits, Robot
from elid_cli.signals.signals import prepare

DURATION = 12.0
SENSORS = SensorOptions(counts=1.25e6, torque_noise_relative=0.004)


def arm(seed: int, n: int) -> Robot:
    """Return an arm whose links taper, with axes that are offset and tilted, and springs of 8 to 20 Hz."""
    rng = np.random.default_rng(seed)
    bare = Robot(f"unseen{seed}", tuple(_joint(rng, i, n) for i in range(n)), gravity=(0.0, 0.0, -9.81))
    inertia = np.zeros(n)
    for q in rng.uniform(-1.4, 1.4, (20, n)):
        inertia += np.diag(Dynamics(bare, bare.reference()).mass_matrix(q.tolist()))[:n] / 20
    stiffness = inertia * (2 * np.pi * rng.uniform(8.0, 20.0, n)) ** 2
    joints = tuple(
        replace(joint, parameters={**joint.parameters, "K": float(k)})
        for joint, k in zip(bare.joints, stiffness, strict=True)
    )
    return replace(bare, joints=joints)


def _joint(rng: np.random.Generator, i: int, n: int) -> Joint:
    size = (1.0 - 0.75 * i / n) * rng.uniform(0.8, 1.2)
    mass = 12.0 * size**2
    a = float(rng.uniform(0.05, 0.4) * size)
    com = np.array([-a / 2, 0.0, 0.0]) + rng.normal(0.0, 0.04, 3)
    points = com + rng.normal(0.0, 0.08 * size + 0.02, (8, 3))
    tensor = sum(mass / 8 * (r @ r * np.eye(3) - np.outer(r, r)) for r in points) + 1e-3 * np.eye(3)
    first = mass / 8 * points.sum(axis=0)
    gear = float(rng.uniform(60, 120))
    values = {"m": mass, "cx": first[0], "cy": first[1], "cz": first[2]}
    values |= {"Ixx": tensor[0, 0], "Iyy": tensor[1, 1], "Izz": tensor[2, 2]}
    values |= {"Ixy": tensor[0, 1], "Ixz": tensor[0, 2], "Iyz": tensor[1, 2]}
    values |= {"Jm": 0.8 * size**4 * rng.uniform(0.5, 1.5) / gear**2, "fs": 6 * size**3, "fv": 4 * size**3, "K": 1e4}
    return Joint(
        f"joint{i + 1}",
        a=a,
        alpha=float(rng.choice([0.0, np.pi / 2, -np.pi / 2]) + rng.normal(0.0, 0.2)),
        d=float(rng.uniform(-0.15, 0.3) * size),
        gear_ratio=gear * float(rng.choice([-1.0, 1.0])),
        parameters={name: float(value) for name, value in values.items()},
        limits=Limits(position=(-1.5, 1.5), velocity=2.5, acceleration=12.0, torque=None),
    )


def blind(robot: Robot) -> Robot:
    """Return the robot without a single parameter value."""
    return replace(robot, joints=tuple(replace(joint, parameters={}) for joint in robot.joints))


def tried(robot: Robot, seed: int) -> tuple[float, list[str], float]:
    """Return the worst relative error of an answered stiffness, the refused ones, the worst unseen torque error."""
    seen, unseen = (
        simulate(robot, SimulationOptions(duration=DURATION, seed=s, sensors=SENSORS)) for s in (seed, seed + 1000)
    )
    unknown = blind(robot)
    found = identify(unknown, prepare(seen, unknown))
    truth = found.base.values(robot.reference())
    worst, refused = 0.0, []
    for k, name in enumerate(found.base.names):
        if not name.startswith("K"):
            continue
        if found.verdict[k] == "supported":
            worst = max(worst, abs(found.estimate[k] / truth[k] - 1.0))
        else:
            refused.append(f"{name} {found.verdict[k]}")
    known = identified_robot(found)
    error = validate(known, prepare(unseen, known)).error
    return worst, refused, max(e.relative for e in error.values())


def main() -> None:
    """Print a line per arm and how many are within 2 %."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--three", type=int, default=8, metavar="N", help="arms of three joints")
    parser.add_argument("--six", type=int, default=3, metavar="N", help="arms of six joints")
    parser.add_argument("--first", type=int, default=1, metavar="SEED")
    chosen = parser.parse_args()
    good = count = 0
    for n, arms in ((3, chosen.three), (6, chosen.six)):
        for seed in range(chosen.first, chosen.first + arms):
            begin = time.perf_counter()
            worst, refused, torque = tried(arm(seed, n), seed)
            fine = worst < 0.02 and torque < 0.02
            good, count = good + fine, count + 1
            said = f"; {', '.join(refused)}" if refused else ""
            print(
                f"{n} joints, arm {seed}: K within {worst:.2%}, unseen torque {torque:.2%}"
                f"{'' if fine else '  MISSED'}{said}  ({time.perf_counter() - begin:.0f} s)",
                flush=True,
            )
    print(f"{good} of {count} arms within 2 %")


if __name__ == "__main__":
    main()
