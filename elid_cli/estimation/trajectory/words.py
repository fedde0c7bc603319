"""What a trajectory fit says beside its values, in sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import in_words
from elid_cli.estimation.trajectory.differing import Differing
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import settled
from elid_cli.estimation.trajectory.held_loops import less_by_holding, loops_bend, matters, negative
from elid_cli.estimation.trajectory.settings import softness
from elid_cli.estimation.trajectory.simulator_steps import LONGEST
from elid_cli.estimation.trajectory.timing_doubts import step_of
from elid_cli.estimation.trajectory.unknowns import KINDS
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import declared_loops, has_steps, open_filters
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

SHOWN = 3.0
"""Standard errors by which a friction is below 0 that is called negative."""
SEVERAL = 1.5
"""Steps of a simulator from which on a loop may hold its torque for more than one."""
HOLDS = (
    "the drives' loops are simulated {rate}, their torque held for {period}: the motion is nearer so than "
    "with loops that act all the time, with which viscous friction and motor inertia come out too small by kp and kd "
    "times half {that}"
)
"""Said of drives that were found to hold their torque."""
SAME = 0.1
"""Part by which a period may be off a sample that is called the log's rate."""
OTHERS = (
    "; loops of {others} come as near, and the standard errors count that (a held_loop declared in the robot file says "
    "how long it is)"
)
"""Said of other periods that do as well."""
STEPS = (
    "the log is simulated as that of a simulator, in semi-implicit Euler steps of {step:.3g} ms (MuJoCo's Euler), "
    "which the motion is clearly nearer to than to smooth motion; values are that simulator's own"
)
"""Said of a log that was found to be of a simulator."""
AHEAD = 0.5
"""ms; lead of friction that is worth a word."""


OWNED = (("fs", "Coulomb friction"), ("fv", "viscous friction"), ("offset", "torque offset"))
"""What may be each recording's own, in the order of `KINDS` after the inertia: name, and words."""


def difference_words(item: Differing) -> str:
    """Return what recordings do not agree on, in a sentence."""
    values = ", ".join(f"{value:.3g}" for value in item.values)
    change = f"; it changed before recording {item.changed_at + 1}" if item.changed_at is not None else ""
    return f"the recordings do not agree on {item.name} of {item.joint}: {values} {item.unit}{change}"


def own_value_words(fit: TrajectoryFit) -> tuple[str, ...]:
    """Return which friction and offsets are each recording's own, in a sentence; none where there are none."""
    told = owned_words(fit)
    return () if not told else (
        f"each recording has its own {in_words(told)} in the simulated motion, as one value for all does not fit them; "
        "the values told, and written, are the means",
    )  # fmt: skip


def owned_words(fit: TrajectoryFit, only: Callable[[str, str], bool] = lambda kind, joint: True) -> list[str]:
    """Return what is each recording's own, kind by kind: those of a name and a joint that `only` allows."""
    own, found = fit.unknowns, list[str]()
    for number, (name, words) in enumerate(OWNED, start=1):
        names = [own.robot.joint_names[joint] for joint, kind in own.own if kind == number]
        joints = [joint for joint in names if only(name, joint)]
        if joints:
            found.append(f"{words} of {in_words(joints)}")
    return found


def late_words(robot: Robot, fit: TrajectoryFit) -> str:
    """Return how late the motion is in each recording, and which joints are later than the others."""
    sign, side = (-1.0, "ahead of") if (fit.delays < 0).all() else (1.0, "later than")
    usual = ", ".join(f"{1e3 * sign * delay:.2g}" for delay in fit.delays)
    extra = np.broadcast_to(fit.tracked[0].run.extra, robot.n).tolist()
    apart = [f"{name} {1e3 * more:.2g} ms later than that" for name, more in zip(robot.joint_names, extra, strict=True)
             if more]  # fmt: skip
    same = " (the same is assumed for all drives)" if robot.n > 1 and fit.delays.any() and not apart else ""
    return f"the motion is {', '.join((f'{usual} ms {side} the commands{same}', *apart))}"


def doubt_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return which drives may act at another time than the fit has them, in a sentence; none where there are none."""
    doubted = np.broadcast_to(fit.doubted, robot.n).tolist()
    said = [f"{name} {1e3 * abs(late):.2g} ms {'later' if late > 0 else 'earlier'}"
            for name, late in zip(robot.joint_names, doubted, strict=True) if late]  # fmt: skip
    if not said:
        return ()
    return (f"drives that may act at another time than the fit has them: {', '.join(said)}; the log is not sure of it, "
            "and the standard errors count it",)  # fmt: skip


def filter_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return that the motion is nearer with filters of the drives' velocity, in a sentence; none where it is not."""
    times = np.broadcast_to(fit.filters, robot.n)
    slow, none = np.flatnonzero(times), open_filters(robot) if not fit.open_filters else ()
    if not len(slow):
        return () if not none else (
            f"{effect_that(of_drive='filter').name} of {in_words([robot.joint_names[k] for k in none])} is declared "
            "without a time, and this motion shows none: none is taken",
        )  # fmt: skip
    return (
        f"the motion of {in_words([robot.joint_names[k] for k in slow])} is nearer with a filter of the velocity that "
        f"the drive damps by, of {_span(1e3 * times[slow])} ms. Without it, as here, motor "
        "inertias are too small by kd times that, and the standard errors count it: elid diagnose names it, and writes "
        "a robot that has it",
    )


