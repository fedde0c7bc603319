"""What a diagnosis by motion says beside the effects that it names: a load's mass, other bodies, other gains."""

from __future__ import annotations

from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
from elid_cli.diagnosis.by_motion.torque_gains import gain_name
from elid_cli.estimation.trajectory import words
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.report.answers.missing import spoken, whose
from elid_cli.report.answers.summary import listed, share_text
from elid_cli.report.tree import number_text
from elid_cli.robot.position_words import mean_words

ALIKE, PART = 3.0, 0.1
"""Standard errors, and part of themselves, within which gains of several drives are alike."""


def load_words(found: MotionDiagnosis) -> str:
    """Return what a load's mass is with the other of two effects beside it, where the log does not tell which it is.

    Those count that change what a drive or the weight does: friction leaves the mass as it is.
    """
    load, kinds = effect_that(carried=True).name, effect_classes()
    shifting = {name for name, kind in kinds.items() if kind.of_drive or kind.turns_gravity or kind.moves_zero}
    beside = [r for r in found.also_possible if r.effect in shifting and r.instead_of != load]
    if not beside or all(effect.effect != load for effect in found.effects):
        return ""
    cases = []
    for r in beside:
        mass = next((e.parameters.get("m") for e in r.beside if e.effect == load), None)
        here = "another, perhaps," if mass is None else f"{number_text(mass, 3)} kg"
        cases.append(f"{here} if it is {whose(r.effect, r.joint)}")
    return f" The mass of the {spoken(load)} depends on which it is: {listed(cases)}."


def scale_words(found: MotionDiagnosis) -> str:
    """Return by how much values are other where a load and a gain of the drive explain the motion alike."""
    load, gain = effect_that(carried=True).name, gain_name()
    sizes = [r.parameters["gain"] for r in found.also_possible if r.effect == gain and r.instead_of == load
             and "gain" in r.parameters]  # fmt: skip
    if len(sizes) != 1 or found.robot.n > 1:
        return ""
    change = 1.0 / (1.0 + sizes[0]) - 1.0
    size = f"{share_text(abs(change))} {'smaller' if change < 0 else 'larger'}"
    return f" If it is the gain, friction and offset below are {size}, and so are motor and bodies' inertia together."


def alike_words(found: MotionDiagnosis) -> str:
    """Return that gains which are alike may be off at the other joints too, where the motion shows no weight."""
    gains = [(e.joint, e.parameters["gain"], e.std_error["gain"]) for e in found.effects if e.effect == gain_name()]
    others = [name for name in found.robot.joint_names if name not in {joint for joint, _, _ in gains}]
    if len(gains) < 2 or not others:
        return ""
    mean = sum(gain for _, gain, _ in gains) / len(gains)
    if any(abs(gain - mean) > max(ALIKE * error, PART * abs(mean)) for _, gain, error in gains):
        return ""
    return (
        f" These gains are alike: that of {listed(others)}, of whose weight this log shows too little, may be off by "
        "as much, and its values with it."
    )


def bodies_words(found: MotionDiagnosis) -> str:
    """Return that other bodies than the file's would bring the motion nearer, where they would."""
    if not found.other_bodies or found.free_bodies is not None or found.alone:  # the bodies do each recording alone
        return ""
    most = share_text(max(found.other_bodies.values()))
    return (
        f" Other bodies than {found.robot.name} describes would bring the motion of {listed(list(found.other_bodies))} "
        f"nearer as well, by up to {most} of the squared error: check masses and payload (elid identify --fit torque "
        "estimates them)."
    )


def between_words(found: MotionDiagnosis) -> str:
    """Return that recordings do not agree, where each alone is simulated clearly nearer, and the loads they ask for."""
    if not found.alone:
        return ""
    names, files = found.robot.joint_names, found.recording.files
    most = max(one.mean_abs for one in found.alone)
    masses = [f"{number_text(one.mass, 2)} kg ({file})" for file, one in zip(files, found.alone, strict=False)
              if one.mass is not None]  # fmt: skip
    load = f", with a load that the file does not have: {listed(masses)}" if masses else ""
    return (
        f" The recordings do not agree; something changed between them. Each alone is simulated within "
        f"{mean_words(found.robot, dict.fromkeys(names, most), 2)} on average{load}. elid diagnose of each alone tells "
        "what."
    )


def owned_words(found: MotionDiagnosis) -> str:
    """Return what changed between recordings, where each has its own in the simulated motion."""
    told = {(item.name, item.joint) for item in found.differing}
    own = words.owned_words(found.fit_after, lambda kind, joint: (kind, joint) in told)
    if not own:
        return ""
    return (
        f" The recordings do not agree on {listed(own)}: each has its own in this motion, and the values below are the "
        "means."
    )


def free_bodies_words(found: MotionDiagnosis) -> str:
    """Return that the bodies of least squares come clearly nearer than all effects, where they do."""
    if found.free_bodies is None:
        return ""
    mine, its = mean_off(found, found.fit_after, bare=True), mean_off(found, found.free_bodies)
    beside = "all that is named here" if found.effects else "the bodies of the file"
    return (
        f"Bodies other than {found.robot.name} describes: with those that least squares find, the motion is off by "
        f"{its} on average, with {beside} by {mine}. Check masses, centres of mass and payload."
    )


def mean_off(found: MotionDiagnosis, fit: TrajectoryFit, *, bare: bool = False) -> str:
    """Return the mean size of the error of a fit's positions; `bare`: without the unit where joints have the same."""
    sizes = fit.mean_abs.mean(axis=0).tolist()
    return mean_words(found.robot, dict(zip(found.robot.joint_names, sizes, strict=True)), 2, bare=bare)


def gains_words(found: MotionDiagnosis) -> str:
    """Return that torques of another size come much nearer than the named effects, where they do."""
    nearer = [rival for rival in found.nearer if rival.effect == gain_name()]
    if not nearer:
        return ""
    joints, sizes = [r.joint or "" for r in nearer], [number_text(1.0 + r.parameters["gain"], 3) for r in nearer]
    return (
        f" Of these the torque gain at {listed(joints)} comes clearly nearest: the computed torque is {listed(sizes)} "
        "times what acts. Check kp and kd first."
    )
