"""Stiffness of the transmissions whose links nobody logged: the door of this folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.best_end import FALL, RESTS, Search
from elid_cli.estimation.motor_side.columns import EXPLAINED, MISFIT
from elid_cli.estimation.motor_side.hidden import hidden_joints
from elid_cli.estimation.motor_side.latent_fit import LatentFit
from elid_cli.estimation.motor_side.link_sensors import LinkSensors, Mounted, fewer_of, left_out, sensors_of
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.motor_log import HIGHEST, Samples
from elid_cli.estimation.motor_side.mounting import mounted
from elid_cli.estimation.motor_side.refits import Figures, first_figures, friction_width, rise, with_moves
from elid_cli.estimation.motor_side.response import Response, responses_of
from elid_cli.estimation.motor_side.result import LinkSensor, MotorSide, MotorSideJoint, NextMotion, why
from elid_cli.estimation.motor_side.rotors import rotors_of
from elid_cli.estimation.motor_side.search import search
from elid_cli.estimation.motor_side.setting import Setting
from elid_cli.estimation.motor_side.stretch import stretch_of
from elid_cli.estimation.motor_side.verdict import (
    CRAWLS,
    MOVE,
    RISES,
    TIGHT,
    failed_gates,
    suffices,
    taken_as_rigid,
    verdict_of,
)
from elid_cli.estimation.motor_side.vibration import Vibration
from elid_cli.model.antiresonance import PAST, RIGID_ERROR, expected_antiresonance
from elid_cli.robot.locking import locked
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording

LEAST_ERROR, LEAST_DOUBTFUL, WELL_FITTED = 0.002, 0.01, 1.2
"""Least standard error, share of the stiffness, and that where the cost per degree of freedom is above the third, or
where the fit creeps. Measured: simulated logs of sensors so fine that noise leaves 0.01 % are 0.1 % off."""
ASYMMETRY = 0.25
"""Standard deviation of how differently load friction brakes in driving and back-driving, share of it."""
OF_FORM = 0.5
"""Standard deviation of what the form of friction and of lost motion may hide, share of what it moved."""
LOW = 2.0
"""Its own standard errors from which on the move of a refit to low frequencies counts, unless that knows too little."""
DITHER = (2.0, 6.0)
"""Accelerations of all inertia that a torque multisine should make, rad/s² (m/s²)."""
GUESSED_TOP = 2.0
"""Highest frequency of the multisine over this log's band where the antiresonance to expect is unknown."""


def motor_side(robot: Robot, recording: Recording, still: NDArray[np.bool_]) -> MotorSide | None:
    """Estimate the stiffness of joints with hidden links, or return None where there are none.

    Links of other elastic joints, which the log holds, are unknown here, too.

    Parameters
    ----------
    robot
        As described, n joints.
    recording
        One log.
    still
        Joints that do not move in it, (n,).
    """
    hidden = hidden_joints(robot, recording)
    if not hidden:
        return None
    moving = np.flatnonzero(~still)
    resting = [k for k in hidden if k not in moving]
    found = [_unseen(robot, k, "it does not move") for k in resting]
    asked = [k for k in hidden if k in moving]
    if asked:
        answer = _estimated(robot, recording, moving.tolist(), asked)
        return replace(answer, joints=tuple(sorted((*answer.joints, *found), key=lambda joint: joint.number)))
    return MotorSide(tuple(found))


PLACED = 0.05
"""Standard error up to which a coordinate of an accelerometer's place is told, m."""


