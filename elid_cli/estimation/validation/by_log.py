"""Several logs in one fit: how well the one result predicts each of them, so that an odd one shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.result import JointError
from elid_cli.estimation.validation.prediction import validate
from elid_cli.model.regressor import Model
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class ByLog:
    """Error of the predicted motor torques on one of several logs."""

    file: str
    error: Mapping[str, JointError]


def errors_by_log(robot: Robot, signals: Signals, files: Sequence[str]) -> tuple[ByLog, ...]:
    """Return each log's error, predicted by one robot description; nothing where there is only one log.

    Parameters
    ----------
    robot
        Description that holds what was identified from all logs together.
    signals
        The joined logs; `Segment.source` counts the files.
    files
        Names of the logs.

    """
    if len(files) < 2:
        return ()
    observation = observe(Model(robot), signals)
    sources = np.array([segment.source for segment in signals.segments], dtype=np.intp)[observation.stretch]
    judged = []
    for number, file in enumerate(files):
        here = sources == number
        if here.any():
            judged.append(ByLog(file, validate(robot, signals, here, observation=observation).error))
    return tuple(judged)
