"""Whether a velocity is late against the position of its joint, where a torque is computed from both.

Drives log a velocity that a filter has made late. Their own loop mostly takes the same one: then a computed torque is
right, and a simulated drive, which takes the velocity of the moment, makes every inertia too small by ``kd`` times the
delay. Where the loop has a faster velocity the simulation is right, and inertias fitted to the torque are too large by
that. The torque does not show which it is; fast motion may.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.robot.robot import Robot
from elid_cli.signals.late_velocity import Delay, delay_of

LEAST = 1e-3
"""s, from which a delay is worth a word."""
SURE = 5.0
"""Standard errors by which it must be longer than that."""


def late_velocities(
    signals: Mapping[str, Array], q: Array, computed: NDArray[np.bool_], dt: float, robot: Robot
) -> Iterator[str]:
    """Yield a sentence on velocities, and one on positions, that are late in a log whose torque is computed.

    Parameters
    ----------
    signals
        ``dq`` or ``dtheta``, ``kp`` and ``kd``, each (N, n), of contiguous samples.
    q
        Positions that the torque is computed from, (N, n).
    computed
        Joints whose torque is, (n,).
    dt
        Sample time, s.
    robot
        Its joints' names.
    """
    if not {"kp", "kd"} <= set(signals):
        return
    found = []
    for j in np.flatnonzero(computed).tolist():
        rates = [signals[name][:, j] for name in ("dq", "dtheta") if name in signals]
        logged = [rate for rate in rates if np.isfinite(rate).any()]
        if logged:  # the torque takes the first one
            found.append(delay_of(q[:, j], logged[0], dt, j))
    sure = [d for d in found if d is not None and abs(d.value) - LEAST > SURE * d.std_error]
    for late in (True, False):
        joints = [d for d in sure if (d.value > 0) == late]
        gain = signals["kd" if late else "kp"]
        joints = [d for d in joints if np.any(gain[:, d.joint] > 0)]
        if joints:
            yield _sentence(joints, gain, robot, late=late)


def _sentence(joints: list[Delay], gain: Array, robot: Robot, *, late: bool) -> str:
    names = " ".join(robot.joint_names[d.joint] for d in joints)
    times = np.array([abs(d.value) for d in joints])
    wrong = times * np.array([float(np.nanmedian(np.abs(gain[:, d.joint]))) for d in joints])
    slides = {robot.joints[d.joint].type == "prismatic" for d in joints}
    units = {frozenset({False}): (" kg·m²", " N·m·s/rad"), frozenset({True}): (" kg", " N·s/m")}
    inertia, viscous = units.get(frozenset(slides), ("", ""))
    told = "The torque does not show which"
    if late:
        what, values = "the velocity is late against the position", "inertias"
        bias = f"kd times that, {_span(wrong)}{inertia}"
        told += "; where the motion does, elid diagnose names a velocity_filter"
    else:
        what, values = "the position is late against the velocity", "viscous frictions"
        bias = f"kp times that, {_span(wrong)}{viscous}"
    return (
        f"{names}: {what} by {_span(1e3 * times)} ms, as a filter makes it. If the drive takes the late one as well, "
        f"{values} fitted to the torque are right, and those fitted to the motion too small by {bias}. If it has a "
        f"faster one, those fitted to the motion are right, and those fitted to the torque too large by as much. "
        f"{told}: log what the drive takes"
    )


def _span(values: Array) -> str:
    low, high = f"{values.min():.2g}", f"{values.max():.2g}"
    return low if low == high else f"{low} to {high}"
