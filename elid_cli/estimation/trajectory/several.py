"""Several logs with computed torques: short ones are fitted by their motion together, as one is unasked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.estimation.validation.prediction import ByLog, errors_by_log
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals


def moved_unasked(robot: Robot, logs: Sequence[ReducedLog], options: EstimateOptions) -> bool:
    """Whether logs with computed torques are fitted by their motion: they are at hand, and short together."""
    if not options.chooses or any(log.origin for log in logs):
        return False
    from elid_cli.estimation.trajectory.unasked import LONGEST, is_known, seconds_of

    samples, dt = sum(log.recording.samples for log in logs), max(log.facts.dt for log in logs)
    return is_known(robot) and seconds_of(robot, samples, dt) <= LONGEST


def by_motion(
    request: LogRequest, found: Identification, apart: tuple[ByLog, ...], *, delays: bool
) -> tuple[Identification, Recording, tuple[ByLog, ...], Signals]:
    """Return what the motion of several logs says, with its errors by log, or least squares' answer where that stands.

    Parameters
    ----------
    request
        The logs.
    found, apart
        What least squares say of them, and how well by log.
    delays
        Whether a delay between commands and motion may be an unknown.
    """
    from elid_cli.estimation.loops_of_torque import with_loop_words
    from elid_cli.estimation.reading import read_signals
    from elid_cli.estimation.refined_robot import identified_robot
    from elid_cli.estimation.trajectory.unasked import or_by_motion

    recording, signals = read_signals(replace(request, on_read=None, progress=None))
    signals = as_told(request.robot, signals)
    recording = signals.recording or recording
    answer = or_by_motion(found, signals, delays=delays)
    if answer.estimator == "trajectory":
        apart = errors_by_log(identified_robot(answer), signals, recording.files)
    else:
        answer = with_loop_words(answer, recording)
    return answer, recording, apart, signals
