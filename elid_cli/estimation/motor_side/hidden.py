"""Which joints the motor side is asked for."""

from __future__ import annotations

import numpy as np

from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, is_empty


def hidden_joints(robot: Robot, recording: Recording) -> list[int]:
    """Return the numbers of the elastic joints of which a log holds the motor's position and torque, not the link's."""
    lacking = np.flatnonzero(robot.elastic & recording.missing_link).tolist()
    # no look at the other joints' columns: of a long log all would be in memory
    return [k for k in lacking if not is_empty(recording.theta[:, k]) and not is_empty(recording.tau[:, k])]
