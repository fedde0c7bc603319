"""Which logs a simulated motion can judge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording


def by_motion(robot: Robot, recording: Recording) -> bool:
    """Whether a simulated motion can judge a log: one of commands, no torque logged, bodies known, joints rigid."""
    if not recording.commanded.all():
        return False
    from elid_cli.estimation.trajectory.identification import unsuited

    if unsuited(robot):
        return False
    known = dict(zip(robot.parameter_names(), robot.reference(), strict=True))
    classes = find_base(Regressor(replace(robot, effects=()))).classes
    bodies = [p for p in known if p.kind not in ("Ja", "fs", "fv") and classes[p] != "unidentifiable"]
    return all(np.isfinite(known[p]) for p in bodies)
