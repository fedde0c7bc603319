"""What a search is blind to and identification sees: a residual that follows the motion below a lower cut-off.

Noise of coarse encoders grows with frequency far faster than the torques that motion needs. At the cut-off that most
effects need it may hide what moves the residual slowly, and "nothing but noise" is then true of that cut-off alone.
Where the model with what was found does not suffice at identification's cut-off, effects are looked for there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from elid_cli.diagnosis.result import Diagnosis, Unexplained
from elid_cli.errors import DataError
from elid_cli.signals.signals import Signals


def looked_closer(told: Diagnosis, signals: Signals, again: Callable[[Signals], Diagnosis]) -> Diagnosis:
    """Return a diagnosis that agrees with what identification says of its model.

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
    if told.partial or told.unexplained or signals.recording is None or not told.identified_after.insufficient:
        return told
    cutoff = told.identified_cutoff
    if not cutoff < own:
        return _doubted(told)
    try:
        other = again(replace(signals.refiltered(cutoff), cutoff_free=False))
    except DataError:  # too few instants at that cut-off
        return _doubted(told)
    if not other.partial and not _named(told) <= _named(other):
        return _doubted(told)
    return replace(_doubted(other), searched_at=(own, cutoff))


def _named(told: Diagnosis) -> set[tuple[str, str | None]]:
    return {(effect.effect, effect.joint) for effect in told.effects}


def _doubted(told: Diagnosis) -> Diagnosis:
    """Return a diagnosis that calls unexplained what identification, with what was found, sees beyond noise."""
    known = {item.joint for item in told.unexplained}
    found = [
        Unexplained(item.joint, item.rows, item.follows, item.share, error.rms, item.ratio, ())
        for item in ([] if told.partial else told.identified_after.insufficient)
        if item.joint not in known and (error := told.identified_after.published.get(item.joint)) is not None
    ]
    return replace(told, unexplained=(*told.unexplained, *found), sufficient=told.sufficient and not found)
