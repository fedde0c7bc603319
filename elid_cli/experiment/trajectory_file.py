"""A trajectory as CSV: what a controller plays, and what ``elid simulate --reference`` reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elid_cli.files import replacing

Array = NDArray[np.float64]


def write_trajectory(path: str | Path, joints: tuple[str, ...], t: Array, q: Array, dq: Array, ddq: Array) -> None:
    """Write columns ``t``, ``q.<joint>``, ``dq.<joint>``, ``ddq.<joint>``: s, rad (m) and its derivatives.

    Parameters
    ----------
    path
        CSV file, written whole or not at all.
    joints
        Names of the n joints.
    t, q, dq, ddq
        Times (N,) and states (N, n).

    Raises
    ------
    UsageError
        The file cannot be written.

    """
    head = ",".join(["t", *(f"{kind}.{joint}" for kind in ("q", "dq", "ddq") for joint in joints)])
    with replacing(path) as beside, beside.open("w", encoding="utf-8", newline="\n") as stream:
        np.savetxt(stream, np.column_stack([t, q, dq, ddq]), fmt="%.10g", delimiter=",", header=head, comments="")
