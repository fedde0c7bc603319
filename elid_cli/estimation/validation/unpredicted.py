"""A torque that a model does not predict at all is most likely not the joint's: swapped channels, a sign, a unit."""

from __future__ import annotations

from collections.abc import Mapping

from elid_cli.errors import in_words
from elid_cli.estimation.judgement import JointError

NOTHING = 0.9
"""Error over the torque from which a prediction is no better than none."""
NOISE = 2.0
"""Times what the sensors' noise leaves up to which the torque itself is noise."""


def unpredicted(error: Mapping[str, JointError]) -> tuple[str, ...]:
    """Return a sentence on the joints whose torque, on stretches that no fit saw, is predicted no better than by 0."""
    found = {
        name: item.relative
        for name, item in error.items()
        if item.relative > NOTHING and item.floor is not None and item.rms > NOISE * item.floor
    }
    if not found:
        return ()
    one = len(found) == 1
    sizes = in_words([f"{100 * size:.0f} %" for size in found.values()])
    return (
        f"the torque of {in_words(list(found))} is not predicted at all (error {sizes} of the torque): "
        f"{'it may be' if one else 'they may be'} of other joints (swapped channels), of a wrong sign, or of another "
        "time; check the mapping",
    )
