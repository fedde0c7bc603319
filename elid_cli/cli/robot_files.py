"""--write-robot: what was found, in the files asked for; nothing that a format cannot hold is left out in silence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from elid_cli.cli.output import note
from elid_cli.errors import ElidError, UsageError
from elid_cli.experiment.robot_file import (
    WRITTEN,
    beyond_format,
    foreign,
    named,
    other_limits,
    stays_aside,
    without_springs,
    write_described,
)
from elid_cli.files import check_target, write_text

if TYPE_CHECKING:
    from elid_cli.cli.options import Files, Output
    from elid_cli.estimation.judgement import JointError
    from elid_cli.estimation.mean_friction import MeanFriction
    from elid_cli.estimation.result import Identification
    from elid_cli.robot.robot import EffectSpec, Robot
    from elid_cli.signals.signals import Signals


def check_described(files: Files) -> None:
    """Refuse, before any work is done, files that no robot, or no actuators, can be written to (UsageError)."""
    if files.drop_effects and not files.write_robot:
        raise UsageError("--drop-effects: no robot file is written", hint="give --write-robot as well")
    if files.write_actuators is not None:
        check_target(files.write_actuators, (".json", ".yaml", ".yml"), "actuators")
    for path in files.write_robot:
        check_target(path, WRITTEN, "a robot file")


class Written(NamedTuple):
    """The robot files that were written, and why others were not: to be raised once the report is out."""

    files: tuple[str, ...]
    refusal: ElidError | None

    @property
    def own(self) -> str | None:
        """The first file in elid's own form, which holds effects."""
        return next((path for path in self.files if not foreign(path)), None)


def write_found(
    files: Files,
    refined: Robot,
    remarks: Sequence[str],
    found: Identification,
    error: Mapping[str, JointError],
    again: Callable[[Robot, bool], Identification],
    output: Output,
    log: Callable[[], Signals | None],
) -> Written:
    """Write an identified robot to files, and say on stderr what they hold that was not found, or do not hold.

    A file is refused where its format cannot hold an effect that was found, the file of actuators does not hold it
    beside, and dropping it was not asked for.

    Parameters
    ----------
    files
        Robot files: ``.urdf``, ``.xml`` and ``.mjcf`` are patched where the robot came from such a file; else elid's
        YAML, or a new file of that format. The file of actuators.
    refined, remarks
        The robot with what was found, and sentences about it for the file's comments.
    found, error
        What corrections of the measurement it holds, and its held-out errors.
    again
        Identifies again, for a robot without effects (``--drop-effects``); with a delay of the drives or without.
    output
        Whether notes are wanted.
    log
        Returns the log's signals: what of a friction a file without it holds is its mean along them.
    """
    from dataclasses import replace

    from elid_cli.estimation.mean_friction import with_mean_friction
    from elid_cli.estimation.refined_robot import impossible_words

    note([said for said in impossible_words(found) if said in remarks], output, "warning")
    refined = _with_given_gains(refined)
    told, told_of = found, refined
    means: tuple[MeanFriction, ...] = ()
    nuisances = {(item.effect, item.joint) for item in found.nuisances}
    written: list[str] = []
    refusals: list[ElidError] = []
    for path in files.write_robot:
        beyond = beyond_format(refined, path)
        late = foreign(path) and _late(found) and files.write_actuators is None
        lost = [spec for spec in beyond if (spec.effect, spec.joint) not in nuisances and not _beside(spec, files)]
        held = [s for s in beyond if s not in lost]
        said = [*without_springs(refined, path), *stays_aside(refined, path), *_elsewhere(held, files)]
        note([f"{path}: {sentence}" for sentence in said], output, "left out")
        in_file = [f"left out: {sentence}" for sentence in said]
        try:
            if not lost and not late:
                own = _means(refined, held, log)
                write_described(with_mean_friction(refined, own), path, [*remarks, *in_file, *_mean_words(own)])
            elif lost and not files.drop_effects:
                raise _refused(path, lost)
            else:
                told, told_of, cost = _without(
                    refined, lost, error, lambda robot: again(robot, files.write_actuators is not None),
                    "the delay of the drives" if late else "",
                )  # fmt: skip
                channel = _nuisances()
                own = _means(told_of, [s for s in beyond_format(told_of, path) if _beside(s, files)], log)
                plain = replace(told_of, effects=tuple(s for s in told_of.effects if s.effect not in channel))
                note([f"{path}: {sentence}" for sentence in cost], output, "left out")
                words = [*remarks[:1], f"left out: {cost[0]}", *cost[1:], *in_file, *_mean_words(own)]
                write_described(with_mean_friction(plain, own), path, words)
        except ElidError as refusal:
            refusals.append(refusal)
        else:
            written.append(path)
            means = own if foreign(path) else means
            note([f"{path}: {sentence}" for sentence in _mean_words(own)], output)
            note([f"{path}: {sentence}" for sentence in other_limits(refined, path)], output, "left out")
    if files.write_actuators is not None:  # of the fit whose values the robot file holds
        _write_actuators(told, told_of, files.write_actuators, means)
    return Written(tuple(written), refusals[0] if refusals else None)


