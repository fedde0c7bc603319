"""How to make signals from a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from elid_cli.errors import UsageError, check_number, check_word

RATE_PER_CUTOFF = 5.0
"""Samples kept per second for every Hz of cut-off."""
DIAGNOSIS_CUTOFF = 25.0
"""Hz; higher than what parameters need, since ripple, vibration and reversals live above them."""


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
        check_word("SignalOptions: smoothing", self.smoothing, ("spline", "butterworth"))
        check_word("SignalOptions: commands", self.commands, ("held", "smooth"))
        for name in ("cutoff", "rate", "min_velocity", "knots", "butterworth", "order"):
            check_number(f"SignalOptions: {name}", getattr(self, name))
        for name in ("cutoff", "rate", "knots", "butterworth", "order"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise UsageError(f"SignalOptions: {name} {value:g} is not above 0")
        if self.min_velocity is not None and not self.min_velocity >= 0:
            raise UsageError(f"SignalOptions: min_velocity {self.min_velocity:g} is negative")

    def of_log(self, rate: float) -> SignalOptions:
        """Return the options for a log of `rate` samples per second: a rate that told just that is no other wish."""
        return replace(self, rate=None) if self.rate == rate else self

    @classmethod
    def for_diagnosis(cls, rate: float) -> SignalOptions:
        """Return what a diagnosis needs of a log of `rate` samples per second: sharp, with its slow motion kept."""
        return cls(cutoff=min(DIAGNOSIS_CUTOFF, rate / RATE_PER_CUTOFF), slow_motion=True)
