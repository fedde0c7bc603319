"""Command logs of public robots simulated by MuJoCo: recovery, coverage, and which missing effect is named.

    python -m tests.system.reproduce.mujoco_logs [--logs N] [--first SEED] [--effects N] [--only ROBOT …]
                                                 [--named EFFECT …] [--friction default] [--held] [--torque] [--bodies]

The first table is of N clean logs per robot: how many armatures, frictions and offsets are within 3 % of the truth, and
how many 95 % intervals hold it. The second, of N logs per effect, says how often the one effect of the plant, at a
joint drawn at random, is named alone, among others that the log cannot tell apart, or not, and what else was named.

The plants' friction is as stiff as MuJoCo allows. With ``--friction default`` it is MuJoCo's own, which fades in over a
speed and acts ahead of it, and two more robots take part; ``--held`` fits friction that holds a joint at rest to all.

``--torque`` asks what least squares by computed torques say of clean logs instead: how many intervals of base
parameters hold the truth.

``--bodies`` asks whether the motion of clean logs asks for other bodies, as described and with the last body's mass,
first moment and inertia a few percent larger in the file; and which fit `identify` then chooses by itself.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs, fit_of
from elid_cli.logs.reading import read_recording
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.mujoco_plants import (
    FURTHER,
    KINDS,
    Drives,
    Extra,
    Plant,
    State,
    computed_torque,
    logged,
    plant_of,
    written,
)

NAMES = ("armature", "Coulomb", "viscous", "offset")
EFFECTS = ("link_spring", "position_friction", "stribeck", "load_friction", "quadratic_viscous", "torque_ripple",
           "saturation")  # fmt: skip
SOFT = "soft_friction"
CUT = 0.6
"""Part of the torque that the drive of a plant with saturation delivers at most, of what it gives for nearly all of
the time."""
WITHIN = 0.03
HEAVIER = (0.0, 0.01, 0.03, 0.1)


def read(plant: Plant, recording: Recording) -> Signals:
    """Return a log as elid reads it from a file."""
    with tempfile.TemporaryDirectory() as folder:
        return prepare(read_recording([written(Path(folder), recording)], plant.robot), plant.robot)


def fitted(plant: Plant, signals: Signals, *, soft: bool = True) -> TrajectoryFit:
    assert signals.recording is not None
    runs = commanded_runs(signals.recording, plant.robot)
    return fit_trajectory(plant.robot, runs, started_from(plant.robot, signals), soft=soft)


def clean(names: list[str], first: int, logs: int, *, default: bool = False, held: bool = False) -> None:
    """Print recovery and coverage, robot by robot."""
    head = "".join(f"{name:>18}" for name in NAMES)
    print(f"{'':10}{'logs':>5}{head}   delay off by\n{'':15}" + "   within 3 %  95 %" * 4 + "   ms, at most")
    every, fading = list[np.ndarray](), 0
    for name in names:
        plant, errors = plant_of(name, soft=default), list[np.ndarray]()
        late = []
        for seed in range(first, first + logs):
            recording, drives, delay = logged(plant, seed)
            fit = fitted(plant, read(plant, recording), soft=not held)
            fading += len(fit.unknowns.soft)
            deviation = fit.unknowns.joint_values(fit.deviation)
            errors.append(np.stack([fit.values / drives.truth - 1, (fit.values - drives.truth) / deviation]))
            late.append(1e3 * abs(float(fit.delays[0]) - delay))
        every.append(np.array(errors))
        line(name, logs, every[-1], f"{max(late):14.3f}")
    whole = np.concatenate([item.transpose(0, 2, 1, 3).reshape(-1, 2, 4) for item in every])
    z = whole[:, 1, :3]
    print(f"armature and friction: {100 * np.mean(np.abs(whole[:, 0, :3]) < WITHIN):.1f} % within 3 %, "
          f"{100 * np.mean(np.abs(z) < 1.96):.1f} % of {z.size} intervals hold the truth, rms z "
          f"{np.sqrt(np.mean(z**2)):.2f}, largest {np.abs(z).max():.1f}")  # fmt: skip
    print(f"friction fades in over a speed at {fading} of {len(whole)} joints")


def by_torque(names: list[str], first: int, logs: int) -> None:
    """Print how often intervals of least squares by computed torques hold the truth, robot by robot."""
    print(f"{'':10}{'logs':>5}   of 95 % intervals hold the truth, and rms z, of")
    print(f"{'':15}{'friction':>16}{'rotor inertias':>16}{'bodies':>16}   largest z")
    for name in names:
        plant, found = plant_of(name), list[np.ndarray]()
        for seed in range(first, first + logs):
            recording, drives, _ = logged(plant, seed)
            result = identify(plant.robot, read(plant, recording), EstimateOptions(fit="torque"))
            described = dict(zip(plant.robot.parameter_names(), plant.robot.reference(), strict=True))
            described |= {
                StandardParameter(kind, joint): drives.truth[joint, k]
                for joint in range(plant.robot.n)
                for k, kind in enumerate(("Ja", "fs", "fv"))
            }
            truth = result.base.transform @ np.array(list(described.values()))
            found.append((result.estimate - truth) / result.std_error)
        z, labels = np.array(found), [item.name for item in result.parameters]
        friction = np.array([label.startswith(("fs", "fv")) for label in labels])
        rotors = np.array(["Ja" in label for label in labels])
        told = ""
        for chosen in (friction, rotors, ~friction & ~rotors):
            part = z[:, chosen]
            part = part[np.isfinite(part)]  # what a log does not determine has no error
            told += f"{100 * np.mean(np.abs(part) < 1.96):10.0f}{np.sqrt(np.mean(part**2)):6.2f}"
        print(f"{name:10}{logs:5}{told}{np.nanmax(np.abs(z)):12.1f}", flush=True)


def by_bodies(names: list[str], first: int, logs: int) -> None:
    """Print how often other bodies are asked for, and which fit is chosen, by robot and error of the last body."""
    print(f"{'':10}{'logs':>5}   last body in the file: logs that ask for other bodies, logs fitted by motion")
    print(f"{'':15}" + "".join(f"{f'{100 * share:g} %':>14}" for share in HEAVIER))
    for name in names:
        plant, told = plant_of(name), ""
        signals = [read(plant, logged(plant, seed)[0]) for seed in range(first, first + logs)]
        for share in HEAVIER:
            joints = list(plant.robot.joints)
            own = {k: v * (1 + share) if k in LINK_PARAMETERS else v for k, v in joints[-1].parameters.items()}
            joints[-1] = replace(joints[-1], parameters=own)
            robot = replace(plant.robot, joints=tuple(joints))
            asked = moved = 0
            for item in signals:
                assert item.recording is not None
                found = identify(robot, item)
                asked += bool(fit_of(robot, item, item.recording)[1])
                moved += found.estimator == "trajectory"
            told += f"{asked:9}{moved:5}"
        print(f"{name:10}{logs:5}{told}", flush=True)


def line(name: str, logs: int, found: np.ndarray, more: str) -> None:
    part, z = np.moveaxis(found, 1, 0)
    shares = [(np.mean(np.abs(part[..., k]) < WITHIN), np.mean(np.abs(z[..., k]) < 1.96)) for k in range(len(NAMES))]
    print(f"{name:10}{logs:5}" + "".join(f"{100 * a:12.0f}{100 * b:6.0f}" for a, b in shares) + more, flush=True)


def extra_of(effect: str, joint: int, drives: Drives, reach: float) -> Extra:
    """Return an effect whose torque is of the size of the joint's Coulomb friction.

    What repeats with the angle does so within the motion: less than a period of it is any bend.
    """
    size, order = float(drives.coulomb[joint]), np.ceil(4 / reach)

    def push(s: State) -> float:
        return {
            "link_spring": 2.0 * size * s.x / reach,
            "quadratic_viscous": 0.5 * size * s.v * abs(s.v) / (2 * reach) ** 2,
            "torque_ripple": 0.5 * size * np.sin(order * s.x),
        }.get(effect, 0.0)

    def grip(s: State) -> float:
        return {
            "position_friction": 0.6 * size * np.sin(order * s.x + 1),
            "stribeck": 1.2 * size * np.exp(-abs(s.v) / (0.2 * reach)),
            "load_friction": 0.2 * abs(s.load),
        }.get(effect, 0.0)

    return Extra(joint, push, grip)


def lacking(plant: Plant, seed: int, effect: str, joint: int) -> tuple[Recording, Drives, float]:
    """Return a log of a plant with one effect at a joint, as `logged`."""
    if effect == "saturation":
        peak = float(np.quantile(np.abs(computed_torque(logged(plant, seed)[0])[:, joint]), 0.995))
        return logged(plant, seed, lambda d: Extra(joint, limit=CUT * peak))
    if effect == "clean":
        return logged(plant, seed)
    return logged(plant, seed, lambda d: extra_of(effect, joint, d, plant.kind.reach))


def diagnosed(names: list[str], first: int, logs: int, effects: list[str], *, default: bool = False) -> None:
    """Print which effects were named; friction that fades in, of plants that have it, is counted apart."""
    words = ("named", "in set", "wrong", "none")
    print(f"\n{'effect':20}" + "".join(f"{word:>8}" for word in words) + "   others named", flush=True)
    total, fading, joints = dict.fromkeys(words, 0), 0, 0
    for effect in effects:
        counts, others = dict.fromkeys(words, 0), list[str]()
        for number in range(logs):
            name, seed = names[number % len(names)], first + number
            plant = plant_of(name, soft=default)
            joint = int(np.random.default_rng([seed, len(effect)]).integers(plant.robot.n))
            recording, _, _ = lacking(plant, seed, effect, joint)
            found = diagnose_motion(plant.robot, read(plant, recording))
            at = plant.robot.joint_names[joint]
            fading += sum(e.effect == SOFT for e in found.effects)
            joints += plant.robot.n
            here = {e.effect for e in found.effects if e.joint == at and not (default and e.effect == SOFT)}
            beside = {r.effect for r in found.also_possible if r.joint == at}
            counts["named" if effect in here else "in set" if effect in beside else "wrong" if here else "none"] += 1
            others += [f"{e.effect} of {name} {e.joint}" for e in found.effects
                       if (e.effect, e.joint) != (effect, at) and not (default and e.effect == SOFT)]  # fmt: skip
        told = "".join(f"{counts[word]:8}" for word in words)
        print(f"{effect:20}{told}   {', '.join(others)}", flush=True)
        if effect != "clean":
            total = {word: total[word] + counts[word] for word in words}
    print(f"{'all with an effect':20}" + "".join(f"{total[word]:8}" for word in words))
    print(f"friction fades in over a speed at {fading} of {joints} joints")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=6)
    parser.add_argument("--effects", type=int, default=4)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--only", nargs="+", choices=KINDS | FURTHER, metavar="ROBOT")
    parser.add_argument("--friction", choices=("stiff", "default"), default="stiff")
    parser.add_argument(
        "--named", nargs="+", choices=("clean", *EFFECTS), default=["clean", *EFFECTS], metavar="EFFECT"
    )
    parser.add_argument("--held", action="store_true")
    parser.add_argument("--torque", action="store_true")
    parser.add_argument("--bodies", action="store_true")
    options = parser.parse_args()
    default = options.friction == "default"
    names = options.only or [*KINDS, *(FURTHER if default else ())]
    if options.bodies:
        by_bodies(names, options.first, options.logs)
        return
    if options.torque:
        by_torque(names, options.first, options.logs)
        return
    if options.logs:
        clean(names, options.first, options.logs, default=default, held=options.held)
    if options.effects:
        diagnosed(names, options.first, options.effects, options.named, default=default)


if __name__ == "__main__":
    main()
