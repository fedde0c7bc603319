"""How signals are conditioned for a diagnosis, and for a validation that is to give the same figures."""

from __future__ import annotations

from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import RATE_PER_CUTOFF

CUTOFF = 25.0
"""Hz; higher than what parameters need, since ripple, vibration and reversals live above them."""


def cutoff_for(rate: float) -> float:
    """Return the cut-off (Hz) of the parallel filter for a log of `rate` samples per second."""
    return min(CUTOFF, rate / RATE_PER_CUTOFF)


def options_for(rate: float) -> SignalOptions:
    """Return how to prepare a log of `rate` samples per second: sharp, with its slow motion kept."""
    return SignalOptions(cutoff=cutoff_for(rate), slow_motion=True)
