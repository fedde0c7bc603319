"""What a model that was identified or judged lacks, in sentences: rows that follow something, noise, elasticity.

Of a diagnosis, which looks for the cause, `missing.py` says it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from elid_cli.errors import in_words
from elid_cli.estimation.judgement import Insufficient, RowNoise
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.at_noise import is_at_noise
from elid_cli.estimation.validation.following import APART, DEFLECTION, FACTOR, LOGS, PACE, TURN, WEIGHT, ZERO
from elid_cli.estimation.validation.size_beside import TAKEN_UP
from elid_cli.estimation.validation.sufficiency import ABOVE, QUIET, UNCLEAR
from elid_cli.estimation.validation.verdicts import IMPOSSIBLE
from elid_cli.logs.adapt import YIELDING
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers.summary import NAMED, doubted, light, listed, share_text
from elid_cli.report.tree import number_text, upper

ABSORBED = {
    FACTOR: "the torque of {} looks off by a factor, which other values take up",
    ZERO: "the zero of the positions of {} looks off, or the base tilted, which other values take up",
    TURN: "the positions of {} look off once per turn, as an eccentric encoder's or gear's, which other values take up",
    WEIGHT: "a torque like a weight's looks missing at {}, such as a weak spring's, which other values take up (see the"
    " notes)",
}
"""What leaves next to nothing, as other values take it up; in place of ``{}`` the joint."""
NOTHING = "Nothing that this log shows"
UNSURE = f"{NOTHING} for sure."
"""What is said before what a log shows only likely."""
BELOW = (
    "a drive whose kd is smaller than the log has it, or whose loop holds its torque or filters its velocity, looks so"
)
"""What is said of viscous friction that is negative."""
HIDDEN = 3
"""Faults that are named at most of those that a log does not exclude."""
LOUD = ABOVE
"""A residual of this many times the sensors' white noise that does not follow the motion is noise with a memory."""


def words_of(found: Identification) -> str:
    """Return what the model of an identification lacks, in a sentence or two."""
    said = _far_motion(found) or _unlike_motion(found) or _elastic_words(found)
    loaded = "" if said else _load_words(found)
    if not said and not (loaded and found.model == "not judged"):
        said = _negative_words(found)
    if not said and not (loaded and found.model == "not judged"):
        said = lacking_words(found.model, found.insufficient, found.noise, alone=found.robot.n == 1)
    if found.model == "sufficient" and (taken := taken_up_words(found.notes)):
        said = f"{UNSURE} {taken} elid diagnose looks for it."
    said = " ".join(part for part in (loaded, said, _unjudged_words(found, said)) if part)
    if said.startswith(NOTHING):
        said += hidden_words(found)
    if (found.insufficient or is_unclear(found.noise)) and any(YIELDING in note for note in found.robot.notes):
        said += f" A transmission that yields looks like this, too: {YIELDING}."
    joints = found.motor_side.joints if found.motor_side else ()
    unshown = [joint.joint for joint in joints if joint.verdict == "refused"]
    if unshown:
        said += (
            f" The robot file has {listed(unshown)} elastic: what that does to the parameters is not known, as this "
            "log does not show the stiffness."
        )
        if found.insufficient or is_unclear(found.noise):
            said += " elid diagnose looks for what it does far below the antiresonance."
    return said


def _unjudged_words(found: Identification, said: str) -> str:
    """Return which joints' reversals the fit left out where it says that nothing is missing, in a sentence."""
    shares = found.settings.get("masked")
    if not said.startswith(NOTHING) or not isinstance(shares, list):
        return ""
    left_out = [joint.name for joint, share in zip(found.robot.joints, shares, strict=True) if share > 0]
    if not left_out:
        return ""
    at = "all joints" if len(left_out) == found.robot.n > 1 else listed(left_out)
    return f"Reversals of {at} were left out: elid diagnose tells whether friction changes towards zero speed."


