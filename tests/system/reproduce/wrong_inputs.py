"""Wrong signs, units and channels, one at a time: what `identify` says of each.

    python -m tests.system.reproduce.wrong_inputs [--arms 2] [--first 1]

Per robot and fault prints of how many joints (or pairs) the warning names it, which are silent, and what else is said.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.unseen import SENSORS, arm, blind

Fault = tuple[str, str, str, Robot, Recording]
"""Kind, what it is of, words that a right warning holds (by |), the robot and the log."""


def faults(robot: Robot, log: Recording) -> Iterator[Fault]:
    """Yield every fault of one joint or pair, and of the whole log."""
    names = robot.joint_names
    for k, name in enumerate(names):
        for kind, field, words in (
            ("sign of u", "tau", f"torque of {name} looks|torque of {name} look"),
            ("sign of theta", "theta", f"theta of {name} moves against"),
            ("sign of q and theta", "", f"q and theta of {name}"),
        ):
            changed = {part: getattr(log, part).copy() for part in ((field,) if field else ("q", "theta"))}
            for values in changed.values():
                values[:, k] *= -1
            yield kind, name, words, robot, replace(log, **changed)
        joints = list(robot.joints)
        joints[k] = replace(joints[k], gear_ratio=-joints[k].gear_ratio)
        words = f"gear_ratio of {name}"
        yield "sign of gear_ratio", name, words, replace(robot, joints=tuple(joints)), log
    for a, b in combinations(range(len(names)), 2):
        both = {names[a], names[b]}
        for kind, field, what in (("swapped u", "tau", "torques"), ("swapped theta", "theta", "motor positions")):
            values = getattr(log, field).copy()
            values[:, [a, b]] = values[:, [b, a]]
            words = f"{what} of {names[a]} and {names[b]}|{what} of {names[b]} and {names[a]}"
            yield kind, "/".join(sorted(both)), words, robot, replace(log, **{field: values})
    degrees = replace(log, q=np.degrees(log.q), theta=np.degrees(log.theta))
    yield "degrees", "all", "degrees", robot, degrees


def told(robot: Robot, log: Recording) -> tuple[str, ...]:
    """Return the guards' sentences (and not those on values that came out negative)."""
    found = identify(robot, prepare(log, robot), EstimateOptions())
    return tuple(w for w in found.warnings if "look" in w or "moves against" in w or "contradict" in w)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=2, metavar="N", help="random arms of three joints")
    parser.add_argument("--first", type=int, default=1, metavar="SEED")
    chosen = parser.parse_args()
    robots = [read_robot("planar2"), read_robot("puma560")]
    robots += [arm(seed, 3) for seed in range(chosen.first, chosen.first + chosen.arms)]
    for robot in robots:
        log = simulate(robot, SimulationOptions(duration=12.0, seed=1, sensors=SENSORS))
        said: dict[str, list[tuple[str, bool, tuple[str, ...]]]] = {}
        print(f"{robot.name}: nothing wrong: {told(blind(robot), log) or 'silent'}")
        for kind, name, words, wrong, changed in faults(blind(robot), log):
            warnings = told(wrong, changed)
            right = any(word in warning for word in words.split("|") for warning in warnings)
            said.setdefault(kind, []).append((name, right, warnings))
        for kind, items in said.items():
            silent = [name for name, right, warnings in items if not right and not warnings]
            other = [f"{name}: {'; '.join(warnings)}" for name, right, warnings in items if not right and warnings]
            named = sum(right for _, right, _ in items)
            print(f"  {kind:20} named {named} of {len(items)}", end="")
            print(f", silent: {', '.join(silent)}" if silent else "", flush=True)
            for line in other:
                print(f"    otherwise: {line}")


if __name__ == "__main__":
    main()