def _estimated(robot: Robot, recording: Recording, moving: Sequence[int], asked: Sequence[int]) -> MotorSide:
    """Return what is found of the joints that are asked for."""
    sensors = sensors_of(robot, recording, moving)
    samples = stretch_of(recording, np.asarray(moving), sensors)
    if isinstance(samples, str):
        return MotorSide(tuple(_unseen(robot, k, samples) for k in asked))
    seen = _as_moving(robot, recording, moving, asked)
    with np.errstate(all="ignore"):
        used, strange = _mounted(samples, seen)
        setting, total = _setting(seen, samples, used)
        answer = _answer(setting)
        for fewer in fewer_of(used):
            if answer is not None and answer.told.chi <= MISFIT:
                break
            other, _ = _setting(seen, samples, fewer)
            found = _answer(other)
            if found is not None and (answer is None or found.told.chi <= MISFIT):
                strange = left_out(strange, sensors, fewer)
                setting, answer = other, found
        places = [list(moving).index(k) for k in asked]
        rigid = [] if answer is None else taken_as_rigid(answer.failed, places)
        again = _with_rigid(seen, setting, rigid) if rigid else None
    fits = [again if again is not None and place not in rigid else (setting, answer, total) for place in places]
    joints = [_judged(robot, k, place, *fit) for k, place, fit in zip(asked, places, fits, strict=True)]
    seconds = float(samples.t[-1] - samples.t[0])
    told = _sensors(seen, sensors, strange, answer)
    last = answer if again is None else again[1]
    return MotorSide(tuple(joints), float("nan") if last is None else last.told.chi, seconds, told)


def _with_rigid(robot: Robot, setting: Setting, rigid: Sequence[int]) -> tuple[Setting, _Answer, Array] | None:
    """Return what a log says with some of its joints as rigid, or None where that leaves more than noise.

    The rotor of a joint that does not yield, its damper and a compliance without a sign run off together.
    """
    joints = [replace(joint, transmission="rigid") if k in rigid else joint for k, joint in enumerate(robot.joints)]
    other, total = _setting(replace(robot, joints=tuple(joints)), setting.samples, setting.samples.sensors)
    answer = _answer(other)
    return None if answer is None or answer.told.chi > EXPLAINED else (other, answer, total)


def _setting(robot: Robot, samples: Samples, sensors: Sequence[LinkSensors]) -> tuple[Setting, Array]:
    """Return what is fitted with some sensors, and the inertia that each motor moves, kg·m², (n,)."""
    samples, link = replace(samples, sensors=tuple(sensors)), LinkSide(robot, [own.joints for own in sensors])
    rotors, total = rotors_of(robot, link, samples)
    return Setting(samples, link, rotors), total


def _mounted(samples: Samples, robot: Robot) -> tuple[tuple[LinkSensors, ...], list[dict[int, str]]]:
    """Return the sensors on links with first estimates of how they are mounted, and why others are left out."""
    found = [mounted(own, robot, samples.theta, 1 / samples.rate) for own in samples.sensors]
    return tuple(used for used, _ in found), [strange for _, strange in found]


def _sensors(
    robot: Robot, logged: Sequence[LinkSensors], strange: Sequence[Mapping[int, str]], answer: _Answer | None
) -> tuple[LinkSensor, ...]:
    """Return what was found of every sensor on a link."""
    found = []
    for kind, (own, why_not) in enumerate(zip(logged, strange, strict=True)):
        place = 0
        for number, joint in enumerate(robot.joint_names[k] for k in own.joints):
            if number in why_not or answer is None:
                found.append(LinkSensor(own.kind.name, joint, why_not.get(number, "no fit was found")))
                continue
            mounting, bias, delay, places = (values[place].tolist() for values in answer.mounted[kind])
            found.append(
                LinkSensor(own.kind.name, joint, "", tuple(map(tuple, mounting)), tuple(bias), delay, tuple(places))
            )
            place += 1
    return tuple(found)


class _Answer(NamedTuple):
    """A fit's figures, the gates that every joint fails, its vibration, and responses of joints not refused."""

    told: Figures
    failed: list[tuple[str, ...]]
    vibration: Vibration
    responses: Mapping[int, Response]
    mounted: list[Mounted]
    """How the sensors on links that were used are mounted, of every kind."""


