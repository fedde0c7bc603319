"""What loops that hold their torque would change in least squares of torques that were computed from commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.result import Identification
from elid_cli.model.drives import lost_to_holding
from elid_cli.model.effects.of_drives import declared_loops
from elid_cli.signals.recording import Recording

MILLISECOND = 1e-3
SHOWN, SMALL = 3.0, 0.03
"""Standard errors, and part of the value, by which loops of a millisecond change viscous friction for a word."""


def with_loop_words(found: Identification, recording: Recording | None) -> Identification:
    """Return least squares' answer to computed torques with a warning on loops that hold their torque, where due.

    A torque that is computed from what was logged at an instant is one that acts at once; half a period of a loop is
    viscous friction and inertia less, by kp and kd times that.
    """
    if recording is None or not {"kp", "kd"} <= recording.commands.keys() or declared_loops(found.robot).any():
        return found
    less = {name: np.zeros(found.robot.n) for name in ("kp", "kd")}
    for name, own in less.items():
        gains = np.nan_to_num(np.nanmean(recording.commands[name][:, recording.commanded], axis=0))
        own[recording.commanded] = lost_to_holding(MILLISECOND, gains)
    friction = {
        item.leader.joint: item for item in found.parameters
        if item.leader.kind == "fv" and item.name == str(item.leader) and item.verdict == "supported"
    }  # fmt: skip
    beyond = [k for k, item in friction.items()
              if less["kp"][k] > max(SHOWN * item.std_error, SMALL * abs(item.estimate))]  # fmt: skip
    if not beyond:
        return found
    worst = max(beyond, key=lambda k: less["kp"][k])
    joint = found.robot.joints[worst]
    units = ("N·m·s/rad", "kg·m²") if joint.revolute else ("N·s/m", "kg")
    words = (
        "the drives' loop is taken to act all the time; for every millisecond that it holds its torque, viscous "
        f"friction is larger by {less['kp'][worst]:.2g} {units[0]} and motor inertia by {less['kd'][worst]:.2g} "
        f"{units[1]} ({joint.name}), which no standard error counts (held_loop in the robot file)"
    )
    return replace(found, warnings=(*found.warnings, words))
