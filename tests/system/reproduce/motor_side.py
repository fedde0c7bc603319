"""Stiffness from the motor side alone on simulated arms: how often it is given, and how often it is wrong.

    python -m tests.system.reproduce.motor_side [LOGS] [FIRST] [--beyond | --gyros | --accelerometers]

LOGS logs (default 26), from number FIRST on (default 0), of planar arms that a second simulator moves
(`tests/system/motor_arms.py`): every log has its own arm, motion, noise (80, 70, 60 dB in turn) and rotor inertias told
up to 20 % wrongly. Takes some 2 to 8 s of processor time per log of two joints. Interrupted, it prints the table of the
logs so far.

--beyond: arms and logs other than those that the thresholds were set for: more joints, coarser encoders, other sample
rates, gears with a kinematic error, links with a mode of their own.
--gyros: motion below the antiresonances, a gyroscope on every link (noise 2 mrad/s, 2 ms late, scale errors of 1 %).
--accelerometers: the same with an accelerometer anywhere on every link (noise 20 mm/s², likewise).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from elid_cli.estimation.motor_side.estimate import motor_side
from tests.system.motor_arms import Case, motor_log, random_motor_arm, told_robot

LEVELS = (80.0, 70.0, 60.0)
WRONG, WRONG_WEAK, SURE = 0.05, 0.10, 3.0


@dataclass(frozen=True)
class Kind:
    """A kind of logs."""

    name: str
    """At most 20 letters, for the table."""
    case: Case
    joints: int = 2
    rigid: tuple[int, ...] = ()
    load: tuple[float, float] = (0.0, 0.0)
    """Load friction, share of the transmission's torque: from, to."""
    stribeck: bool = False
    lost: bool = False
    damping: bool = False
    kinematic: tuple[float, float] = (0.0, 0.0)
    """Kinematic error, rad: from, to."""
    told_elastic: bool = False
    """Whether the robot file says elastic of rigid joints, too."""


CROSS = Case()
KINDS = (
    Kind("past the resonances", CROSS),
    Kind("… first joint rigid", CROSS, rigid=(0,)),
    Kind("… Stribeck", CROSS, stribeck=True),
    Kind("… load friction", CROSS, load=(0.02, 0.1)),
    Kind("… load and Stribeck", CROSS, load=(0.02, 0.1), stribeck=True),
    Kind("… damped springs", CROSS, damping=True),
    Kind("… lost motion", CROSS, lost=True),
    Kind("below resonances", replace(CROSS, kind="below")),
    Kind("smooth motion", replace(CROSS, kind="smooth")),
    Kind("rigid arm", CROSS, rigid=(0, 1), told_elastic=True),
    Kind("rigid, load friction", CROSS, rigid=(0, 1), load=(0.02, 0.1), told_elastic=True),
    Kind("one joint", CROSS, joints=1),
    Kind("three joints", CROSS, joints=3),
)
BEYOND = (
    Kind("14 bit", replace(CROSS, bits=14)),
    Kind("17 bit", replace(CROSS, bits=17)),
    Kind("250 Hz", replace(CROSS, rate=250.0)),
    Kind("500 Hz", replace(CROSS, rate=500.0)),
    Kind("2 kHz", replace(CROSS, rate=2000.0)),
    Kind("kinematic error", CROSS, kinematic=(2e-5, 2e-4)),
    Kind("link mode, 25 Hz", replace(CROSS, link_mode=(0.1, 25.0))),
    Kind("link mode, 60 Hz", replace(CROSS, link_mode=(0.1, 60.0))),
    Kind("six joints", CROSS, joints=6),
    Kind("six, to 26-44 Hz", replace(CROSS, top=(26.0, 44.0)), joints=6),
)
SEEN = replace(CROSS, kind="smooth", gyros=(0, 1))
WITH_GYROS = (
    Kind("smooth, gyros", SEEN),
    Kind("gyros, friction", SEEN, load=(0.02, 0.1), stribeck=True),
    Kind("gyros, lost motion", SEEN, lost=True),
    Kind("below, gyros", replace(SEEN, kind="below")),
    Kind("17 bit, gyros", replace(SEEN, bits=17)),
    Kind("rigid arm, gyros", SEEN, rigid=(0, 1), told_elastic=True),
    Kind("one joint, gyro", replace(SEEN, gyros=(0,)), joints=1),
    Kind("three joints, gyros", replace(SEEN, gyros=(0, 1, 2)), joints=3),
)

FELT = replace(CROSS, kind="smooth", accelerometers=(0, 1))
WITH_ACCELEROMETERS = (
    Kind("smooth, accel.", FELT),
    Kind("accel., friction", FELT, load=(0.02, 0.1), stribeck=True),
    Kind("accel., lost motion", FELT, lost=True),
    Kind("below, accel.", replace(FELT, kind="below")),
    Kind("cross, accel.", replace(FELT, kind="cross")),
    Kind("17 bit, accel.", replace(FELT, bits=17)),
    Kind("rigid arm, accel.", FELT, rigid=(0, 1), told_elastic=True),
    Kind("one joint, accel.", replace(FELT, accelerometers=(0,)), joints=1),
    Kind("three joints, accel.", replace(FELT, accelerometers=(0, 1, 2)), joints=3),
    Kind("gyros and accel.", replace(FELT, gyros=(0, 1))),
)


