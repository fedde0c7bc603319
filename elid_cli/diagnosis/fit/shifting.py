"""Channels that are late: by how much a fit would move them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elid_cli.model.effects.shifts import LONGEST, Shifts

if TYPE_CHECKING:
    from elid_cli.diagnosis.fit.state import State

LATE = 0.01
"""Phase, rad at the cut-off, up to which what is left of a torque's delay is left to its column."""


def found_shifts(state: State) -> tuple[Shifts, float]:
    """Return the shifts that a state amounts to, and the largest change from those already corrected, s."""
    shifts, change = state.log.shifts, 0.0
    for k, effect in enumerate(state.effects):
        if effect.corrects is None:
            continue
        present = state.log.shifts.of(effect.corrects, effect.joint)
        value = state.named(k)[effect.amplitudes[0].name]
        if not np.isfinite(value) or abs(value) > LONGEST:
            value = present
        shifts = shifts.moved(effect.corrects, effect.joint, value)
        change = max(change, abs(value - present))
    late = {joint: delay for joint, delay in state.delays.items() if abs(delay) <= LONGEST}
    left = max((abs(delay - float(state.log.shifts.torque[joint])) for joint, delay in late.items()), default=0.0)
    # less than a sample, or what is left of more, is a matter of first order
    far = bool(np.any(state.log.shifts.torque)) or max(map(abs, late.values()), default=0.0) > state.log.signals.dt
    if far and left * 2 * np.pi * state.log.signals.filter.cutoff > LATE:
        for joint, delay in late.items():
            shifts = shifts.moved("torque", joint, delay)
        change = max(change, left)
    return shifts, change
