"""Logs of one machine of which only some hold the link positions: two models, which share no regressor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import UsageError


def refuse_mixed(names: Sequence[str], unlinked: NDArray[np.bool_], joints: Sequence[str]) -> None:
    """Refuse logs of which some lack the link position of an elastic joint and others do not.

    Parameters
    ----------
    names
        The logs'.
    unlinked
        Elastic joints without a link position, (logs, n).
    joints
        Names of the joints, n.

    Raises
    ------
    UsageError
        Naming the joint, and a log of either kind.
    """
    for joint in np.flatnonzero(unlinked.any(axis=0) & ~unlinked.all(axis=0))[:1]:
        less, more = names[int(np.argmax(unlinked[:, joint]))], names[int(np.argmin(unlinked[:, joint]))]
        raise UsageError(
            f"{less}: no link position of {joints[joint]}, which {more} has",
            detail="without it a transmission counts as rigid, which is another model",
            hint="identify logs with link positions, and those without, apart",
        )
