"""The trajectory fit where nobody asked for it: torques that were computed from noisy positions bias least squares.

The noise of the encoders enters both sides of that equation, and so does what a delay makes of the gains times a
position. The simulated motion holds no measured position. But it takes the bodies as the robot file has them: where the
motion asks for others, and least squares, which have bodies of their own, lack nothing, their answer stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError, LogError, RobotError, in_words
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.at_noise import NOISE, is_at_noise
from elid_cli.estimation.trajectory.doubtful_joints import coupled_to, marked, standing
from elid_cli.estimation.trajectory.fit import ABOVE
from elid_cli.estimation.trajectory.identification import GAINS, fit_of, identification_of, unsuited
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns
from elid_cli.estimation.validation.verdicts import IMPOSSIBLE
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.of_drives import as_acting
from elid_cli.model.rollout_loops import compiled_steps
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

LONGEST = 15.0
"""Seconds that the fit may take about."""
SAMPLE, STEPS, PLAIN = 35e-6, 8e-4, 0.75
"""s; what the fit takes for a sample of a joint, and for a second of a chain of joints: compiled, by the cube of their
number; without Numba, by their number."""
CLEAR = 3.0
"""Times the sensors' noise above which what is left is not noise alone, whether it follows the motion or not."""
FARTHER = 4.0
"""Times that it may predict the torque worse than least squares do, which noise of positions makes fit it too well."""
COMPUTED = "the torque is computed from commands, and noise of the positions in it may bias this fit"


def or_by_motion(found: Identification, signals: Signals, *, delays: bool = True) -> Identification:
    """Return least squares' answer, or the trajectory fit's where that is due.

    It is due where every torque was computed from commands, the log is short, and the robot file describes the bodies,
    with which it is simulated as well as with others; or where more than the bodies is missing.

    Parameters
    ----------
    found
        What least squares say of the log.
    signals
        The log, with its recording.
    delays
        Whether a delay between commands and motion may be an unknown.
    """
    recording = signals.recording
    if recording is None or not recording.commanded.all() or not recording.commands.keys() >= GAINS:
        return found
    if not is_known(found.robot):
        return _with_shapes_held(found)
    if seconds(found.robot, signals) > LONGEST:
        return pointed_out(found, f", which takes about {seconds(found.robot, signals):.0f} s")
    signals = as_acting(found.robot, signals)
    try:
        fit, bodies = fit_of(found.robot, signals, recording, delays=delays)
    except (DataError, LogError, RobotError) as error:
        return _told(found, f"{COMPUTED}; the motion could not be fitted: {error}")
    stand = {found.robot.joint_names[k] for k in standing(found.robot, recording)}
    bodies = {name: share for name, share in bodies.items() if name not in stand}  # the others move those
    if bodies and _is_sufficient(found):
        return _with_own_bodies(found, list(bodies), signals, delays=delays)
    answer = identification_of(found, fit, signals, bodies)
    worse = _worse(found, answer)
    # where the motion leaves nothing but noise, the torque is at fault: velocities that it was computed from are late;
    # and filters of velocity are nothing that least squares know of: they hide in their inertia and friction
    filtered = bool(np.any(fit.filters) or fit.open_filters)
    if worse > FARTHER and not (filtered or is_at_noise(dict(enumerate(fit.above_noise(signals).tolist())), fit)):
        told = _told(
            found, f"{COMPUTED}; but that of the motion, with the bodies of {found.robot.name}, predicts torque that "
            f"was not fitted {worse:.2g} times as badly (--fit trajectory)",
        )  # fmt: skip
        return _contradicted(told, fit.above_noise(signals), "file")
    why = (
        "the motion is fitted, as with --fit trajectory: the torque is computed from commands, and noise of the "
        "positions in it biases least squares (--fit torque: these, with bodies of their own)"
    )
    return replace(answer, notes=(why, *answer.notes))


def _with_own_bodies(found: Identification, names: Sequence[str], signals: Signals, *, delays: bool) -> Identification:
    """Return least squares' answer where the motion of some joints asks for other bodies than the file's.

    It stands where the motion is simulated with its bodies; where that is no ground either, something is missing that
    bodies imitate.
    """
    moved, recording = in_words(names), signals.recording
    assert recording is not None
    doubt = (
        f"the motion of {moved} asks for other bodies than {found.robot.name} describes, or for drives that "
        "deliver another torque than kp and kd say, with which every value here scales: elid diagnose looks for "
        "the cause"
    )
    found = _told(
        replace(found, warnings=(*found.warnings, doubt)), f"{COMPUTED}; but the motion of {moved} is simulated "
        f"nearer to the measured one with other bodies than {found.robot.name} describes, and this fit, which has "
        "bodies of its own, leaves only noise (--fit trajectory takes those of the file)",
    )  # fmt: skip
    robot = replace(identified_robot(found), effects=found.robot.effects)
    try:
        fit, _ = fit_of(robot, signals, recording, delays=delays)
    except (DataError, LogError, RobotError):
        return found
    ratios = fit.above_noise(signals)
    return found if (ratios < ABOVE).all() else _contradicted(found, ratios, "own")