def _with_given_gains(robot: Robot) -> Robot:
    """Return a robot with the drives' gains of the command line: its logs lack them, and replays of them need them."""
    from dataclasses import replace

    given = {gain: click.get_current_context().params.get(gain) for gain in ("kp", "kd")}
    control = dict(robot.control)
    for gain, values in given.items():
        if values is not None:
            each = values if isinstance(values, list) else [values] * robot.n
            control[gain] = dict(zip(robot.joint_names, each, strict=True))
    return replace(robot, control=control)


def _means(robot: Robot, beside: Sequence[EffectSpec], log: Callable[[], Signals | None]) -> tuple[MeanFriction, ...]:
    """Return the mean frictions of effects of a robot that the file of actuators holds beside a robot file."""
    from elid_cli.estimation.mean_friction import mean_friction, varies_with_angle

    specs = [spec for spec in beside if varies_with_angle(robot, spec)]
    signals = log() if specs else None
    return () if signals is None else mean_friction(robot, signals, specs)


def _mean_words(means: Sequence[MeanFriction]) -> list[str]:
    """Return in words what a robot file holds of effects that are beside it."""
    each = [f"{item.mean:.3g} ({named([item.effect])})" for item in means]
    return [f"the dry friction of this file holds means along the log: {', '.join(each)}"] if each else []


def _write_actuators(found: Identification, refined: Robot, path: str, means: Sequence[MeanFriction]) -> None:
    from elid_cli.estimation.actuator_text import actuator_text
    from elid_cli.estimation.actuators import actuators_of

    actuators = actuators_of(found, refined, means)
    write_text(path, actuator_text(actuators, yaml=Path(path).suffix.lower() in (".yaml", ".yml")))


def _beside(spec: EffectSpec, files: Files) -> bool:
    """Whether the file of actuators holds an effect in a form that a simulator can apply."""
    from elid_cli.model.effects import effect_classes

    kind = effect_classes()[spec.effect]
    return files.write_actuators is not None and bool(kind.acts_as or kind.nuisance == "delay")


def _elsewhere(held: Sequence[EffectSpec], files: Files) -> list[str]:
    """Return in words where effects are that a robot file does without: in the file of actuators, or nowhere."""
    if not held:
        return []
    counts = {spec.effect: sum(other.effect == spec.effect for other in held) for spec in held}
    words = [f"{count} × {name}" if count > 1 else named([s for s in held if s.effect == name])
             for name, count in counts.items()]  # fmt: skip
    where = files.write_actuators
    told = f"{Path(where).name} holds it" if where is not None else "--write-actuators FILE.json holds it"
    return [f"{', '.join(words)}: {told if len(held) == 1 else told.replace('holds it', 'holds them')}"]


def _refused(path: str, lost: Sequence[EffectSpec]) -> UsageError:
    beside = Path(path).with_suffix(".json").name
    return UsageError(
        f"{path}: this format cannot hold {named(lost)}",
        detail="parameters that were found beside an effect are wrong without it",
        hint=f"{Path(path).with_suffix('.yaml')} holds all; --write-actuators {beside} holds friction beside it; "
        "--drop-effects writes the fit without",
    )


def _without(
    refined: Robot,
    lost: Sequence[EffectSpec],
    error: Mapping[str, JointError],
    again: Callable[[Robot], Identification],
    late: str,
) -> tuple[Identification, Robot, list[str]]:
    """Return the fit without some effects, its robot, and what that costs in words."""
    from dataclasses import replace

    from elid_cli.estimation.refined_robot import identified_robot

    channel = _nuisances()
    kept = tuple(spec for spec in refined.effects if spec not in lost and spec.effect not in channel)
    answer = again(replace(refined, effects=kept))
    worse = [
        f"{joint} {now.rms:.3g} in place of {before.rms:.3g}"
        for joint, now in answer.error.items()
        if (before := error.get(joint)) is not None and now.rms is not None and before.rms is not None
    ]
    said = [
        f"{', '.join(word for word in (named(lost), late) if word)}; the parameters are those of a fit without",
        f"the held-out error of the torque becomes {', '.join(worse)} (N·m or N)",
    ]
    return answer, identified_robot(answer), said


def _late(found: Identification) -> bool:
    """Whether parameters are those beside a delay between commands and motion, without which they are others."""
    from elid_cli.model.effects import nuisance_of

    return found.estimator == "trajectory" and any(nuisance_of(item.effect) == "delay" for item in found.nuisances)


def _nuisances() -> set[str]:
    """Return the names of the effects that are faults of a channel."""
    from elid_cli.model.effects import effect_classes

    return {name for name, kind in effect_classes().items() if kind.nuisance is not None}