def hidden_words(found: Identification) -> str:
    """Return what the log would not show, in a sentence after others; nothing where it would show all that matters."""
    if not found.not_excluded:
        return ""
    kinds = effect_classes()
    faults = [
        f"{kinds[item.effect].title or item.effect.replace('_', ' ')} of "
        f"{f'{number_text(item.up_to, 2)} {item.unit}' if item.unit else share_text(item.up_to)}"
        f"{f' at {item.joint}' if item.joint else ''}"
        for item in found.not_excluded
    ]
    moves = number_text(found.not_excluded[0].moves, 2)
    return (
        f" Not excluded, as other values would take it up unseen: {in_words(faults, HIDDEN)}; values are then off by "
        f"up to {moves} standard errors."
    )


def taken_up_words(notes: Sequence[str]) -> str:
    """Return what other parameters may have taken up by the notes of an identification, in sentences."""
    return " ".join(f"{upper(note)}." for note in notes if TAKEN_UP in note)


def lacking_words(
    model: str, insufficient: Sequence[Insufficient], noise: Sequence[RowNoise], *, alone: bool = False
) -> str:
    """Return what the model lacks, in a sentence: from what was said of it, rows that lack it, the noise of all.

    `alone`: the robot has one joint.
    """
    if model == "not judged":
        return "Not looked for: elid diagnose does that."
    if model == "insufficient" and insufficient and all(item.follows == LOGS for item in insufficient):
        return (
            f"Something: {rows_words(insufficient)}. A load, another robot, or what has changed between them: each log "
            "alone, and elid compare of two results, tell what."
        )
    if model == "insufficient":
        return f"Something: {rows_words(insufficient)}.{moment_words(noise)} elid diagnose looks for the cause."
    loud = max(noise, key=lambda n: n.ratio, default=None)
    memory = ""
    if loud is not None and loud.ratio > LOUD:
        size = f"The residual of {loud.joint} is {number_text(loud.ratio, 2)} times the white noise of its sensors"
        kept = f"torque noise with a correlation time of {loud.correlation * 1e3:.0f} ms"
        several = f"what depends on several {'variables' if alone else 'joints'} at once"
        if loud.ratio > UNCLEAR:
            found = f"{size} and follows no variable alone"
            if moment := moment_words(noise):
                return f"Not clear. {found}.{moment} elid diagnose looks for the cause."
            found = f"{found}: {kept}, a fault of the log, a ripple, or {several}"
            return f"Not clear. {found}. elid diagnose looks for the cause."
        memory = f" {size}: {kept}, or {several}."
    beyond = "" if any(item.ratio < QUIET for item in noise) else " beyond the sensors' noise"
    return f"{NOTHING}: no joint's residual follows the motion{beyond}.{memory}"


def moment_words(noise: Sequence[RowNoise]) -> str:
    """Return in which moments of the log most of what is left lies, in a sentence after another; nothing of none."""
    spans: dict[str, tuple[float, float]] = {}
    for item in noise:
        if item.moment is not None and item.ratio > UNCLEAR:
            start, stop = spans.get(item.joint, item.moment)
            spans[item.joint] = min(start, item.moment[0]), max(stop, item.moment[1])
    if not spans:
        return ""
    start, stop = min(s for s, _ in spans.values()), max(s for _, s in spans.values())
    if stop - start > 2 * max(b - a for a, b in spans.values()):  # several moments
        worst = max((i for i in noise if i.joint in spans), key=lambda i: i.ratio).joint
        spans = {worst: spans[worst]}
        start, stop = spans[worst]
    first, last = math.floor(10 * start) / 10, math.ceil(10 * stop) / 10
    return (
        f" Most of what is left at {listed(list(spans))} lies between {first:g} and {last:g} s: a stop, a collision or "
        f"a fault of the log? --leave-out {first:g}:{last:g} goes on without it."
    )


