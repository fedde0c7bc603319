"""Logged torques that are what drives compute from commands, at the instants at which these step.

Between two samples a command stays and the joint moves. Where the drive's loop runs faster than the log, the torque
falls from what was logged: on average over the sample it is less by half of what the law makes of the motion. Taken as
it stands, half a sample late, that is viscous friction (kp dt/2) and inertia (kd dt/2) which no joint has. Where the
torque is held for the sample it is right. The log tells neither.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.result import Identification
from elid_cli.model.effects import effect_that
from elid_cli.signals.signals import Signals

LAW = 0.03
"""Part of a torque that the law of its drive may leave, noise of positions and velocities in it."""
HALF = 0.2
"""Part of half a sample by which a torque's delay may be off it."""
STEPS = 0.003
"""Least part of a torque that the steps of its commands are, rms, for half of them to matter."""
LAWFUL = "is what the drive computes from its command"
"""What the warning says of such a torque."""
LEAST = 200
"""Samples that are needed."""


def law_warnings(signals: Signals, found: Identification) -> tuple[str, ...]:
    """Return a sentence for every joint whose logged torque is that of its drive's law, where commands step."""
    recording, name = signals.recording, effect_that(nuisance="delay").name
    if recording is None or "q_des" not in recording.commands:
        return ()
    late = {item.joint: item.parameters["delay"] for item in found.nuisances if item.effect == name}
    said = []
    for k, joint in enumerate(signals.joints):
        half = 0.5 * recording.dt
        if recording.commanded[k] or abs(late.get(joint, 0.0) - half) > HALF * half:
            continue
        gains = _law(signals, k)
        if gains is not None:
            said.append(
                f"{joint}: the logged torque {LAWFUL}, kp (q_des - q) - kd dq with "
                f"kp {gains[0]:.3g} and kd {gains[1]:.3g}, at the instants at which commands step. Unless the drive "
                f"holds it for the whole sample, less acts on average, and viscous friction is too large by kp dt/2, "
                f"{gains[0] * half:.2g}, inertia by kd dt/2, {gains[1] * half:.2g}. --map tau=command computes it in "
                f"between (with --kp {gains[0]:.3g} --kd {gains[1]:.3g} where the log has no gains)"
            )
    return tuple(said)


def _law(signals: Signals, joint: int) -> Array | None:
    """Return the gains (kp, kd) that make a joint's logged torque from its commands, or None."""
    recording, motion = signals.recording, signals.motion
    assert recording is not None
    asked, tau = recording.commands["q_des"][:, joint], recording.tau[:, joint]
    position = recording.theta[:, joint]
    rates = recording.commands.get("dq_des")
    speed = -motion.dtheta[:, joint] + (0.0 if rates is None else np.nan_to_num(rates[:, joint]))
    columns = np.stack([asked - position, speed, np.ones(len(tau))], axis=1)
    use = np.isfinite(columns).all(axis=1) & np.isfinite(tau)
    if np.count_nonzero(use) < LEAST or np.ptp(asked[use]) == 0:
        return None
    gains, *_ = np.linalg.lstsq(columns[use], tau[use], rcond=None)
    size = float(np.std(tau[use]))
    left = float(np.std(tau[use] - columns[use] @ gains))
    steps = gains[0] * float(np.sqrt(np.nanmean(np.diff(asked[use]) ** 2)))
    if left > LAW * size or gains[0] <= 0 or steps < STEPS * size:
        return None
    return np.asarray(gains[:2], dtype=float)
