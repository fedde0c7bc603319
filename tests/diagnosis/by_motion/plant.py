"""Three pendulums beside each other under held commands, stepped plainly: shares no code with elid's simulation."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec

import numpy as np

from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment

MASS, REACH, GRAVITY = np.array([1.2, 0.8, 0.5]), np.array([0.25, 0.2, 0.15]), 9.81
INERTIA = np.array([0.02, 0.012, 0.006])
"""Of the bodies about their own centres, kg·m²."""
ARMATURE, COULOMB, VISCOUS = np.array([0.02, 0.015, 0.01]), np.array([0.3, 0.2, 0.15]), np.array([0.25, 0.2, 0.12])
OFFSET = np.array([0.15, -0.1, 0.05])
KP, KD = np.array([25.0, 20.0, 15.0]), np.array([1.0, 0.8, 0.5])
NAMES = ("one", "two", "three")
DT, STEP = 0.005, 0.00025

Extra = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Asked = ParamSpec("Asked")
LAST = 16
"""Logs that are kept: tests of a file often ask for the same one."""


def robot(folder: Path) -> Robot:
    """Return the pendulums as a file would describe them: bodies, no drive parameters."""
    path = folder / "pendulums.xml"
    bodies = "".join(
        f'<body name="body_{n}" pos="0 {k} 0"><joint name="{n}" type="hinge" axis="0 1 0"/><inertial '
        f'pos="0 0 -{REACH[k]}" mass="{MASS[k]}" diaginertia="{INERTIA[k]} {INERTIA[k]} {INERTIA[k]}"/></body>'
        for k, n in enumerate(NAMES)
    )
    path.write_text(f'<mujoco model="pendulums"><worldbody>{bodies}</worldbody></mujoco>')
    return read_robot(path)


def _kept(make: Callable[Asked, Recording]) -> Callable[Asked, Recording]:
    """Return the same function, which copies one of its last logs where it is asked for that again."""
    made: dict[object, Recording] = {}

    @wraps(make)
    def found(*args: Asked.args, **options: Asked.kwargs) -> Recording:
        if any(map(callable, (*args, *options.values()))):
            return make(*args, **options)
        # constants, too: some tests change them
        constants = (ARMATURE, COULOMB, VISCOUS, OFFSET, KP, KD)
        key = tuple(np.asarray(value).tobytes() for value in (*constants, *args, *options.values())), tuple(options)
        if key not in made:
            made[key] = make(*args, **options)
            for old in list(made)[:-LAST]:
                del made[old]
        return copy.deepcopy(made[key])

    return found


@_kept
def moved(
    seed: int = 0, duration: float = 7.0, delay: float | np.ndarray = 0.0,
    push: Extra | None = None, grip: Extra | None = None,
    noise: float = 1e-4, jitter: float = 0.0, limit: np.ndarray | float = np.inf,
    tilt: float | np.ndarray = 0.0, integral: np.ndarray | float = 0.0, held: np.ndarray | float = 0.0,
    resting: bool = False, count: float = 0.0, rates: bool = True, smoothing: float | np.ndarray = 0.0,
    once: bool = False, sweep: float = 0.2,
) -> Recording:  # fmt: skip
    """Return a log of commands and noisy positions.

    `push` is a torque that the joints need, `grip` what Coulomb friction is beyond `COULOMB`, both of q, its rate, and
    what the bodies need, (3,). Positions are sampled `jitter` s (rms) beside their stamps. Drives deliver at most
    `limit`. Gravity is turned by `tilt`, rad, about the pendulums' axes; one of each, (3,), is its encoder's zero.
    The drives add up `integral` times the error, N·m/(rad·s), and have `held`, N·m, when the log begins. Commands go
    from pose to pose and rest there where `resting`; encoders read whole multiples of a `count`, rad. Drives are told
    the rates of their positions where `rates`, else that they are to stand still. Their damping takes the velocity of
    a first-order filter of time constant `smoothing`, s. Where `once`, drives compute their torque at the samples and
    hold it until the next. The motion's frequency rises by `sweep`, Hz/s.
    """
    rng = np.random.default_rng(seed)
    samples, fine = round(duration / DT) + 1, round(DT / STEP)
    t = DT * np.arange(samples)
    phase = rng.uniform(0, 2 * np.pi, 6)
    chirp = 2 * np.pi * (0.2 * t + 0.5 * sweep * t**2)
    q_des = np.stack([0.5 * np.sin(chirp + phase[k]) + 0.3 * np.sin(2.1 * t + phase[k + 3]) for k in range(3)], axis=1)
    if resting:
        q_des = _from_pose_to_pose(t, rng)
    dq_des = np.gradient(q_des, DT, axis=0) if rates else np.zeros_like(q_des)
    inertia = INERTIA + MASS * REACH**2 + ARMATURE
    x, v = q_des[0].copy(), np.zeros(3)
    states = np.empty(((samples - 1) * fine + 1, 3))
    speeds = np.empty_like(states)
    states[0], speeds[0] = x, v
    # plain numbers: arrays of three would take ten times as long
    summed, rise, turned = ((np.zeros(3) + value).tolist() for value in (held, integral, tilt))
    late, bodies, none = (
        np.broadcast_to(np.round(np.asarray(delay) / STEP), 3).astype(int).tolist(),
        [0.0] * 3,
        [0.0] * 3,
    )
    weight, legs = (MASS * GRAVITY * REACH).tolist(), (INERTIA + MASS * REACH**2).tolist()
    told_q, told_dq = q_des.T.tolist(), dq_des.T.tolist()
    constants = list(enumerate(zip(*((np.zeros(3) + c).tolist() for c in (
        KP, KD, OFFSET, VISCOUS, COULOMB, inertia, limit, weight, tilt
    )), strict=True)))  # fmt: skip
    x, v = x.tolist(), v.tolist()
    sampled = x, v
    filtered, part = list(v), [1.0 - math.exp(-STEP / time) if time else 1.0 for time in np.broadcast_to(smoothing, 3)]
    late_speeds = min(part) < 1.0
    free, sin, copysign = push is None and grip is None, math.sin, math.copysign

    def of(torque: Extra | None, where: np.ndarray, speed: np.ndarray) -> list[float]:
        return none if torque is None else (np.zeros(3) + torque(where, speed, np.array(bodies))).tolist()

    def moved_by(told: list[int], over: float, where: list[float], speed: list[float]) -> list[float]:
        """Return the velocity after a time under what acts at a state."""
        after = []
        more = held_by = none
        if not free:
            arrays = np.array(where), np.array(speed)
            more, held_by = of(push, *arrays), of(grip, *arrays)
        seen, rates = sampled if once else (where, speed)
        if late_speeds and not once:
            rates = [filtered[j] if part[j] < 1.0 else speed[j] for j in range(3)]
        for j, (kp, kd, offset, viscous, coulomb, mass, top, heavy, turn) in constants:
            torque = kp * (told_q[j][told[j]] - seen[j]) + kd * (told_dq[j][told[j]] - rates[j]) + summed[j]
            torque = -top if torque < -top else top if torque > top else torque
            torque = torque - offset - viscous * speed[j]
            pulled = (torque - (heavy * sin(where[j] - turn) + more[j])) / mass
            braked, own = (coulomb + held_by[j]) / mass, v[j]
            slid = own + over * (pulled - copysign(braked, own) if own else pulled)
            # a joint that comes to rest within the time is at rest, or goes on, for what is left of it
            left = 1.0 if own == 0 else slid / (slid - own) if slid * own < 0 else 0.0
            after.append(over * left * copysign(max(abs(pulled) - braked, 0.0), pulled) if left > 0 else slid)
        return after

    for k in range(len(states) - 1):
        told = [max(k - steps, 0) // fine for steps in late]
        if k % fine == 0:
            sampled = list(x), list(v)
        # by the middle of each step: steps that act on their start only are half a step late, which is inertia
        half = moved_by(told, 0.5 * STEP, x, v)
        after = moved_by(told, STEP, [a + 0.25 * STEP * (u + w) for a, u, w in zip(x, v, half, strict=True)], half)
        for j in range(3):
            if not free:
                bodies[j] = legs[j] * (after[j] - v[j]) / STEP + weight[j] * sin(x[j] - turned[j])
            summed[j] += rise[j] * STEP * (told_q[j][told[j]] - x[j] - 0.25 * STEP * (v[j] + after[j]))
            x[j] += 0.5 * STEP * (v[j] + after[j])
            if late_speeds:
                filtered[j] += part[j] * (0.5 * (v[j] + after[j]) - filtered[j])
        v = after
        states[k + 1], speeds[k + 1] = x, v
    at = t + np.clip(jitter * rng.standard_normal(samples), -0.9 * DT, 0.9 * DT)
    grid = STEP * np.arange(len(states))
    q, dq = (np.stack([np.interp(at, grid, column) for column in part.T], axis=1) for part in (states, speeds))
    if count:
        q, dq = count * np.round(q / count), np.full_like(dq, np.nan)
    else:
        q += noise * rng.standard_normal(q.shape)
        dq += 30 * noise * rng.standard_normal(q.shape)
    gains = {"kp": np.tile(KP, (samples, 1)), "kd": np.tile(KD, (samples, 1))}
    return Recording(
        joints=NAMES, dt=DT, t=t, q=q, theta=q, tau=np.full_like(q, np.nan), dq=dq,
        commands={"q_des": q_des, "dq_des": dq_des, **gains}, segments=(Segment(0, samples),), files=("made.h5",),
    )  # fmt: skip


def _from_pose_to_pose(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return commands that go smoothly between eight poses of every joint, again and again, and rest, rad, (N, 3)."""
    poses, found = rng.uniform(-0.8, 0.8, (8, 3)), np.empty((len(t), 3))
    begins, at = 0.0, poses[0]
    while begins < t[-1]:
        takes, rests, to = *rng.uniform((0.3, 0.2), (0.8, 0.6)), poses[rng.integers(8)]
        s = np.clip((t - begins) / takes, 0.0, 1.0)[:, None]
        own = t >= begins
        found[own] = (at + (to - at) * s**3 * (10 - 15 * s + 6 * s**2))[own]
        begins, at = begins + takes + rests, to
    return found


def written(folder: Path, name: str, recording: Recording) -> str:
    """Write a log with the gains, and return its path."""
    path = folder / name
    write_recording(recording, path)
    return str(path)
