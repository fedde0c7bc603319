"""What a search is blind to and a lower cut-off shows.

Noise of coarse encoders grows with frequency far faster than the torques that motion needs. At the cut-off that most
effects need it may hide what moves the residual slowly, and "nothing but noise" is then true of that cut-off alone.
Before it is said, effects are looked for at the cut-off that identification starts from, too, and at the one that it
chose where its residual follows the motion there. Where it does not, what is named must let it predict better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from elid_cli.diagnosis.result import Diagnosis, Unexplained
from elid_cli.errors import DataError
from elid_cli.signals.signals import DEFAULT_CUTOFF, Signals

LEAST = 100
"""Instants at a cut-off without which effects are not looked for there."""
BETTER = 0.95
"""Part of its error on left-out stretches to which identification must come down. On four logs of a simulated gantry
that show no effect, what was named at the lower cut-off left 0.988 and more; what was right, on others, 0.89."""


def looked_closer(told: Diagnosis, signals: Signals, again: Callable[[Signals], Diagnosis]) -> Diagnosis:
    """Return a diagnosis that looked at lower cut-offs as well, and says what identification sees with its model.

    Parameters
    ----------
    told
        What a search found.
    signals
        The log as that search took it.
    again
        Returns what a search finds in the log at another cut-off.
    """
    own = signals.filter.cutoff
    told = replace(told, searched_at=(own,))
    if told.partial or told.unexplained or signals.recording is None:
        return told
    usual = DEFAULT_CUTOFF if told.usual is None else told.usual.filter.cutoff
    searched = [own]
    for cutoff in (usual, told.identified_cutoff):
        doubted = bool(told.identified_after.insufficient)
        if told.unexplained or told.partial or not (doubted or (cutoff == usual and not told.effects)):
            break
        if not cutoff < searched[-1]:
            continue
        lower = replace(signals.refiltered(cutoff), cutoff_free=False)
        if len(lower.outputs) < LEAST:
            break
        try:
            other = again(lower)
        except DataError:  # it excites no parameter below that cut-off
            break
        searched.append(cutoff)
        told = told_anew(told, searched_at=tuple(searched))
        more = other.partial or (bool(other.effects or other.unexplained) if doubted else _borne_out(other))
        if more and (other.partial or names_of(told) <= names_of(other)):
            told = replace(other, searched_at=tuple(searched))
    return told if told.partial else _doubted(told)


def told_anew(told: Diagnosis, **changes: Any) -> Diagnosis:
    """Return a diagnosis with something else said of the same models; what was computed of these is kept."""
    other = replace(told, **changes)
    vars(other).update({name: value for name, value in vars(told).items() if name not in vars(other)})
    return other


def _borne_out(told: Diagnosis) -> bool:
    """Whether what was found lets identification predict some joint's torque clearly better, and none worse.

    What base parameters had taken up need not: its size tells it.
    """
    if not told.effects or told.predicted_worse:
        return False
    if any(effect.absorbed for effect in told.effects):
        return True
    before, after = told.left_out
    return any(after[name].rms < BETTER * error.rms for name, error in before.items() if name in after)


def names_of(told: Diagnosis) -> set[tuple[str, str | None]]:
    """Return the effects that are named, with their joints."""
    return {(effect.effect, effect.joint) for effect in told.effects}


def _doubted(told: Diagnosis) -> Diagnosis:
    """Return a diagnosis that calls unexplained what identification, with what was found, sees beyond noise."""
    after, known = told.identified_after, {item.joint for item in told.unexplained}
    floors = {(item.joint, item.rows): item.floor for item in after.noise}
    found = [
        Unexplained(item.joint, item.rows, item.follows, item.share, floors[item.joint, item.rows] * item.ratio,
                    item.ratio, (), by_identify=True)
        for item in after.insufficient
        if item.joint not in known and (item.joint, item.rows) in floors
    ]  # fmt: skip
    return told_anew(told, unexplained=(*told.unexplained, *found), sufficient=False) if found else told
