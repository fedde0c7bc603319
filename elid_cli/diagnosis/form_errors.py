"""Standard errors that reach to what other forms of the found effects, or their rivals, make of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.result import FoundEffect, OtherForm, Rival
from elid_cli.estimation.regression.other_shapes import REACH
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.verdicts import WEAK


def in_forms(effect: FoundEffect, forms: Sequence[OtherForm]) -> FoundEffect:
    """Return an effect with its other forms, its own 95 % intervals reaching to their values where these mean the same.

    They do not where a value has the other sign: friction that falls from standstill and friction that rises.
    """
    return replace(_reaching(effect, [form.parameters for form in forms]), forms=tuple(forms))


def beside_rivals(effect: FoundEffect, rivals: Sequence[Rival]) -> FoundEffect:
    """Return an effect whose 95 % intervals reach to its values with the rivals of other effects in their place."""
    own = (effect.effect, effect.joint)
    return _reaching(effect, [e.parameters for r in rivals for e in r.beside if (e.effect, e.joint) == own])


def _reaching(effect: FoundEffect, others: Sequence[Mapping[str, float]]) -> FoundEffect:
    wider = dict(effect.std_error)
    for values in others:
        if all(_alike(effect.parameters, values, name) for name in values):
            for name, error in wider.items():
                apart = values.get(name, effect.parameters[name]) - effect.parameters[name]
                wider[name] = float(np.hypot(error, apart / REACH))
    return replace(effect, std_error=wider)


def _alike(one: Mapping[str, float], other: Mapping[str, float], name: str) -> bool:
    return name in one and one[name] * other[name] >= 0


def reaching_forms(
    found: Identification, effects: Sequence[FoundEffect], rivals: Sequence[Rival] = ()
) -> Identification:
    """Return an identification whose 95 % intervals reach to the parameters with other forms of its effects and rivals.

    Parameters that are then known to 30 % no more are weakly known.
    """
    wider = np.zeros_like(found.covariance)
    why: dict[int, str] = {}
    others = [(form.change, form.moved, f"{e.effect} in another form") for e in effects for form in e.forms]
    for rival in rivals:
        if rival.change is not None:
            others.append((rival.change, rival.moved, f"{rival.effect} of {rival.joint or found.robot.name}"))
        if rival.further is not None:
            wider += np.diag(np.nan_to_num(rival.further) ** 2)
    for change, moved, what in others:
        wider += np.outer(change, change) / REACH**2
        names = dict(moved)
        for k, item in enumerate(found.parameters):
            if item.name in names:
                why.setdefault(k, f"{what} would make it {names[item.name]:.3g}")
    if not wider.any():
        return found
    records = []
    for k, item in enumerate(found.parameters):
        spread = float(np.hypot(item.std_error, np.sqrt(wider[k, k])))
        lost = item.verdict == "supported" and item.std_error <= WEAK * abs(item.estimate) < spread and k in why
        item = replace(item, std_error=spread)
        records.append(replace(item, verdict="weak", reason=why[k]) if lost else item)
    return replace(found, parameters=tuple(records), covariance=found.covariance + wider)