def _far_motion(found: Identification) -> str:
    """Return that a trajectory fit leaves more than noise where least squares do not, in a sentence; else nothing."""
    told = found.settings.get("trajectory")
    beyond: Mapping[str, float] = told.get("beyond_noise", {}) if isinstance(told, dict) else {}
    slow: Mapping[str, float] = told.get("velocity_filters", {}) if isinstance(told, dict) else {}
    if slow:
        return (
            f"Something: the motion of {listed(list(slow))} is nearer with a filter of the velocity that the drive "
            "damps by, which makes motor inertias come out too small. elid diagnose names it."
        )
    if negative := told.get("negative_friction") if isinstance(told, dict) else None:
        return f"Something: viscous friction of {listed(list(negative))} comes out below 0: {BELOW}."
    if found.model == "not judged" and beyond:
        return (
            "Something: the simulated motion is off by more than the encoders' noise at "
            f"{listed(list(beyond))} (up to {number_text(max(beyond.values()), 2)} times). "
            "elid diagnose looks for the cause."
        )
    return ""


def _unlike_motion(found: Identification) -> str:
    """Return that least squares leave little of the torque, and the motion is not simulated, in a sentence or two."""
    told = found.settings.get("simulated_motion")
    if not isinstance(told, dict):
        return ""
    besides = f" Besides, {rows_words(found.insufficient)}." if found.insufficient else ""
    pushing = [
        item.name for item in found.parameters if item.reason.startswith(IMPOSSIBLE) and item.leader.kind == "fv"
    ]
    slack = f" Viscous friction below 0 ({listed(pushing)}): {BELOW}." if pushing else ""
    return (
        f"Something: {_motion_off(found, told)}, whatever the drives; this fit may have taken what is missing into its "
        f"values.{slack}{besides} elid diagnose looks for the cause."
    )


def _motion_off(found: Identification, told: Mapping[str, Any]) -> str:
    """Return how far off the motion is that is simulated with some bodies, in a clause."""
    worst = max(told["noise_ratio"], key=lambda name: told["noise_ratio"][name])
    whose = f"the bodies of {found.robot.name}" if told["bodies"] == "file" else "the bodies found here"
    return (
        f"the motion simulated with {whose} is off by up to {number_text(told['noise_ratio'][worst], 2)} times the "
        f"encoders' noise (at {worst})"
    )


def unlike_motion_first(found: Identification, words: str) -> str:
    """Return whether a model can be trusted, `words` of its torque, with what the simulated motion says before it."""
    told = found.settings.get("simulated_motion")
    verdict, _, rest = words.partition(": ")
    if not isinstance(told, dict) or verdict.split(",")[0] not in ("Yes", "Mostly"):
        return words
    return f"Not to simulate: {_motion_off(found, told)}. As for this log's torque: {rest}"


def impossible_in(found: Identification) -> list[str]:
    """Return the parameters that came out negative beyond doubt, which those of a robot are not."""
    return [item.name for item in found.parameters if item.reason.startswith(IMPOSSIBLE)]


def _negative_words(found: Identification) -> str:
    """Return that values came out negative where nothing but noise is left, in a sentence; else nothing."""
    names = impossible_in(found)
    if not names or found.model != "sufficient":
        return ""
    return (
        f"Something, or the log is not what it is taken for: {listed(names)} came out negative, which no robot's is, "
        "although only noise is left. A wrong gain, sign, unit or gear ratio looks so; elid diagnose looks for effects."
    )


def is_doubted(found: Identification) -> bool:
    """Whether something may be missing although the residual of a model is called noise."""
    return is_unclear(found.noise) or bool(impossible_in(found)) or bool(taken_up_words(found.notes))


def motion_words(found: Identification, warnings: Sequence[str]) -> str:
    """Return that the simulated motion is right although the computed torque is not predicted, in a sentence.

    Nothing where the torque is predicted as well, or the motion is off by more than the encoders' noise.
    """
    told = found.settings.get("trajectory")
    ratios: Mapping[str, float] = told.get("noise_ratio", {}) if isinstance(told, dict) else {}
    poor = {name: error.relative for name, error in found.error.items() if light(error).text != "good"}
    if not ratios or not poor or found.model != "sufficient" or not is_at_noise(ratios):
        return ""
    worst = max(poor, key=lambda name: poor[name])
    holds = any(effect_classes()[item.effect].of_drive == "hold" for item in found.nuisances)
    why = "the drives' loops hold it between the log's samples" if holds else "its velocities are late or noisy"
    return doubted(
        "Yes: the motion simulated under the commands is off by the encoders' noise alone. The torque that was "
        f"computed from the log is off by up to {share_text(poor[worst])} (rms, at {worst}): {why}.",
        (*warnings, *found.warnings),
    )