@dataclass(frozen=True)
class Joint:
    """What was said of one joint, and what is true."""

    kind: str
    verdict: str
    error: float
    """Share of the true stiffness; infinite for a rigid joint."""
    sigmas: float


def judged(number: int, kinds: Sequence[Kind] = KINDS) -> tuple[list[Joint], float]:
    """Return what is said of the joints of one log, and the processor time, s."""
    kind = kinds[number % len(kinds)]
    generator = np.random.default_rng([number, 77])
    arm = random_motor_arm(generator, kind.joints, kind.rigid)
    case = replace(kind.case, signal_to_noise=LEVELS[(number // len(kinds)) % len(LEVELS)])
    if kind.load[1]:
        case = replace(case, load_friction=generator.uniform(*kind.load, kind.joints))
    if kind.stribeck:
        case = replace(case, stribeck=arm.coulomb * generator.uniform(0.3, 1.0, kind.joints))
    if kind.lost:
        case = replace(case, lost=generator.uniform(1e-4, 3e-4, kind.joints))
    if kind.kinematic[1]:
        case = replace(case, kinematic=np.exp(generator.uniform(*np.log(kind.kinematic), kind.joints)))
    if kind.damping:
        case = replace(case, damping=generator.uniform(0.5e-3, 2e-3, kind.joints))
    log = motor_log(arm, number, case)
    if kind.told_elastic:
        log = replace(log, q=np.full_like(log.q, np.nan))
    robot = told_robot(arm, number, elastic=kind.told_elastic)
    start = time.process_time()
    found = motor_side(robot, log, np.zeros(arm.n, dtype=bool))
    spent = time.process_time() - start
    assert found is not None
    told = []
    for joint in found.joints:
        true = arm.stiffness[joint.number]
        error = joint.stiffness / true - 1 if np.isfinite(true) else np.inf
        told.append(Joint(kind.name, joint.verdict, error, abs(error) * true / joint.std_error))
    return told, spent


def table(joints: Iterable[Joint], seconds: dict[str, list[float]], kinds: Sequence[str]) -> str:
    """Return the table of all kinds, in their order."""
    everything = list(joints)
    lines = [f"{'motion':20} joints shown wrong >3se weak wrong none median   max s/log"]
    for name in [*(kind for kind in kinds if kind in seconds), "all"]:
        own = [joint for joint in everything if name in ("all", joint.kind)]
        good = [joint for joint in own if joint.verdict == "supported"]
        weak = [joint for joint in own if joint.verdict == "weak"]
        sizes = [abs(joint.error) for joint in good]
        spent = [s for kind, times in seconds.items() if name in ("all", kind) for s in times]
        counts = (
            len(own), len(good), sum(size > WRONG for size in sizes), sum(joint.sigmas > SURE for joint in good),
            len(weak), sum(abs(joint.error) > WRONG_WEAK for joint in weak), len(own) - len(good) - len(weak),
        )  # fmt: skip
        middle, most = (f"{100 * f(sizes):.2f}%" if sizes else "" for f in (np.median, max))
        widths = (6, 5, 5, 4, 4, 5, 4)
        row = " ".join(f"{count:{width}d}" for count, width in zip(counts, widths, strict=True))
        lines.append(f"{name:20} {row} {middle:>6} {most:>5} {np.mean(spent):5.1f}")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("logs", type=int, nargs="?", default=26)
    parser.add_argument("first", type=int, nargs="?", default=0)
    others = parser.add_mutually_exclusive_group()
    others.add_argument("--beyond", action="store_true")
    others.add_argument("--gyros", action="store_true")
    others.add_argument("--accelerometers", action="store_true")
    told = parser.parse_args()
    kinds = BEYOND if told.beyond else WITH_GYROS if told.gyros else KINDS
    kinds = WITH_ACCELEROMETERS if told.accelerometers else kinds
    joints: list[Joint] = []
    seconds: dict[str, list[float]] = {}
    with suppress(KeyboardInterrupt):
        for number in range(told.first, told.first + told.logs):
            found, spent = judged(number, kinds)
            joints += found
            seconds.setdefault(found[0].kind, []).append(spent)
            said = ", ".join(
                f"{joint.verdict} {100 * joint.error:+.2f}% ({joint.sigmas:.1f} errors)" for joint in found
            )
            print(f"{number:4d} {found[0].kind:27} {spent:5.1f} s  {said}", file=sys.stderr, flush=True)
    print(table(joints, seconds, [kind.name for kind in kinds]))


if __name__ == "__main__":
    main()
