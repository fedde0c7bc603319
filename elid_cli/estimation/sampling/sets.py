"""Parameter sets: drawn base parameters, or whole robots that have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_list, whole
from elid_cli.errors import UsageError, first_of
from elid_cli.estimation.sampling.draw import draw_sets
from elid_cli.estimation.sampling.pool import Distribution, Origin, pooled
from elid_cli.estimation.sampling.saved import SavedDistribution, as_distribution
from elid_cli.estimation.sampling.whole import as_identified, other_combinations, whole_sets
from elid_cli.model.effects import effect_that
from elid_cli.robot.robot import Robot
from elid_cli.robot.urdf.write import with_parameters
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.tables import Shown

LOW, HIGH = 2.5, 97.5
"""Percentiles that ranges reach from and to."""
ROUNDING = 1e-12
"""Relative difference of values that are the same."""
FRICTION = ("fs", "fv")
IN_THE_ROBOT = {effect_that(carried=True).name, effect_that(of_drive="limit").name}
"""Effects that are written into bodies and limits of a robot file, which declares none of them."""
SAME_FILE = 1e-9
"""Relative difference of values that one file holds."""
LISTED = 8
"""Parameters that a note names."""


@dataclass(frozen=True, repr=False)
class ParameterSets(Shown):
    """Sets of parameters, in SI units."""

    distribution: Distribution
    names: tuple[str, ...]
    """Of the parameters, (p,): base parameters, or a robot's standard ones."""
    units: tuple[str, ...]
    origin: tuple[Origin, ...]
    values: Array
    """(N, p), in `units` (SI); NaN where nobody knows."""
    seed: int
    notes: tuple[str, ...]
    """What was held or limited, and why."""
    robot: Robot | None = None
    """The robot whose parameters these are."""

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Between which the middle 95 % of the sets are, (p,) each."""
        low, high = np.percentile(self.values, [LOW, HIGH], axis=0)
        return low, high

    @cached_property
    def spread(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the sets, (p,) each; 0 where they differ by rounding."""
        mean, low, high = self.values.mean(axis=0), self.values.min(axis=0), self.values.max(axis=0)
        same = high - low <= ROUNDING * np.maximum(np.abs(low), np.abs(high))
        return np.where(same, low, mean), np.where(same, 0.0, self.values.std(axis=0))

    def robots(self) -> tuple[Robot, ...]:
        """Return a robot of every set; none without a robot."""
        return () if self.robot is None else tuple(with_parameters(self.robot, row) for row in self.values)


def sample(
    results: Sequence[SavedDistribution | Shown | str | Path], count: int, robot: Robot | None = None, seed: int = 0
) -> ParameterSets:
    """Draw parameter sets from the joint distribution that results of one robot tell.

    Parameters
    ----------
    results
        Of one robot; the spread between several counts. Files saved with ``--json``, or what `identify` returns.
    count
        Number of sets.
    robot
        Whole sets of this robot's parameters are wanted, nearest to its values; None: base parameters.
    seed
        The same seed gives the same sets.

    Raises
    ------
    UsageError
        No set is asked for, results of unlike robots, or a robot that lacks their joints or parameters, or the effects
        that a diagnosis found; an argument of another kind.
    """
    check_list("sample: results", results, "results")
    if isinstance(count, Integral) and count < 1:
        raise UsageError(f"{count} parameter sets are none", hint="draw 1 or more")
    whole(1)("sample: count", count)
    whole(0)("sample: seed", seed)
    if robot is not None:
        check_robot(robot)
    if not results:
        raise UsageError("sample: no result is given", hint="one or more of one robot: sample([found], 100)")
    told = [as_distribution(result, number) for number, result in enumerate(results, start=1)]
    found = pooled(told)
    generator = np.random.default_rng(seed)
    values = draw_sets(found.mean, found.covariance, found.positive, count, generator)
    notes = [*_model_words(told), *_held_words(found), *_channel_words(told), *_loop_words(told)]
    if robot is None:
        return ParameterSets(found, found.names, found.units, found.origin, values, seed, tuple(notes))
    _check_complete(told, robot)
    robot, base, rows = as_identified(robot, found)
    if other_combinations(robot, base):
        notes.append(
            f"the base parameters are not those of {robot.name}: its geometry or gears differ from those of the results"
        )
    held = all(result.bodies_held for result in told)
    drawn, origin, said = whole_sets(robot, base, found, rows, values, generator, held=held)
    return ParameterSets(
        found, tuple(base.parameters), robot.parameter_units(), origin, drawn, seed, (*notes, *said), robot
    )