def friction_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return which joints come out without viscous friction, or with a negative one, in a sentence; none: no joint."""
    joints = [robot.joint_names[k] for k in np.flatnonzero(negative(fit))]
    if not joints:
        return ()
    some = bool(negative(fit, SHOWN).any())
    if fit.at_once and not some:
        return ()
    how = "below 0, which no joint has" if some else "at 0 or below"
    return (
        f"viscous friction of {in_words(joints)} comes out {how}: drives whose kd is smaller than the log has it, that "
        "hold their torque or that damp by a filtered velocity look so (held_loop and velocity_filter in the robot "
        f"file), and motor inertia is too small then{'' if some else '; a simulated robot may have none'}",
    )


def sum_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return which torque offsets are known in a sum with what else is constant, in sentences; none where none is."""
    moved = fit.unknowns.joint_values(settled(fit) - fit.z)[:, KINDS.index("offset")]
    joints = [robot.joint_names[k] for k in np.flatnonzero(moved)]
    rates = fit.tracked[0].run.drives.ki
    added = [] if rates is None else [robot.joint_names[k] for k in np.flatnonzero(rates)]
    preloads = () if not joints else (
        f"the torque offset of {in_words(joints)} and what an effect adds to it at any angle, as the preload of a "
        "spring, are known in their sum alone: the effect is taken to push nowhere on the whole",
    )  # fmt: skip
    held = () if not added else (
        f"the torque offset of {in_words(added)} is told with what the integral term of the drive holds when the log "
        "begins: the log shows their sum alone",
    )  # fmt: skip
    return (*preloads, *held)


def bodies_words(robot: Robot, bodies: Mapping[str, float]) -> tuple[str, ...]:
    """Return that the motion asks for other bodies than the file's, in a sentence; none where it does not."""
    if not bodies:
        return ()
    share = _span([100 * part for part in bodies.values()])
    return (
        f"the motion of {in_words(list(bodies))} asks for other bodies than {robot.name} describes: they take {share} "
        "% off its squared error where it was not fitted. Values and standard errors are those with the bodies of the "
        "file: masses may be wrong (--fit torque estimates them), or something is missing that imitates them, such as "
        "a spring (elid diagnose)",
    )


def _span(values: Iterable[float]) -> str:
    """Return the least and the greatest of numbers, in words, or the one that both are."""
    every = list(values)
    least, most = f"{min(every):.2g}", f"{max(every):.2g}"
    return least if least == most else f"{least} to {most}"


def command_words(fit: TrajectoryFit) -> tuple[str, ...]:
    """Return that commands may as well change smoothly between samples, in a sentence; none where it is known."""
    if not fit.smoother:
        return ()
    late = 1e3 * float((fit.delays + fit.smoother).mean())
    return (
        "commands are taken as held for their sample; where they change smoothly from sample to sample, as where "
        f"drives are told more often than is logged, the motion is simulated as well with a delay of {late:.3g} ms, "
        "which the standard errors count (--commands smooth, or held, says which)",
    )


