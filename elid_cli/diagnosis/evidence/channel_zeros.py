"""What the constants in the torque channels are worth, and what else they could be.

The zero of a torque channel is an unknown of every model here, as it is in identification: no effect has to be made up
for it. What it takes away is told all the same, and friction that differs between the two directions is the same
constant as long as a joint does not rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from elid_cli.diagnosis.evidence.held_out import held_out_share
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.estimation.data import sum_row
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

AS_WELL = 0.98
"""Part of what an offset takes from left-out stretches that a twin must take in its place, to be as possible."""


class Constant(NamedTuple):
    """A constant that is worth a name, and an effect that takes its place as well."""

    joint: int
    offset: Mapping[str, float]
    twin: type[Effect]
    values: Mapping[str, float]
    """The twin's parameters in its place."""
    gain: float
    """Part of the held-out residual variance that the constant takes away."""


def constants(state: State) -> Iterator[Constant]:
    """Yield the offsets that take away as much as an effect must, each with every twin that predicts as well."""
    kind = effect_that(nuisance="offset")
    present = {(effect.name, effect.joint) for effect in state.effects}
    acted = {sum_row(extra).joint: extra.rows for extra in state.nuisances if extra.name == kind.name}
    for joint, value in state.offsets.items():
        lacking = fit(state.log, state.effects, state.scene, but={joint})
        rows = touched(lacking, state, acted[joint])
        gain = held_out_share(lacking, state, rows)
        if gain < kind.least_gain:
            continue
        for name in twins_of(kind):
            twin = effect_classes()[name]
            if (name, joint) in present or not twin.applies(state.log.model.robot, joint):
                continue
            other = fit(state.log, (*state.effects, twin(joint)), state.scene, but={joint})
            without, by_offset, by_twin = (_left_out(s, state, rows) for s in (lacking, state, other))
            if without - by_twin >= AS_WELL * (without - by_offset):
                offset = {kind.amplitudes[0].name: value}
                yield Constant(joint, offset, twin, other.named(len(other.effects) - 1), gain)


def _left_out(state: State, unit: State, rows: Sequence[EstimationRow]) -> float:
    """Return the squared error of left-out folds in some rows, each in units of its residual in another state."""
    return sum(float(state.left_out[row].sum()) / max(unit.rms(row), 1e-300) ** 2 for row in rows)
