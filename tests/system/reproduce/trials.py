"""Trials of the diagnosis: every effect of the library on every joint, undeclared, named or not.

    python -m tests.system.reproduce.trials --robot planar2 --db 90 --seeds 2 --jobs 2
    python -m tests.system.reproduce.trials --clean 20 --db 80 --torque-noise 0.003

Noise-free logs are simulated once and kept in --cache; noise is added per condition, so that all conditions see the
same motion. Prints one line per trial and the table: named right / in the set / nothing said / wrong.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.experiment.simulation import SimulationOptions, run
from elid_cli.model.effects import effect_classes
from elid_cli.robot.files import fingerprint, read_robot
from elid_cli.robot.robot import EffectSpec, Joint, Limits, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare

SKIPPED = {"lookup", "sensor_gain", "sensor_offset"}
DURATION = 15.0
RATE = 1000.0
FRICTION = {"fs": (6.0, 3.0, 2.0), "fv": (2.0, 1.0, 0.6)}


def arm3() -> Robot:
    """Return a three-joint arm with offset axes and general inertias."""
    rng = np.random.default_rng(7)
    shapes = [(0.05, np.pi / 2, 0.35), (0.4, 0.1, 0.02), (0.32, -0.2, 0.05)]
    bodies = [(9.0, 0.15), (6.0, 0.2), (3.0, 0.16)]
    joints = []
    for i, ((a, alpha, d), (mass, reach)) in enumerate(zip(shapes, bodies, strict=True)):
        com = np.array([-reach, 0.02, 0.03]) * rng.uniform(0.8, 1.2, 3)
        spread = mass * np.diag([0.006, 0.03, 0.032]) * rng.uniform(0.8, 1.2) + 0.004 * mass * np.eye(3)
        tensor = spread + mass * (com @ com * np.eye(3) - np.outer(com, com))
        values = dict(zip(("cx", "cy", "cz"), (mass * com).tolist(), strict=True))
        values |= {"m": mass, "Ixx": tensor[0, 0], "Iyy": tensor[1, 1], "Izz": tensor[2, 2]}
        values |= {"Ixy": tensor[0, 1], "Ixz": tensor[0, 2], "Iyz": tensor[1, 2]}
        values |= {"Jm": (1.5e-4, 1.2e-4, 0.6e-4)[i], "K": (9000.0, 7000.0, 3500.0)[i]}
        limits = Limits(position=(-1.4, 1.4), velocity=2.5, acceleration=12.0, torque=None)
        joints.append(Joint(f"joint{i + 1}", a=a, alpha=alpha, d=d, gear_ratio=100.0, parameters=values, limits=limits))
    return Robot("arm3", tuple(joints), gravity=(0.0, 0.0, -9.81))


def with_friction(robot: Robot) -> Robot:
    """Return the robot with friction of a size that gears have."""
    joints = tuple(
        replace(j, parameters={**j.parameters, **{k: v[min(i, 2)] for k, v in FRICTION.items()}})
        for i, j in enumerate(robot.joints)
    )
    return replace(robot, joints=joints, effects=())


def robot_named(name: str) -> Robot:
    """Return a trial robot."""
    if name == "arm3":
        return with_friction(arm3())
    robot = read_robot(name)
    return with_friction(robot) if name == "planar2" else replace(robot, effects=())


def clean_log(robot: Robot, seed: int, cache: Path) -> Recording | None:
    """Simulate a noise-free log, or take it from the cache; None where the simulation fails."""
    specs = [(e.effect, e.joint, sorted(e.parameters.items())) for e in robot.effects]
    plain = fingerprint(replace(robot, effects=())) + json.dumps([dict(j.parameters) for j in robot.joints])
    key = hashlib.sha256(json.dumps([plain, specs, seed, DURATION, RATE]).encode()).hexdigest()[:24]
    file = cache / f"{key}.npz"
    if not file.exists():
        try:
            recording = run(robot, SimulationOptions(duration=DURATION, rate=RATE, seed=seed)).recording
        except Exception as error:  # a trial that cannot be simulated is reported, not fatal
            print(f"simulation failed: {robot.name} {specs}: {error}", file=sys.stderr)
            return None
        part = file.with_suffix(f".{seed}.part.npz")
        np.savez(part, q=recording.q, theta=recording.theta, tau=recording.tau)
        part.rename(file)
    data = np.load(file)
    n = len(data["q"])
    return Recording(
        robot.joint_names, 1 / RATE, np.arange(n) / RATE, data["q"], data["theta"], data["tau"],
        segments=(Segment(0, n),),
    )  # fmt: skip


def noisy(recording: Recording, db: float, torque: float, colour: float, seed: int) -> Recording:
    """Add white position noise of `db` dB and torque noise of a share of the rms, AR(1) with time constant `colour`."""
    rng = np.random.default_rng([seed, 99])

    def jitter(channel: np.ndarray) -> np.ndarray:
        size = np.sqrt(np.mean((channel - channel.mean(axis=0)) ** 2, axis=0)) * 10 ** (-db / 20)
        return channel + size * rng.standard_normal(channel.shape)

    noise = rng.standard_normal(recording.tau.shape)
    if colour:
        from scipy.signal import lfilter

        rho = np.exp(-recording.dt / colour)
        noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=0)
    tau = recording.tau + torque * np.sqrt(np.mean(recording.tau**2, axis=0)) * noise
    return replace(recording, q=jitter(recording.q), theta=jitter(recording.theta), tau=tau)


@dataclass(frozen=True)
class Scales:
    """Sizes of a joint's signals in a clean log."""

    tau: float
    speed: float
    span: float
    deflection: float
    top: float