def _answer(setting: Setting) -> _Answer | None:
    """Return what a log says, or None where no fit is found."""
    try:
        found = search(setting)
        told = first_figures(found)
        if any(verdict_of(failed_gates(told, k)) != "refused" for k in range(setting.link.n)):
            told = with_moves(found, told)
        failed, fitted = _failed(found, told), Vibration(found.best)
        shown = [k for k, names in enumerate(failed) if verdict_of(names) != "refused"]
        responses = responses_of(fitted, setting.samples, shown, setting.bands) if shown else {}
        return _Answer(told, failed, fitted, responses, _as_told(found.best))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _as_told(best: LatentFit) -> list[Mounted]:
    """Return how sensors are mounted; coordinates of a place that the motion does not tell are NaN."""
    values, errors = best.problem.mounted(best.x), best.problem.mounted(best.errors)
    return [
        own._replace(places=np.where(error.places < PLACED, own.places, np.nan))
        for own, error in zip(values, errors, strict=True)
    ]


def _failed(found: Search, told: Figures) -> list[tuple[str, ...]]:
    """Return the gates that every joint fails; the last ones, which take further fits, where the others are passed."""
    widths = None
    failed = [failed_gates(told, k) for k in range(len(told.compliance))]
    for k, names in enumerate(failed):
        verdict = verdict_of(names)
        if verdict == "weak":
            widths = friction_width(found) if widths is None else widths
            if not widths[k] < MOVE:
                names.append("friction")
        loose = told.error[k] > TIGHT * told.compliance[k] or _crawls(told, k, CRAWLS)
        if verdict_of(names) != "refused" and (loose or verdict == "weak"):
            share, least = RISES[verdict]
            if not rise(found, k, share, least) > least:
                names.append("valley")
    return [tuple(names) for names in failed]


def _crawls(told: Figures, joint: int, fall: float) -> bool:
    """Return whether further steps lower the cost by more than a share, unless the compliance rests, at noise."""
    return told.fall > fall and not (told.chi <= EXPLAINED and told.moved[joint] < RESTS)


def _as_moving(robot: Robot, recording: Recording, moving: Sequence[int], asked: Sequence[int]) -> Robot:
    """Return the robot of the joints that move; the others are held where they rest.

    Elastic are those asked for and those whose motors the log holds.
    """
    theta = np.where(np.isnan(recording.theta), recording.q, recording.theta)
    motors = [bool(np.isfinite(column).any()) for column in recording.theta.T]
    joints = [
        replace(joint, transmission="elastic" if k in asked or (joint.elastic and motors[k]) else "rigid")
        for k, joint in enumerate(robot.joints)
    ]
    rest = {
        joint.name: float(np.nan_to_num(np.nanmean(theta[:, k])))
        for k, joint in enumerate(robot.joints)
        if k not in moving
    }
    return locked(replace(robot, joints=tuple(joints), effects=()), rest)


def _unseen(robot: Robot, number: int, reason: str) -> MotorSideJoint:
    return MotorSideJoint(
        robot.joint_names[number], number, "refused", reference=_reference(robot, number), reason=reason
    )


def _reference(robot: Robot, number: int) -> float:
    index = {name: k for k, name in enumerate(robot.parameter_names())}
    return float(robot.reference()[index[StandardParameter("K", number)]])


def _judged(
    robot: Robot, number: int, place: int, setting: Setting, answer: _Answer | None, total: Array
) -> MotorSideJoint:
    """Return what is said of one joint, which is number `place` among those that move."""
    motion = _next_motion(robot, number, setting, place, total)
    base = replace(
        _unseen(robot, number, "no fit of the equations was found"),
        band=float(setting.bands[place]),
        motion=motion,
    )
    if answer is None:
        return base
    told, failed, fitted = answer.told, answer.failed[place], answer.vibration
    verdict = verdict_of(failed)
    judged = replace(base, verdict=verdict, failed=failed, reason=why(failed), gates=_gates(told, place))
    if verdict == "refused":
        expected = motion.top / PAST if motion.known else float(told.antiresonance[place])
        return replace(judged, motion=None) if suffices(failed, base.band, expected) else judged
    c, error = float(told.compliance[place]), float(told.error[place])
    doubtful = told.chi > WELL_FITTED or _crawls(told, place, FALL)
    share = max(error / c, LEAST_DOUBTFUL if doubtful else LEAST_ERROR)
    parts = (
        ASYMMETRY * told.load_friction[place],
        OF_FORM * _form(told, place),
        _of_damper(told, place),
        *_of_rows(told, place),
    )
    systematic = float(np.linalg.norm(parts)) / c
    return replace(
        judged, stiffness=1 / c, std_error=float(np.hypot(share / c, systematic)), systematic=systematic,
        rotor=float(told.rotor[place]), antiresonance=fitted.antiresonance(place), resonance=fitted.resonance(place),
        rigid_to=fitted.rigid_to(place, RIGID_ERROR), motion=motion if verdict == "weak" else None,
        response=answer.responses[place],
    )  # fmt: skip


