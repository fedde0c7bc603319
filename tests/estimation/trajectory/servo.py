"""One pendulum whose drive is told a new position every 20 ms, stepped plainly: no code of elid's simulation."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import held_mean
from elid_cli.signals.recording import Recording, Segment

MASS, REACH, OWN, GRAVITY = 0.55, 0.14, 0.003, 9.81
ARMATURE, COULOMB, VISCOUS = 0.008, 0.12, 0.06
KP, KD = 14.0, 0.52
DT, STEP, EVERY = 0.005, 5e-5, 4
"""Sample time and step, s, and samples from one command to the next."""
NOISE = 2e-5
"""rad."""


def robot(folder: Path) -> Robot:
    """Return the pendulum as a file would describe it: its body, no drive parameters."""
    path = folder / "servo.xml"
    path.write_text(
        '<mujoco model="servo"><worldbody><body name="leg"><joint name="j" type="hinge" axis="0 1 0"/><inertial '
        f'pos="0 0 -{REACH}" mass="{MASS}" diaginertia="{OWN} {OWN} {OWN}"/></body></worldbody></mujoco>'
    )
    return read_robot(path)


def moved(
    seed: int, duration: float = 8.0, *,
    smoothing: float = 0.0, lines: bool = False, delay: float = 0.0, targets: float = 0.0,
) -> Recording:  # fmt: skip
    """Return a log of commands and noisy positions.

    The drive damps by a velocity that passes a first-order filter of time constant `smoothing`, s; it goes to each
    command on a line over their period with `lines`, acts late by `delay`, s, and filters the commands with a time
    constant `targets`, s.
    """
    rng, samples, fine = np.random.default_rng(seed), round(duration / DT), round(DT / STEP)
    t = DT * np.arange(samples)
    new = DT * EVERY * np.arange(samples // EVERY + 1)
    asked = 0.4 * np.sin(2 * np.pi * rng.uniform(0.5, 1.2) * new + rng.uniform(0, 6)) + 0.2
    asked += 0.3 * np.sin(2 * np.pi * 0.2 * new + rng.uniform(0, 6)) + 0.05 * rng.standard_normal(len(new))
    when = STEP * np.arange(samples * fine) - delay + 0.5 * STEP  # a command acts from its instant on
    place = np.maximum(when / (DT * EVERY), 0.0)
    number, part = place.astype(int), place % 1.0
    before = np.maximum(number - 1, 0)
    told = asked[before] + part * (asked[number] - asked[before]) if lines else asked[number]
    if targets:
        part = 1.0 - math.exp(-STEP / targets)
        told = lfilter([part], [1.0, part - 1.0], told - asked[0]) + asked[0]
    acting = told.tolist()
    inertia, weight = OWN + MASS * REACH**2 + ARMATURE, MASS * GRAVITY * REACH
    keep = math.exp(-STEP / smoothing) if smoothing else 0.0
    x, v, pull, seen, found = float(asked[0]), 0.0, 0.0, 0.0, []
    for k in range(samples * fine):
        if k % fine == 0:
            found.append(x)
        speed = v + 0.5 * STEP * pull  # v is that of half a step before
        at = x + 0.5 * STEP * v
        seen = keep * seen + (1.0 - keep) * speed
        free = v + STEP / inertia * (KP * (acting[k] - at) - KD * seen - VISCOUS * speed - weight * math.sin(at))
        after = math.copysign(max(abs(free) - STEP * COULOMB / inertia, 0.0), free)
        x, v, pull = x + 0.5 * STEP * (v + after), after, (after - v) / STEP
    q = np.array(found)[:, None] + NOISE * rng.standard_normal((samples, 1))
    q_des = np.repeat(asked, EVERY)[:samples, None]
    ones = np.ones((samples, 1))
    tau = KP * (held_mean(q_des, [(0, samples)]) - q) - KD * np.gradient(q, DT, axis=0)
    return Recording(
        joints=("j",), dt=DT, t=t, q=q, theta=q, tau=tau, segments=(Segment(0, samples),), files=("made.csv",),
        commands={"q_des": q_des, "dq_des": 0.0 * ones, "kp": KP * ones, "kd": KD * ones}, sources={"tau": "command"},
    )  # fmt: skip
