"""Diagnosis and intervals on simulated command logs with known truth, on a plant that shares no code with elid.

    python -m tests.system.reproduce.command_logs [--logs N] [--first SEED] [--only WORD] [--torque]

Prints, by effect, how often it was named alone, named among others that the log cannot tell apart, or not; what was
named on clean logs; and how often 95 % intervals of armature, friction and offset hold the truth. With ``--torque``,
how often those of least squares by computed torques do, on clean logs.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

AT = 1
"""Joint of the effect, from 0."""
ONLY = np.eye(3)[AT]
DELAYS = (0.0, 0.0025, 0.006)
"""s; by which commands act late, log by log."""


def at_joint(of: Callable[[float, float, float], float]) -> plant.Extra:
    return lambda x, v, load: ONLY * of(float(x[AT]), float(v[AT]), float(load[AT]))


EFFECTS: dict[str, dict[str, Any]] = {
    "clean": {},
    "link_spring": {"push": at_joint(lambda x, v, load: 1.2 * x)},
    "position_friction": {"grip": at_joint(lambda x, v, load: 0.12 * np.sin(4 * x + 1))},
    "stribeck": {"grip": at_joint(lambda x, v, load: 0.25 * np.exp(-abs(v) / 0.15))},
    "load_friction": {"grip": at_joint(lambda x, v, load: 0.15 * abs(load))},
    "quadratic_viscous": {"push": at_joint(lambda x, v, load: 0.08 * v * abs(v))},
    "torque_ripple": {"push": at_joint(lambda x, v, load: 0.08 * np.sin(12 * x))},
    "saturation": {"limit": np.where(ONLY > 0, 7.0, np.inf)},
    "torque_gain": {"gain": 1.0 + 0.15 * ONLY},
    "gravity_direction": {"tilt": 0.05},
    "encoder_zero": {"tilt": 0.05 * ONLY},
    "torque_delay": {"later": 0.004 * ONLY},
}
"""What the plant does: see `plant.moved`; by what the log's gains are too large; by how much drives are later."""


def diagnosed(folder: Path, robot: Robot, seed: int, delay: float, effect: dict[str, Any]) -> MotionDiagnosis:
    does = {name: value for name, value in effect.items() if name not in ("gain", "later")}
    recording = plant.moved(seed, 16.0, sweep=0.15, delay=delay + effect.get("later", 0.0), **does)
    for name in ("kp", "kd"):
        recording.commands[name][:] *= effect.get("gain", 1.0)  # type: ignore[index]
    log = plant.written(folder, "log.h5", recording)
    signals = prepare(read_recording([log], robot), robot)
    return diagnose_motion(robot, signals, identify(robot, signals, EstimateOptions(fit="torque", guards=False)))


def judged(name: str, found: MotionDiagnosis) -> tuple[str, list[str]]:
    """Return how an effect was told, and what else was named."""
    places = (plant.NAMES[AT], None)
    here = {e.effect for e in found.effects if e.joint in places}
    beside = {r.effect for r in found.also_possible if r.joint == plant.NAMES[AT]}
    others = [
        f"{e.effect}@{e.joint}" for e in found.effects if e.joint not in (plant.NAMES[AT], None) or e.effect != name
    ]
    word = "named" if name in here else "in set" if name in beside else "wrong" if here else "none"
    return word, others


def scores_of(found: MotionDiagnosis) -> list[float]:
    """Return errors of armature, friction and offset in standard errors."""
    truth = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS, plant.OFFSET], axis=1)
    fit = found.fit_after
    z: list[float] = ((fit.values - truth) / fit.unknowns.joint_values(fit.deviation)).ravel().tolist()
    return z


def by_torque(folder: Path, robot: Robot, first: int, logs: int) -> None:
    """Print how often intervals of least squares by computed torques hold the truth."""
    inertia = plant.INERTIA + plant.MASS * plant.REACH**2 + plant.ARMATURE
    scores = []
    for seed in range(first, first + logs):
        log = plant.written(folder, "log.h5", plant.moved(seed, 12.0, sweep=0.15))
        found = identify(robot, prepare(read_recording([log], robot), robot), EstimateOptions(fit="torque"))
        told = {item.name: (item.estimate, item.std_error) for item in found.parameters}
        for k in range(3):
            for name, truth in (
                (f"fs{k + 1}", plant.COULOMB[k]), (f"fv{k + 1}", plant.VISCOUS[k]),
                (f"Iyy{k + 1} + Ja{k + 1}", inertia[k]), (f"cz{k + 1}", -plant.MASS[k] * plant.REACH[k]),
            ):  # fmt: skip
                scores.append((told[name][0] - truth) / told[name][1])
    print(told_of(np.array(scores)))


def told_of(z: np.ndarray) -> str:
    inside, rms = np.mean(np.abs(z) < 1.96), np.sqrt(np.mean(z**2))
    return f"{len(z)} intervals: {inside:.1%} hold the truth, rms z {rms:.2f}, largest {np.abs(z).max():.1f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=4)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--only", default="")
    parser.add_argument("--torque", action="store_true")
    options = parser.parse_args()
    words, scores = ("named", "in set", "wrong", "none"), list[float]()
    print(f"{'effect':20}" + "".join(f"{word:>8}" for word in words) + "   others named")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        first = plant.written(folder, "log.h5", plant.moved(0, 1.0))
        robot = robot_as_logged(plant.robot(folder), [first], None, {})
        if options.torque:
            by_torque(folder, robot, options.first, options.logs)
            return
        for name, effect in EFFECTS.items():
            if options.only not in name:
                continue
            counts, others = dict.fromkeys(words, 0), list[str]()
            for seed in range(options.logs):
                found = diagnosed(folder, robot, options.first + seed, DELAYS[seed % len(DELAYS)], effect)
                word, more = judged(name, found)
                counts[word] += 1
                others += more
                scores += scores_of(found) if name == "clean" else []
            told = "".join(f"{counts[word]:8}" for word in words)
            print(f"{name:20}{told}   {', '.join(sorted(set(others)))}", flush=True)
    if scores:
        print(told_of(np.array(scores)))


if __name__ == "__main__":
    main()