def loop_words(
    robot: Robot, fit: TrajectoryFit, signals: Signals, moves: NDArray[np.bool_]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is taken of the drives' loops, and what another would change, as a note, or as a warning."""
    recording = signals.recording
    assert recording is not None
    told = _loop_words(robot, fit, recording, moves)
    return ((), told) if fit.loops or loops_bend(fit, recording) else (told, ())


def _loop_words(robot: Robot, fit: TrajectoryFit, recording: Recording, moves: NDArray[np.bool_]) -> tuple[str, ...]:
    held = [(item.run.drives.held, item.run.dt) for item in fit.tracked if item.run.drives.held is not None]
    if held:
        often = float(held[0][0].max())
        period = f"{1e3 * held[0][1] / often:.3g} ms"
        once = {"rate": "at the log's rate", "period": "a sample", "that": "a sample"}
        several = {"rate": f"{often:g} times per sample" if often == round(often) else f"every {period}",
                   "period": period, "that": "that"}  # fmt: skip
        if declared_loops(robot).any():
            return ()
        told = HOLDS.format(**(once if often == 1 else several))
        others = in_words([f"{1e3 * held[0][1] / k:.3g} ms" if k else "no length (that act all the time)"
                           for k in sorted(fit.loops, reverse=True)])  # fmt: skip
        return (told + (OTHERS.format(others=others) if fit.loops else ""),)
    run = fit.tracked[0].run
    if run.drives.stepped is not None and (fit.unseen or 0.0) < SEVERAL * step_of(run):
        return ()
    less, matter = less_by_holding(fit, recording), matters(fit, recording) & moves[:, [0, 2]]
    if not matter.any():
        return ()
    longest = recording.dt if fit.unseen is None else fit.unseen
    every = "at the log's rate" if abs(longest / recording.dt - 1.0) < SAME else f"every {1e3 * longest:.2g} ms"
    said: list[str] = []
    for place, (words, unit) in enumerate((("motor inertia", "kg·m²"), ("viscous friction", "N·m·s/rad"))):
        if matter[:, place].any():
            worst = int(np.argmax(np.where(matter[:, place], less[:, place], 0.0)))
            unit = unit if robot.joints[worst].revolute else {"kg·m²": "kg"}.get(unit, "N·s/m")
            size = f"up to {less[worst, place]:.2g} {unit} ({robot.joint_names[worst]})"
            said.append(f"{words} {'by' if said else 'is larger by'} {size}")
    return (
        f"the drive's loop is taken to act all the time; computed {every} and held so long, {' and '.join(said)}, "
        "which this motion does not tell apart and no standard error counts (held_loop in the robot file)",
    )


def time_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return what is surely wrong with when drives act: no viscous friction, or stamps, in sentences."""
    return (*friction_words(robot, fit), *stamp_words(fit))


def stamp_words(fit: TrajectoryFit) -> tuple[str, ...]:
    """Return that commands and positions are not of one time, in a sentence; none where they may be."""
    if fit.ahead <= LONGEST * fit.tracked[0].run.dt:
        return ()
    return (
        f"the motion is {1e3 * fit.ahead:.2g} ms ahead of the commands, which neither a drive nor a simulator's steps "
        "do: commands or positions are stamped at another time than that of the log; values are those with this taken "
        "out",
    )


def step_words(robot: Robot, fit: TrajectoryFit) -> tuple[str, ...]:
    """Return what was found of a simulator's steps, and what of them the log leaves open, in sentences."""
    run, joints = fit.tracked[0].run, robot.joints
    kd = np.mean([item.run.drives.kd for item in fit.tracked], axis=0)
    worst = int(np.argmax(kd))
    unit, name = "kg·m²" if joints[worst].revolute else "kg", joints[worst].name
    if fit.ahead > LONGEST * run.dt:
        return ()
    if fit.ahead:
        size = f"{fit.ahead * kd[worst]:.2g} {unit} ({name})"
        return (
            f"the motion is {1e3 * fit.ahead:.2g} ms ahead of the commands, as in a simulator's steps of twice that, "
            f"which the log is too coarse to show: motor inertia would be larger by up to {size} with them, and the "
            "standard errors count it",
        )
    if run.drives.stepped is None or has_steps(robot):
        return ()
    step = step_of(run)
    kind = effect_that(of_drive="step").name
    damping = {"explicit": "", "implicit": "; the drives' damping is implicit in them"}[run.drives.stepped]
    said = STEPS.format(step=1e3 * step) + damping
    if not fit.either:
        return (said,)
    size = f"up to {step * kd[worst]:.2g} {unit} ({name})"
    return (
        said, f"the drives' damping is taken as explicit in these steps; where the simulator takes it as implicit "
        f"(MuJoCo's implicitfast with position actuators), motor inertia is smaller by kd times a step, {size}, "
        f"which this motion does not tell apart: declare {kind} with implicit: 1",
    )  # fmt: skip


def softness_words(robot: Robot, fit: TrajectoryFit) -> list[str]:
    """Return that friction fades in over a speed, in a sentence; none where the fit did not find so."""
    gains = softness(robot, fit)
    if not gains:
        return []
    leads = [1e3 * effect.shape[1] for effect in fit.effects if effect.softens]
    ahead = f", and acts {_span(leads)} ms ahead of it" if max(leads) > AHEAD else ""
    less = min(100 * min(gains.values()), 99.0)
    return [
        f"friction of {', '.join(gains)} is simulated as one that fades in over a speed{ahead}, as simulators smooth "
        f"it (MuJoCo's default acts 9.5 ms ahead), not as one that holds a joint at rest: that takes {less:.2g} % or "
        "more off the squared error of motion that was not fitted, and moves other values, above all armature, viscous "
        "friction and delay. What else changes where a joint turns round, such as Stribeck friction or play, looks "
        "like it (elid diagnose)"
    ]