def _check_complete(results: Sequence[SavedDistribution], robot: Robot) -> None:
    """Refuse a robot without what a diagnosis found (UsageError): no set of it moves as measured."""
    declared = {(spec.effect, spec.joint) for spec in robot.effects}
    for result in results:
        same = _has_friction_of(robot, result)
        lacking = [one for one in result.lacking if one not in declared and (same or one[0] not in IN_THE_ROBOT)]
        if lacking:
            names = [effect if joint is None else f"{effect} of {joint}" for effect, joint in lacking]
            raise UsageError(
                f"{robot.name}: lacks what {result.file} found: {first_of(names, LISTED)}",
                detail="the values that were found belong to it",
                hint="give the robot that elid diagnose --write-robot FILE.yaml writes",
            )


def _has_friction_of(robot: Robot, result: SavedDistribution) -> bool:
    """Whether a robot has the friction of the file that a result was made with: its bodies and limits are as before."""
    own = {str(name): value for name, value in zip(robot.parameter_names(), robot.reference().tolist(), strict=True)
           if name.kind in FRICTION}  # fmt: skip
    pairs = [(own[next(iter(terms))], value) for terms, value in zip(result.terms, result.reference, strict=True)
             if len(terms) == 1 and next(iter(terms)) in own]  # fmt: skip
    return all(np.isclose(*pair, rtol=SAME_FILE, atol=0.0, equal_nan=True) for pair in pairs)


def _channel_words(results: Sequence[SavedDistribution]) -> list[str]:
    """Return that the drives' offsets and delays are not drawn, where there are any."""
    kinds: dict[str, set[str]] = {}
    for channel in dict.fromkeys(name for result in results for name in result.channels):
        kind, _, joint = channel.partition(" ")
        kinds.setdefault(kind, set()).add(joint)
    if not kinds:
        return []
    listed = ", ".join(f"{kind} of {len(joints)} joint{'s' * (len(joints) > 1)}" for kind, joints in kinds.items())
    return [f"not drawn, as they belong to the drives and not to the robot: {listed}; a simulation needs them as "
            "well (elid identify --write-actuators)"]  # fmt: skip


def _loop_words(results: Sequence[SavedDistribution]) -> list[str]:
    """Return that a drive's loop, which the motion leaves open, is not drawn; none where no result says so."""
    period = max(result.loop for result in results)
    if not period:
        return []
    return [
        f"not drawn: a drive's loop that holds its torque for up to {1e3 * period:.2g} ms, with which viscous friction "
        "is larger by kp, motor inertia by kd times half its period. The sets are of drives that act all the time "
        "(held_loop in the robot file of identify tells the period)"
    ]


def _model_words(results: Sequence[SavedDistribution]) -> list[str]:
    """Return whose model lacks something, or may: the sets reach as far as its errors, which do not know of it."""
    words = []
    for names, what in (([r.file for r in results if r.model == "insufficient"], "is insufficient"),
                        ([r.file for r in results if r.unclear], "may be insufficient")):  # fmt: skip
        if names:
            words.append(f"the model of {first_of(names, LISTED)} {what}: true values may lie outside the sets' range")
    return words


def _held_words(found: Distribution) -> list[str]:
    """Return which base parameters are not drawn, in words."""
    words = []
    for origin, what in (("held", "held at the robot file's value"), ("unknown", "not known, and left out")):
        names = [name for name, own in zip(found.names, found.origin, strict=True) if own == origin]
        if names:
            words.append(f"not shown by any result, {what}: {first_of(names, LISTED)}")
    return words