def _contradicted(found: Identification, ratios: Array, whose: Literal["file", "own"]) -> Identification:
    """Return least squares' answer where the simulated motion says that the model lacks something.

    Bodies and drives of their own leave next to nothing of the torque, and no drives move the robot as it moved: what
    is missing is in the values.

    Parameters
    ----------
    found
        What least squares say of the log.
    ratios
        Errors of the simulated positions in times the encoders' noise, (n,).
    whose
        The bodies that are simulated: those of the robot file, or of least squares.
    """
    names, far = found.robot.joint_names, set(np.flatnonzero(ratios >= NOISE).tolist())
    if not far:
        return found
    motion = {"bodies": whose, "noise_ratio": dict(zip(names, ratios.tolist(), strict=True))}
    return replace(
        found, model="insufficient", parameters=marked(found, coupled_to(found.robot, far)),
        settings={**found.settings, "simulated_motion": motion},
        nuisances=tuple(item.doubted for item in found.nuisances),
    )  # fmt: skip


def _is_sufficient(found: Identification) -> bool:
    """Whether what least squares leave is noise, and no value is one that no robot has."""
    negative = any(item.reason.startswith(IMPOSSIBLE) for item in found.parameters)
    return found.model == "sufficient" and all(item.ratio <= CLEAR for item in found.noise) and not negative


def _worse(found: Identification, answer: Identification) -> float:
    """Return how many times as badly an answer predicts torques as least squares, the mean over joints that move."""
    moving = [name for name, own in answer.drives.items() if own["fs"]["verdict"] != "refused"]
    pairs = [(answer.error[name].rms, found.error[name].rms) for name in moving
             if name in answer.error and name in found.error]  # fmt: skip
    ratios = [after / before for after, before in pairs if after > 0 and before > 0]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def pointed_out(found: Identification, how: str = "") -> Identification:
    """Return least squares' answer to computed torques, with a word on the trajectory fit, where that is possible."""
    if not is_known(found.robot):
        return found
    faster = "" if compiled_steps() or not how else ", a tenth of it with Numba (pip install numba)"
    return _told(found, f"{COMPUTED}: --fit trajectory fits the motion{how}{faster}")


def is_known(robot: Robot) -> bool:
    """Whether the trajectory fit knows a robot, its bodies are described, and what it declares keeps its shape."""
    drives = {*PARAMETERS, "Jm", "K"}
    named = zip(robot.parameter_names(), robot.reference().tolist(), strict=True)
    described = all(np.isfinite(value) for name, value in named if name.kind not in drives)
    return described and not unsuited(robot) and without_shapes(robot) is robot


def without_shapes(robot: Robot) -> Robot:
    """Return a robot without the effects whose shapes a fit would find along: what is of drives and poses stays."""
    kinds = [resolve(robot, spec)[0] for spec in robot.effects]
    plain = [k.softens or k.nuisance or k.of_drive or k.turns_gravity or k.moves_zero for k in kinds]
    kept = tuple(spec for spec, keep in zip(robot.effects, plain, strict=True) if keep)
    return robot if all(plain) else replace(robot, effects=kept)


def seconds(robot: Robot, signals: Signals) -> float:
    """Return about how long a fit of the log takes, s."""
    return seconds_of(robot, len(signals.tau), signals.dt)


def seconds_of(robot: Robot, samples: int, dt: float) -> float:
    """Return about how long a fit of samples (M, n) at a sample time takes, s."""
    sizes = np.array([len(joints) for joints in Unknowns(robot).chains])
    steps = STEPS * float(np.sum(sizes**3)) if compiled_steps() else PLAIN * float(np.sum(sizes))
    return SAMPLE * samples * robot.n + steps * samples * dt


def _with_shapes_held(found: Identification) -> Identification:
    """Return least squares' answer with a word on the trajectory fit, where only shapes of effects stand against it."""
    if without_shapes(found.robot) is found.robot or not is_known(without_shapes(found.robot)) or unsuited(found.robot):
        return found
    return _told(
        found, f"{COMPUTED}: --fit trajectory fits the motion, with declared effects in the shapes of the file"
    )


def _told(found: Identification, note: str) -> Identification:
    return replace(found, notes=(*found.notes, note))
