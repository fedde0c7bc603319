"""The hidden links' motion from the motors', their torque and the stiffnesses that were found; a rigid fit to it.

A joint that yields by δ = (τ - J θ'' - friction) / K has its link at q = θ - δ. With q in place of θ in the links' part
and J δ'' taken from the torque, the equations of a rigid joint hold again, to the first order in 1/K: without, sag
under gravity turns first moments and what swings against the spring counts as inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.verdicts import WEAK, torque_scale
from elid_cli.model.effects import effect_classes
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.signals import Signals

if TYPE_CHECKING:
    from elid_cli.estimation.motor_side.result import MotorSide, MotorSideJoint

UNSURE = 0.1
"""Standard error of what the correction moved, share of it: for what it takes to the first order only.

Simulated arms with their stiffness and without it: up to a twentieth of what was moved was still off.
"""
PAST = 3.0
"""Cut-off of the yielding over that of the fit: well above what the fit sees, below most of the torque's noise."""
FRICTION = ("fs", "fv")
MATTERS = 2.0
"""Standard errors of a joint's Coulomb friction from which load friction in it counts."""
LOUD = 3.0
"""Times the sensors' noise from which something is left that friction may be a part of."""
WIDE = "how far the joints' elasticity moves it is known to a tenth only"


def with_links(signals: Signals, side: MotorSide, rigid: Identification) -> Signals | None:
    """Return the signals as rigid joints would have given them, or None where there is nothing to take out.

    Parameters
    ----------
    signals
        Filtered below where rigid joints stop describing what was found.
    side
        What the motors say.
    rigid
        The fit to these signals as they are: its friction does not go through the spring.
    """
    joints = [joint for joint in side.joints if joint.verdict != "refused" and np.isfinite(joint.rotor)]
    places = [joint.number for joint in joints]
    if not joints or not all(np.isfinite(signals.tau[s.start : s.stop, places]).all() for s in signals.segments):
        return None
    values = dict(zip(rigid.base.parameters, rigid.standard.tolist(), strict=True))
    motion, tau = signals.motion, signals.tau.copy()
    states = {name: getattr(motion, name).copy() for name in ("q", "dq", "ddq", "ddtheta")}
    from scipy.signal import butter, sosfiltfilt

    low = butter(4, min(PAST * signals.filter.cutoff, 0.4 / signals.dt), fs=1 / signals.dt, output="sos")
    for joint in joints:
        k = joint.number
        coulomb, viscous = (values.get(StandardParameter(kind, k), 0.0) for kind in ("fs", "fv"))
        for segment in signals.segments:
            part = slice(segment.start, segment.stop)
            speed = motion.dtheta[part, k]
            load = tau[part, k] - joint.rotor * motion.ddtheta[part, k] - coulomb * np.sign(speed) - viscous * speed
            yields = [sosfiltfilt(low, load) / joint.stiffness]
            for _ in range(2):
                yields.append(np.gradient(yields[-1], signals.dt))
            for name, wave in zip(("q", "dq", "ddq", "ddtheta"), (*yields, yields[2]), strict=True):
                states[name][part, k] -= wave
            tau[part, k] -= joint.rotor * yields[2]
    return replace(signals, motion=motion.changed(**states), tau=tau)


def widened(found: Identification, rigid: Identification) -> Identification:
    """Return an identification whose standard errors know that the elasticity's part is known to a share only.

    Friction acts on the motor and not through the spring: what moves it is all error.
    """
    if found.triangles is None:
        return found
    scale = torque_scale(found.base, found.triangles)
    moved = np.nan_to_num(found.estimate - rigid.estimate)
    share = np.array([1.0 if item.leader.kind in FRICTION else UNSURE for item in found.parameters])
    items = zip(found.parameters, (share * moved).tolist(), scale.tolist(), strict=True)
    return replace(found, parameters=tuple(_widened(*item) for item in items))


def _widened(item: BaseEstimate, by: float, matters: float) -> BaseEstimate:
    """Return a parameter with a further standard error; known roughly where it is large beside value and torque."""
    deviation = float(np.hypot(item.std_error, by))
    size = max(abs(item.estimate), matters if np.isfinite(matters) else 0.0)
    if item.verdict != "supported" or deviation <= WEAK * size:
        return replace(item, std_error=deviation)
    reason = f"standard error {100 * deviation / size:.0f} %: {WIDE}"
    return replace(item, std_error=deviation, verdict="weak", reason=reason)


def undeclared_load_friction(found: Identification, joints: Sequence[MotorSideJoint]) -> dict[str, float]:
    """Return friction over the load of joints that the motor side shows and the robot does not declare, by name.

    Only where it is more than a fit without it knows of their friction.
    """
    kinds = {name: kind for name, kind in effect_classes().items() if kind.from_model and kind.holds()}
    known = {spec.joint for spec in found.robot.effects if spec.effect in kinds}
    errors = {p.leader.joint: p.std_error for p in found.parameters if p.leader.kind == "fs"}
    told = {}
    for joint in joints:
        error = found.error.get(joint.joint)
        size = joint.load_friction * (error.torque_rms if error else 0.0)
        if joint.joint not in known and size > MATTERS * errors.get(joint.number, np.inf):
            told[joint.joint] = joint.load_friction
    return told


def with_doubted_friction(found: Identification, joints: Sequence[MotorSideJoint]) -> Identification:
    """Return an identification whose friction may be biased where it depends on what the fit knows nothing of.

    That is a load whose friction the motor side shows, or anything that is left beside a stiffness that nobody knows.
    """
    loaded = undeclared_load_friction(found, joints)
    loud = {noise.joint for noise in found.noise if noise.ratio > LOUD}
    own = {j.number for j in joints if j.joint in loaded or (j.verdict == "refused" and j.joint in loud)}
    marked = (
        replace(p, bias_possible=p.bias_possible or (p.leader.kind in FRICTION and p.leader.joint in own))
        for p in found.parameters
    )
    return replace(found, parameters=tuple(marked))


def bent(found: Identification) -> Identification:
    """Return an identification whose parameters may be biased by elasticity that the fit took as rigid.

    Friction acts on the motor and does not go through the spring. What swings behind it looks like a delay.
    """
    marked = (replace(p, bias_possible=p.bias_possible or p.leader.kind not in FRICTION) for p in found.parameters)
    return replace(found, parameters=tuple(marked), nuisances=tuple(item.doubted for item in found.nuisances))