def _form(told: Figures, place: int) -> float:
    """Return how far other forms of friction and of lost motion moved a compliance at most, share of it."""
    moves = told.moves
    return 0.0 if moves is None else float(max(abs(moves.friction[place]), abs(moves.spring[place])))


def _of_rows(figures: Figures, place: int) -> tuple[float, ...]:
    """Return how far other rows move a compliance, shares of it.

    Low frequencies, finer knots, both halves together, torque rows with less noise.

    The same samples are in all: such a move is none of their noise, but what the equations and the spline leave out.
    Low frequencies alone have an error of their own, within which they count nothing.
    """
    moves = figures.moves
    if moves is None:
        return ()
    low, low_error = (float(values[place]) for values in moves.low)
    share = [move[place] for move, _ in moves.halves]
    weight = [1 / max(float(error[place]), 1e-12) ** 2 for _, error in moves.halves]
    halves = float(np.average(share, weights=weight))
    told = LOW * low_error < min(abs(low), 2 * MOVE)
    closer = 0.0 if figures.sharper is None else float(figures.sharper[place])
    return (low if told else 0.0), float(moves.knots[place]), halves, closer


def _of_damper(told: Figures, place: int) -> float:
    """Return the first order of a transmission's damper that its series leaves out, share of the compliance.

    1 / (1 + iωT) = 1 - iωT + (iωT)² - …, at the antiresonance.
    """
    return abs(2 * np.pi * float(told.antiresonance[place]) * float(told.damping[place])) ** 3


def _next_motion(robot: Robot, number: int, setting: Setting, place: int, total: Array) -> NextMotion:
    """Return the motion that would show a stiffness: past its antiresonance, as far as that can be told."""
    # a rigid fit that failed moves less than the rotor alone
    moved = max(float(total[place]), float(setting.rotors.value[place]))
    expected = expected_antiresonance(robot, number)
    known = bool(np.isfinite(expected))
    top = PAST * expected if known else min(GUESSED_TOP * float(setting.bands[place]), HIGHEST)
    unit = robot.joints[number].units[1]
    return NextMotion((DITHER[0] * moved, DITHER[1] * moved), float(top), known, robot.joint_names[number], unit)


def _gates(told: Figures, i: int) -> dict[str, float]:
    """Return what the gates looked at of one joint, by name."""
    seen = {
        "error": told.error[i] / abs(told.compliance[i]), "gain": told.gain[i], "misfit": told.chi, "fall": told.fall,
        "rotor_pull": told.rotor_pull[i], "rotor_told": told.rotor_sensitivity[i], "delay": told.delay,
        "damping": told.damping[i], "load": told.load_friction[i], "load_error": told.load_friction_error[i],
    }  # fmt: skip
    if told.moves:
        moves = told.moves
        seen |= {
            "cut": moves.cut[i],
            "low": moves.low[0][i],
            "knots": moves.knots[i],
            "friction": moves.friction[i],
            "spring": moves.spring[i],
        }
        seen |= {name: half[0][i] for name, half in zip(("first_half", "second_half"), moves.halves, strict=True)}
    return {name: float(value) for name, value in seen.items()}
