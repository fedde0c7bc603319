"""Which of two effects that no log tells apart goes with the values in the robot file.

The torque gain of one joint of two is the inverse gain of the other, with all parameters scaled along. The log knows no
difference, but who wrote parameters into the robot file does: the twin whose parameters come much nearer to them is
named first. Both stay named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.steps import Found

SURE = 5.0
"""Standard errors that a base parameter must be away from 0 to be compared."""
NEARER = 0.5
"""Ratio of distances from the file's values below which a twin is named instead."""
FEWEST = 3
"""Base parameters that the file must give for it to have a say."""


def by_known_values(found: Found, declared: int) -> Found:
    """Return the outcome with effects exchanged for twins at other joints that go with the robot file's values.

    Parameters
    ----------
    found
        The outcome of a search.
    declared
        How many of the state's effects, the first ones, are not named.
    """
    state = found.after
    for number in range(declared, declared + len(found.steps)):
        effect = state.effects[number]
        own = distance(state)
        if own is None:
            return found
        for twin in type(effect).same_here(state.scene, effect.joint, state.named(number)):
            if twin.effect != effect.name or twin.joint == effect.joint:
                continue
            effects = list(state.effects)
            effects[number] = type(effect)(twin.joint, effect.shape)
            other = refreshed(fit(state.log, effects, state.scene))
            its = distance(other)
            if its is not None and its < NEARER * own:
                state, own = other, its
    return found if state is found.after else replace(found, after=state)


def distance(state: State) -> float | None:
    """Return the median relative distance of well-known base parameters from the file's values; None: too few given."""
    log = state.log
    given = log.base.values(log.model.robot.reference())
    estimate, deviation, determined = state.base_values(state.log.base)
    known = determined & np.isfinite(given) & (np.abs(estimate) > SURE * deviation)
    known &= np.abs(given) > 0
    if np.count_nonzero(known) < FEWEST:
        return None
    return float(np.median(np.abs(estimate[known] / given[known] - 1.0)))
