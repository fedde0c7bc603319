"""What the search by motion takes."""

from __future__ import annotations

from dataclasses import dataclass

from elid_cli.diagnosis.by_motion.candidates import Candidate
from elid_cli.model.effects.effect import Effect


@dataclass(frozen=True)
class Named:
    """An effect that the search took, with its gain in blocks not fitted to and what does as well."""

    effect: Effect
    gain: float
    helped: float
    rivals: tuple[Candidate, ...] = ()
    forms: tuple[Candidate, ...] = ()
    """The same effect with other choices among its shapes, tried where its values are none that robots have."""