def yielding(found: Identification) -> list[str]:
    """Return the joints that were found elastic and that the fit took as rigid."""
    side = found.motor_side
    return [joint.joint for joint in side.found] if side and not side.corrected else []


def _elastic_words(found: Identification) -> str:
    """Return what those joints may bias, in a sentence; nothing where there are none."""
    names = yielding(found)
    if not names:
        return ""
    besides = f" Besides, {rows_words(found.insufficient)}." if found.insufficient else ""
    return (
        f"The elasticity of {listed(names)}, whose stiffness was found: the fit takes "
        f"{'this joint' if len(names) == 1 else 'these joints'} as rigid, which may bias inertias, masses and first "
        "moments. elid identify of a single short log takes it out, without --accurate and --fit, where the motion "
        f"reverses seldom enough.{besides}"
    )


def _load_words(found: Identification) -> str:
    """Return whose friction grows with the load, as the motor side shows, in a sentence or two; else nothing."""
    if found.motor_side is None:
        return ""
    from elid_cli.estimation.motor_side.hidden_motion import undeclared_load_friction

    loaded = undeclared_load_friction(found, found.motor_side.joints)
    if not loaded:
        return ""
    said = listed([f"{name} ({share_text(share)} of the load)" for name, share in loaded.items()])
    return (
        f"Friction that grows with the load at {said}, as the motor's side shows: fs and fv hold it at this log's "
        f"loads. Declared in the robot file (effects: load_friction), {'it' if len(loaded) == 1 else 'they'} would be "
        "told apart."
    )


def is_unclear(noise: Sequence[RowNoise]) -> bool:
    """Whether a residual is so far above the sensors' noise that something may be missing that follows nothing."""
    return any(item.ratio > UNCLEAR for item in noise)


def loud_joints(noise: Sequence[RowNoise]) -> list[str]:
    """Return the joints whose residual is more than the sensors' white noise."""
    return list(dict.fromkeys(n.joint for n in noise if n.ratio > LOUD))


def rows_words(rows: Sequence[Insufficient]) -> str:
    """Return rows with their residual over noise, the worst of each joint."""
    absorbed = {word: [item.joint for item in rows if item.follows == word] for word in ABSORBED}
    worst: dict[str, Insufficient] = {}
    for item in sorted(rows, key=lambda item: item.ratio):
        if item.follows not in ABSORBED:
            worst[item.joint] = item
    ranked = sorted(worst.items(), key=lambda pair: -pair[1].ratio)
    said = [
        f"the residual of {joint} {follows_words(item.follows)} ({_size_words(item.ratio)})"
        for joint, item in ranked[:NAMED]
    ]
    said += [f"and {len(ranked) - NAMED} more joints"] if len(ranked) > NAMED else []
    said += [ABSORBED[word].format(" or ".join(joints)) for word, joints in absorbed.items() if joints]
    return "; ".join(said)


def _size_words(ratio: float) -> str:
    """Return a residual over noise; noise that it is below is that of a torque that chatters, and none of sensors."""
    small = "within the noise as it was estimated, which is too large"
    return small if ratio < 1.0 else f"{number_text(ratio, 2)} times the sensors' noise"


def follows_words(variable: str) -> str:
    """Return that a residual follows a variable; what only time explains changes in the course of the log."""
    words = {"time": "changes in the course of the log", PACE: "changes as slowly as the torque",
             LOGS: "differs from log to log",
             DEFLECTION: "is in the deflection and not in the torque, a fault of the transmission or its encoders",
             APART: "is what other values of its parameters would explain, which other equations rule out"}  # fmt: skip
    return words.get(variable, f"follows the {variable}")