def scales(recording: Recording, k: int) -> Scales:
    """Return the sizes that truths are scaled by."""
    e = recording.q[:, k] - recording.theta[:, k]
    speed = np.abs(np.gradient(recording.theta[:, k], recording.dt))
    return Scales(
        float(np.sqrt(np.mean(recording.tau[:, k] ** 2))),
        float(np.quantile(speed, 0.98)),
        float(np.ptp(recording.q[:, k])),
        float(np.quantile(np.abs(e), 0.98)),
        float(np.quantile(np.abs(recording.tau[:, k]), 0.95)),
    )


def truths(robot: Robot, k: int, s: Scales) -> dict[str, dict[str, float]]:
    """Return parameters of the effects that are tried, of a typical size at joint k."""
    p = robot.joints[k].parameters
    fs, fv, K = p["fs"], p["fv"], p["K"]
    other = float((k + 1) % robot.n + 1)
    return {
        "stribeck": {"amplitude": 0.5 * fs, "velocity": 0.08, "exponent": 1.0},
        "asymmetric_coulomb": {"difference": 0.25 * fs},
        "asymmetric_viscous": {"difference": 0.25 * fv},
        "torque_offset": {"offset": 0.25 * fs},
        "load_friction": {"coefficient": 0.06},
        "quadratic_viscous": {"amplitude": 0.4 * fv / s.speed, "power": 2.0},
        "friction_drift": {"coulomb": -0.3 * fs, "viscous": -0.3 * fv},
        "position_friction": {"amplitude": 0.3 * fs, "phase": 0.4, "order": 4.0},
        "torque_ripple": {"amplitude": 0.25 * fs, "phase": -0.7, "order": 12.0},
        "transmission_damping": {"damping": 2e-3 * K},
        "cubic_stiffness": {"cubic": 0.4 * K / s.deflection**2},
        "backlash": {"stiffness": K, "gap": 0.12 * s.deflection},
        "hysteresis": {"torque": 0.05 * s.tau, "distance": 0.1 * s.deflection},
        "kinematic_error": {"amplitude": 0.05 * s.deflection, "phase": 0.5, "order": 20.0},
        "link_spring": {"stiffness": 0.15 * s.tau / s.span, "preload": 0.05 * s.tau},
        "link_coulomb": {"friction": 0.5 * fs},
        "link_viscous": {"friction": 0.6 * fv},
        "velocity_coupling": {"viscous": 0.4 * fv, "coulomb": 0.2 * fs, "other": other},
        "torque_delay": {"delay": 0.004},
        "encoder_skew": {"skew": 0.002},
        "torque_gain": {"gain": 0.08},
        "saturation": {"limit": s.top},
        "encoder_offset": {"offset": 0.1 * s.deflection},
        "gravity_direction": {"roll": 0.02, "pitch": 0.02},
        "payload": {"m": 0.8, "cx": 0.05, "cy": 0.02, "cz": 0.0, "start": 0.55 * DURATION}
        | dict.fromkeys(("Ixx", "Iyy", "Izz"), 0.01)
        | dict.fromkeys(("Ixy", "Ixz", "Iyz"), 0.0),
        "contact": {"torque": 0.25 * s.tau, "time": 0.46 * DURATION, "width": 0.4},
        "flexible_mode": {"inertia": 0.08 * s.tau / 9.0, "frequency": 11.0, "damping": 0.03},
    }


@dataclass(frozen=True)
class Trial:
    """One trial: what is put in (None: nothing) and under which noise."""

    robot: str
    effects: tuple[tuple[str, int], ...]
    seed: int
    db: float
    torque: float
    colour: float
    cache: str


@dataclass(frozen=True)
class Outcome:
    """What the diagnosis said."""

    trial: Trial
    verdict: str
    said: str
    seconds: float
    error: float
    best: float
    """Held-out error (whitened by floor, all rows) of a fit that is told the truth; NaN where not asked."""


