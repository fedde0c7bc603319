"""What a search accepts step by step, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew


@dataclass(frozen=True)
class Step:
    """One accepted effect and what could not be told apart from it."""

    candidate: Candidate
    rivals: tuple[Candidate, ...]
    together: float | None = None
    """Net gain of effects that were accepted together; None: the candidate's own."""
    quarters: tuple[float, ...] = ()
    """What it takes from the squared error of each quarter of the log, predicted from the others; NaN: cannot tell."""
    absorbed: bool = False
    """Whether its size told it, not the residual, which base parameters had brought down to noise (`absorbed.py`)."""

    @property
    def net(self) -> float:
        """Net gain in log-likelihood."""
        return self.candidate.net if self.together is None else self.together


@dataclass(frozen=True)
class Term:
    """What the collocation says of one term of a friction curve."""

    gain: float
    """Part of what the held-out stretches show beyond noise that the curve's further terms take away."""
    net: float
    """Gain in log-likelihood on the held-out stretches."""


@dataclass(frozen=True)
class Found:
    """Outcome of a search."""

    before: State
    after: State
    steps: tuple[Step, ...]
    remaining: tuple[Candidate, ...]
    """Best candidates that were not accepted, best first."""
    tried: int
    skews: tuple[Skew, ...] = ()
    """Skews between encoders that the positions show and the torques cannot."""
    terms: Mapping[int, Term] = field(default_factory=dict)
    """By number of the effect: terms of curves that the collocation told."""
    kept: int = 0
    """How many effects after the declared ones stay in the model without being named."""
    partial: bool = False
    """Whether Ctrl-C ended it."""
