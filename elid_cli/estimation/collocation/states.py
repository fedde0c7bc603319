"""Where the states of a joint stand among the inputs of a traced program, and which of them can be moved at once."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.model.program import Program
from elid_cli.model.regressor import INPUTS

Moved = tuple[int, int, NDArray[np.intp]]
"""Channel, derivative, and the outputs that depend on it."""

_STANDS_IN = {
    ("q", 0): (0, 1, 2, 8), ("q", 1): (3,), ("q", 2): (4,),
    ("theta", 0): (8,), ("theta", 1): (5, 7), ("theta", 2): (6,),
}  # fmt: skip
"""Inputs of a joint (`model.inputs_of`) that a state's derivatives stand in."""


def slots_of(side: str, joint: int, derivative: int, *, elastic: bool) -> list[int]:
    """Return the inputs that a derivative of a link's (q) or motor's (theta) position stands in.

    The link of a rigid joint moves its motor along.
    """
    sides = (side,) if elastic else ("q", "theta")
    return [INPUTS * joint + slot for one in sides for slot in _STANDS_IN[one, derivative]]


def moved_together(program: Program, slots: Sequence[Sequence[Collection[int]]]) -> list[list[Moved]]:
    """Return channels and derivatives in groups of which no output depends on two (Curtis, Powell and Reid 1974).

    Parameters
    ----------
    program
        Outputs that may depend on a few inputs each.
    slots
        Per channel and derivative: the inputs that it stands in. What no output depends on is left out.
    """
    groups: list[tuple[set[int], list[Moved]]] = []
    for c, derivatives in enumerate(slots):
        for d, asked in enumerate(derivatives):
            mask = sum(1 << slot for slot in asked)
            touched = [output for output, read in enumerate(program.reads) if read & mask]
            if not touched:
                continue
            item = (c, d, np.array(touched, dtype=np.intp))
            for outputs, members in groups:
                if outputs.isdisjoint(touched):
                    outputs.update(touched)
                    members.append(item)
                    break
            else:
                groups.append((set(touched), [item]))
    return [members for _, members in groups]
