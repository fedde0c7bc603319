"""What an identification of logs that disagree says: which equations and parameters differ from log to log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import in_words
from elid_cli.estimation.judgement import Insufficient, Judgement
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.following import APART, FACTOR, LOGS, TURN, WEIGHT, ZERO
from elid_cli.estimation.validation.verdicts import DIFFERS
from elid_cli.model.regressor import Kind

ABSORBED = (APART, FACTOR, TURN, WEIGHT, ZERO)
"""What a scale, sign or zero looks like that the whole of a log has."""
FAR_APART = 2.0
"""Error of logs together over the sensors' noise, and over what each log's own fit leaves, from which they differ."""


def with_differing_logs(
    found: Identification, moved: NDArray[np.bool_], said: Sequence[Judgement | None], names: Sequence[str]
) -> Identification:
    """Return an identification of logs that disagree, insufficient where one model leaves far more than each log's own.

    Every log was judged by the residual of its own fit, which says nothing of what all have in common. A scale or a
    zero that is off in some of them only differs between them.

    Parameters
    ----------
    found
        The identification of all.
    moved
        Base parameters that differ from log to log, (b,).
    said, names
        What every log's own residual says, and what the logs are called.
    """
    some, notes = _of_some(said, names)
    rows = [
        replace(item, follows=LOGS) if item.joint in some and item.follows in ABSORBED else item
        for item in found.insufficient
    ]
    rows += _far_apart(found, {(item.joint, item.rows) for item in rows})
    parameters = [_marked(item) if apart else item for item, apart in zip(found.parameters, moved, strict=True)]
    return replace(
        found,
        insufficient=tuple(rows),
        model="insufficient" if rows else found.model,
        not_excluded=() if rows else found.not_excluded,
        parameters=tuple(parameters),
        notes=(*found.notes, *notes),
    )


def _of_some(said: Sequence[Judgement | None], names: Sequence[str]) -> tuple[set[str], list[str]]:
    """Return the joints at which some logs lack something alone and others nothing, and sentences of these logs."""
    judged = {name: {i.joint for i in one.insufficient} for name, one in zip(names, said, strict=True) if one}
    lacking = set().union(*judged.values())
    some = {joint for joint in lacking if any(joint not in joints for joints in judged.values())}
    notes = [
        f"{name} alone lacks something at {in_words(sorted(joints & some), 6)}, where not all other logs do: "
        "identify it by itself"
        for name, joints in judged.items()
        if joints & some
    ]
    return some, notes


def _far_apart(found: Identification, named: set[tuple[str, Kind]]) -> list[Insufficient]:
    """Return the equations, but those that are named, of which one model leaves far more than each log's own."""
    own = {(item.joint, item.rows): item.ratio for item in found.noise}
    more = []
    for name, error in found.error.items():
        whole, spring = (error.rms, error.floor), (error.spring_rms, error.spring_floor)
        rows: dict[Kind, tuple[float | None, float | None]] = {
            "sum": whole, "load": whole, "motor": spring, "spring": spring,
        }  # fmt: skip
        for kind, (rms, floor) in rows.items():
            ratio = rms / floor if rms and floor else 0.0
            known = (name, kind) in own and (name, kind) not in named
            if known and ratio > FAR_APART * max(1.0, own[name, kind]):
                more.append(Insufficient(name, kind, float(ratio), LOGS, 0.0))
    return more


def _marked(item: BaseEstimate) -> BaseEstimate:
    """Return a parameter that differs from log to log, with that as the reason of what is not known of it."""
    size = item.reason.partition(": ")[0]
    reason = item.reason if item.verdict == "supported" else f"{size}: {DIFFERS}"
    return replace(item, bias_possible=True, reason=reason)
