"""Standard errors that reach to what other forms of the found effects make of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.result import FoundEffect
from elid_cli.estimation.regression.other_shapes import REACH
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.verdicts import WEAK


def reaching_forms(found: Identification, effects: Sequence[FoundEffect]) -> Identification:
    """Return an identification whose intervals of 95 % reach to the parameters with each other form of its effects.

    Parameters that are then known to 30 % no more are weakly known.
    """
    wider = np.zeros_like(found.covariance)
    why: dict[int, str] = {}
    for effect in effects:
        for form in effect.forms:
            wider += np.outer(form.change, form.change) / REACH**2
            names = dict(form.moved)
            for k, item in enumerate(found.parameters):
                if item.name in names:
                    why.setdefault(k, f"{effect.effect} in another form would make it {names[item.name]:.3g}")
    if not why:
        return found
    records = []
    for k, item in enumerate(found.parameters):
        spread = float(np.hypot(item.std_error, np.sqrt(wider[k, k])))
        lost = item.verdict == "supported" and item.std_error <= WEAK * abs(item.estimate) < spread and k in why
        item = replace(item, std_error=spread)
        records.append(replace(item, verdict="weak", reason=why[k]) if lost else item)
    return replace(found, parameters=tuple(records), covariance=found.covariance + wider)
