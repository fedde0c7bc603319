"""How to make signals from a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from elid_cli.checks import check_fields, flag, number, optional, whole, word

RATE_PER_CUTOFF = 5.0
"""Samples kept per second for every Hz of cut-off."""
DIAGNOSIS_CUTOFF = 25.0
"""Hz; higher than what parameters need, since ripple, vibration and reversals live above them."""


_RULES = {
    "cutoff": optional(number(above=0, endless=True)),
    "rate": optional(number(above=0, endless=True)),
    "min_velocity": optional(number(least=0)),
    "slow_motion": flag,
    "knots": optional(number(above=0)),
    "measured_velocity": flag,
    "smoothing": word("spline", "butterworth"),
    "butterworth": number(above=0),
    "order": whole(1),
    "commands": optional(word("held", "smooth")),
}
"""Of the fields of `SignalOptions`; an infinite cut-off is no filter, an infinite rate no decimation."""


@dataclass(frozen=True)
class SignalOptions:
    """How to make signals from a recording; None: chosen from the data."""

    cutoff: float | None = None
    """Cut-off of the parallel low-pass filter, Hz."""
    rate: float | None = None
    """Rate after decimation, Hz."""
    min_velocity: float | None = None
    """Speed below which a motor counts as reversing or stuck, rad/s (m/s)."""
    slow_motion: bool = False
    """Keep slow motion, in which friction shows most: what a diagnosis needs more than an estimate."""
    knots: float | None = None
    """Knot spacing of the splines, s."""
    measured_velocity: bool = True
    """Use measured velocities where they agree with the positions."""
    smoothing: Literal["spline", "butterworth"] = "spline"
    """`butterworth` is the classical way: zero-phase Butterworth filter and central differences."""
    butterworth: float = 20.0
    """Cut-off of the Butterworth filter on positions, Hz."""
    order: int = 4
    """Order of the Butterworth filter."""
    commands: Literal["held", "smooth"] | None = None
    """Whether commands are held for their sample, or change smoothly from one to the next; None: the log stays open
    there, and `identify` and `diagnose` decide by the motion."""

    def __post_init__(self) -> None:
        """Refuse words that say nothing, and values that no filter can have (UsageError)."""
        check_fields(self, _RULES)

    def of_log(self, rate: float) -> SignalOptions:
        """Return the options for a log of `rate` samples per second: a rate that told just that is no other wish."""
        return replace(self, rate=None) if self.rate == rate else self

    @classmethod
    def for_diagnosis(cls, rate: float) -> SignalOptions:
        """Return what a diagnosis needs of a log of `rate` samples per second: sharp, with its slow motion kept.

        Raises
        ------
        UsageError
            `rate` is no positive number.
        """
        number(above=0)("SignalOptions.for_diagnosis: rate", rate)
        return cls(cutoff=min(DIAGNOSIS_CUTOFF, rate / RATE_PER_CUTOFF), slow_motion=True)