def one(trial: Trial) -> Outcome:
    """Run one trial."""
    base = robot_named(trial.robot)
    cache = Path(trial.cache)
    plain = clean_log(base, trial.seed, cache)
    assert plain is not None
    specs = [
        EffectSpec(
            name,
            None if effect_classes()[name].whole_robot else base.joint_names[k],
            truths(base, k, scales(plain, k))[name],
        )
        for name, k in trial.effects
    ]
    recording = clean_log(replace(base, effects=tuple(specs)), trial.seed, cache) if specs else plain
    if recording is None:
        return Outcome(trial, "not simulated", "", 0.0, np.nan, np.nan)
    start = time.perf_counter()
    log = noisy(recording, trial.db, trial.torque, trial.colour, trial.seed)
    found = diagnose(base, prepare(log, base, SignalOptions(cutoff=25.0, slow_motion=True)))
    seconds = time.perf_counter() - start
    return Outcome(trial, verdict(found, specs), said(found), seconds, worst(found), np.nan)


def worst(found: Diagnosis) -> float:
    """Return the largest ratio of residual to floor after."""
    return max(row.ratio for row in found.rows_after)


def verdict(found: Diagnosis, specs: list[EffectSpec]) -> str:
    """Return right, set, silent or wrong (for clean logs: quiet or false alarm)."""
    named = {(e.effect, e.joint) for e in found.effects}
    also = {(r.effect, r.joint) for r in found.also_possible}
    wanted = {(s.effect, s.joint) for s in specs}
    if not wanted:
        return "quiet" if not named else "false alarm"
    nuisances = {(n.effect, n.joint) for n in found.nuisances}
    if wanted <= named | nuisances:
        return "right" if len(named) <= len(wanted) else "right+extra"
    if wanted <= named | also:
        return "set"
    return "silent" if not named else "wrong"


def said(found: Diagnosis) -> str:
    """Return what was said in one line."""
    effects = ", ".join(
        f"{e.effect}@{e.joint}[{' '.join(f'{k}={v:.3g}' for k, v in e.parameters.items())}] {e.net:.0f}"
        for e in found.effects
    )
    also = ", ".join(f"{r.effect}@{r.joint}" for r in found.also_possible)
    left = ", ".join(f"{u.joint}/{u.rows} {u.ratio:.1f}" for u in found.unexplained)
    return f"{effects or '-'}" + (f" | also {also}" if also else "") + (f" | left {left}" if left else "")


def trials(options: argparse.Namespace) -> list[Trial]:
    """Return the trials that the command line asks for."""
    common = (options.db, options.torque_noise, options.colour, str(options.cache))
    if options.clean:
        return [Trial(r, (), 100 + k, *common) for r in options.robot for k in range(options.clean)]
    chosen = []
    for name in options.robot:
        robot = robot_named(name)
        kinds = {k: c for k, c in effect_classes().items() if k not in SKIPPED}
        sized = truths(robot, 0, Scales(1.0, 1.0, 1.0, 1.0, 1.0))
        unsized = [k for k in options.effect or kinds if k not in sized]
        if unsized:
            print(f"not tried, as no size is written here: {', '.join(unsized)}", flush=True)
        names = [k for k in options.effect or kinds if k in sized]
        for effect in names:
            for k in range(robot.n):
                if kinds[effect].applies(robot, k):
                    chosen += [Trial(name, ((effect, k),), options.first + s, *common) for s in range(options.seeds)]
    if options.pairs:
        rng = np.random.default_rng(5)
        singles = [t for t in chosen if t.seed == options.first]
        picks = [rng.choice(len(singles), 2, replace=False) for _ in range(options.pairs)]
        return [
            replace(singles[a], effects=(*singles[a].effects, *singles[b].effects))
            for a, b in picks
            if singles[a].robot == singles[b].robot and singles[a].effects[0][0] != singles[b].effects[0][0]
        ]
    return chosen


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", nargs="+", default=["planar2"])
    parser.add_argument("--effect", nargs="*", default=[])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--db", type=float, default=90.0)
    parser.add_argument("--torque-noise", type=float, default=0.0)
    parser.add_argument("--colour", type=float, default=0.0, help="time constant of the torque noise, s")
    parser.add_argument("--clean", type=int, default=0, help="logs without any effect, per robot")
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=Path("/tmp/elid-trials"))
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    tally: Counter[str] = Counter()
    work = trials(options)
    with ProcessPoolExecutor(options.jobs) as pool:
        for outcome in pool.map(one, work):
            tally[outcome.verdict] += 1
            what = "+".join(f"{e}@joint{k + 1}" for e, k in outcome.trial.effects) or "clean"
            print(
                f"{outcome.verdict:12s} {outcome.trial.robot:8s} {what:34s} seed {outcome.trial.seed} "
                f"{outcome.seconds:5.1f} s  ratio {outcome.error:5.2f}  {outcome.said}",
                flush=True,
            )
    total = sum(tally.values())
    print(", ".join(f"{k} {v} ({v / total:.0%})" for k, v in tally.most_common()), f"of {total}")


if __name__ == "__main__":
    main()
