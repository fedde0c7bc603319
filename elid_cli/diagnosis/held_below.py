"""Effects whose form holds at low frequencies alone: looked for where they hold, when a search leaves something.

The link of a joint that yields follows its motor up to the antiresonance. A search above that frequency finds no effect
that explains what is left, or one that takes some of it; below, the deflection under load explains it down to noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from elid_cli.diagnosis.fit.quieter_log import QUIET
from elid_cli.diagnosis.lower_cutoff import LEAST, told_anew
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.errors import DataError
from elid_cli.estimation.cutoff import at_best_cutoff
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.slow_effects import declares_slow
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects import effect_classes
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals

FACTORS = (0.8, 0.5, 0.3, 0.2)
"""Cut-offs that are tried, parts of identification's own."""


def held_below(
    told: Diagnosis, signals: Signals, again: Callable[[Signals, tuple[str, ...]], Diagnosis], only: tuple[str, ...]
) -> Diagnosis:
    """Return a diagnosis that names effects whose form holds below a lower cut-off, where they leave noise alone there.

    Parameters
    ----------
    told
        What a search found at the log's cut-off.
    signals
        The log as that search took it.
    again
        Returns what a search finds in the log at another cut-off, of these effects alone; of all where none is given.
    only
        Effects that may be named; empty: all.
    """
    kinds = tuple(
        name
        for name, kind in effect_classes().items()
        if kind.quasi_static
        and (not only or name in only)
        and any(kind.applies(told.robot, joint) for joint in range(told.robot.n))
    )
    named = any(effect.effect in kinds for effect in told.effects)
    if told.partial or signals.recording is None or not kinds or named or not _doubted(told):
        return told
    searched = list(told.searched_at)
    for factor in FACTORS:
        cutoff = factor * min(signals.filter.cutoff, told.identified_cutoff)
        lower = replace(signals.refiltered(cutoff), cutoff_free=False)
        if len(lower.outputs) < LEAST:
            break
        try:
            other = again(lower, kinds)
            if not other.partial and other.effects and not other.unexplained:
                other = again(lower, ())
        except DataError:  # it excites no parameter below that cut-off
            break
        if other.partial:
            return told_anew(told, partial=True)
        searched.append(cutoff)
        if not other.unexplained and any(effect.effect in kinds for effect in other.effects):
            return replace(other, searched_at=tuple(searched))
    return told


def where_declared_hold(robot: Robot, signals: Signals) -> Signals:
    """Return a log below the usual cut-off where the robot declares effects whose form does not hold up to it."""
    usual = SignalOptions.for_diagnosis(1.0 / signals.dt).cutoff
    if not declares_slow(robot) or signals.recording is None or signals.filter.cutoff != usual:
        return signals
    model = Regressor(robot)
    below, _ = at_best_cutoff(model, find_base(model), replace(signals, cutoff_free=True), EstimateOptions())
    return replace(signals.refiltered(below.filter.cutoff), cutoff_free=False)


def _doubted(told: Diagnosis) -> bool:
    """Whether something is left, or the noise is far too large to tell: a drive that chatters."""
    return bool(told.unexplained) or any(
        noise.ratio < QUIET for noise in told.identified_after.noise if noise.ratio is not None
    )
