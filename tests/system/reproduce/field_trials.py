"""Trials of the diagnosis on random arms whose logs are made by inverse dynamics (see `inverse_logs`).

    python -m tests.system.reproduce.field_trials --arms 1 2 3 --joints 3 --db 90
    python -m tests.system.reproduce.field_trials --clean --arms 1 2 3 4 --counts 1.25e6 --torque-noise 0.003
    python -m tests.system.reproduce.field_trials --foreign
    python -m tests.system.reproduce.field_trials --robot planar2 --arms 1 2 --db 75 --torque-noise 0.003

One line per trial: what was said, and with `--told` the held-out error over that of a fit which is told the truth's
name and place. What is not named though that fit predicts no better is `faint`, or `unexplained` where it is said that
something is missing.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import FOREIGN, KNOWN, WHOLE, Laws, laws_of, log_of, make, recorded
from tests.system.reproduce.trials import said, verdict

SAME = {"stribeck_gauss": "stribeck"}
TOLD = {
    "stribeck": {"amplitude": 0.1, "velocity": 0.1, "exponent": 1.0},
    "stribeck_gauss": {"amplitude": 0.1, "velocity": 0.1, "exponent": 2.0},
}
"""What a fit that is told the effect must be told of its form, too."""
FAINT = 1.05
"""Held-out error over that of the told fit below which an effect that was not named cannot be seen: nothing false was
named, and who knows the effect predicts no better."""


@dataclass(frozen=True)
class Trial:
    """One log to make and to diagnose."""

    arm: int
    """Seed of the arm, if it is a random one, and of its drives and motion."""
    robot: str
    """A robot that comes with elid, whose bodies are taken; else empty."""
    joints: int
    heavy: bool
    effects: tuple[tuple[str, int], ...]
    rate: float
    duration: float
    db: float
    counts: float
    torque: float
    colour: float
    told: bool


def merged(parts: Sequence[Laws]) -> Laws:
    """Return several laws as one."""
    whole = Laws()
    for part in parts:
        whole.motor += part.motor
        whole.link += part.link
        whole.spring |= part.spring
        whole.sensors += part.sensors
        whole.gravity = whole.gravity or part.gravity
        whole.payload = whole.payload or part.payload
    return whole


def one(trial: Trial) -> tuple[Trial, str, str, float, float, float]:
    """Return the trial, its verdict, what was said, seconds, the largest ratio to the floor, and after over told."""
    bodies = read_robot(trial.robot) if trial.robot else None
    made = make(trial.arm, trial.joints, rate=trial.rate, duration=trial.duration, heavy=trial.heavy, bodies_of=bodies)
    signals = log_of(made, merged([laws_of(e, made, k) for e, k in trial.effects]))
    log = recorded(
        made, signals, db=trial.db, counts=trial.counts, torque=trial.torque, colour=trial.colour, seed=trial.arm
    )
    names = made.robot.joint_names
    specs = [
        EffectSpec(SAME.get(e, e), None if e in WHOLE else names[k], TOLD.get(e, {}))
        for e, k in trial.effects
        if e not in FOREIGN
    ]
    prepared = prepare(log, made.robot, SignalOptions.for_diagnosis(trial.rate))
    start = time.perf_counter()
    found = diagnose(made.robot, prepared)
    seconds = time.perf_counter() - start
    word = verdict(found, specs) if len(specs) == len(trial.effects) else foreign(found)
    share = float("nan")
    if trial.told and specs and len(specs) == len(trial.effects):
        told = diagnose(replace(made.robot, effects=tuple(specs)), prepared, DiagnoseOptions(only=("torque_offset",)))
        share = max(found.after[j].rms / told.before[j].rms for j in names)
        true = {(spec.effect, spec.joint) for spec in specs}
        if word in ("silent", "wrong") and share < FAINT and {(e.effect, e.joint) for e in found.effects} <= true:
            word = "unexplained" if found.unexplained else "faint"
    ratio = max(row.ratio for row in found.rows_after)
    return trial, word, said(found), seconds, ratio, share


def foreign(found: Diagnosis) -> str:
    """Return how an effect outside the library was answered."""
    if found.unexplained:
        return "unexplained" if not found.effects else "named+rest"
    return "named" if found.effects else "silent"


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--joints", type=int, default=3)
    parser.add_argument("--robot", default="", help="bodies of a robot that comes with elid, instead of random ones")
    parser.add_argument("--heavy", action="store_true")
    parser.add_argument("--effect", nargs="*", default=[])
    parser.add_argument("--foreign", action="store_true")
    parser.add_argument("--clean", action="store_true")
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--rate", type=float, default=500.0)
    parser.add_argument("--duration", type=float, default=15.0)
    parser.add_argument("--db", type=float, default=90.0)
    parser.add_argument("--counts", type=float, default=0.0, help="encoder counts per turn, instead of --db")
    parser.add_argument("--torque-noise", type=float, default=0.0)
    parser.add_argument("--colour", type=float, default=0.0)
    parser.add_argument("--told", action="store_true", help="compare with a fit that is told the effect")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    work = trials(options)
    tally: Counter[str] = Counter()
    shares = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for trial, word, text, seconds, ratio, share in pool.map(one, work):
            tally[word] += 1
            shares.append(share)
            what = "+".join(f"{e}@j{k + 1}" for e, k in trial.effects) or "clean"
            print(
                f"{word:12s} {trial.robot or 'arm'} {trial.arm:3d} {what:26s} {seconds:5.1f} s"
                f"  ratio {ratio:5.2f}  told {share:4.2f}  {text}",
                flush=True,
            )
    total = sum(tally.values())
    print(", ".join(f"{k} {v} ({v / total:.0%})" for k, v in tally.most_common()), f"of {total}")
    known = np.array(shares)[np.isfinite(shares)]
    if len(known):
        print(f"after within 1.3 of the told fit: {np.mean(known < 1.3):.0%} of {len(known)}")


def trials(options: argparse.Namespace) -> list[Trial]:
    """Return the trials that the command line asks for."""
    joints = read_robot(options.robot).n if options.robot else options.joints
    common = (
        options.rate, options.duration, options.db, options.counts, options.torque_noise, options.colour, options.told,
    )  # fmt: skip
    if options.clean:
        return [Trial(arm, options.robot, joints, options.heavy, (), *common) for arm in options.arms]
    names = options.effect or (FOREIGN if options.foreign else KNOWN)
    singles = [
        Trial(arm, options.robot, joints, options.heavy, ((name, k),), *common)
        for arm in options.arms
        for name in names
        for k in ((joints - 1,) if name == "payload" else (0,) if name in WHOLE else range(joints))
    ]
    if not options.pairs:
        return singles
    rng = np.random.default_rng(11)
    chosen: list[Trial] = []
    while len(chosen) < options.pairs:
        a, b = (singles[int(i)] for i in rng.choice(len(singles), 2, replace=False))
        springs = {("transmission_damping", "cubic_stiffness", "backlash", "hysteresis", "kinematic_error")}
        clash = a.effects[0][1] == b.effects[0][1] and all(x.effects[0][0] in next(iter(springs)) for x in (a, b))
        if a.arm == b.arm and a.effects[0][0] != b.effects[0][0] and not clash:
            chosen.append(replace(a, effects=(*a.effects, *b.effects)))
    return chosen


if __name__ == "__main__":
    main()
