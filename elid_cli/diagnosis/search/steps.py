"""What a search accepts step by step, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from elid_cli.diagnosis.fit.state import State, refreshed, without
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.model.effects import twins_of
from elid_cli.model.effects.kinds import goes_with

NEAR = 10.0
"""Effects whose net gain is this near to the best cannot be told apart from it …"""
NEAR_SHARE = 0.01
"""… or whose gain differs by this part: then the form of the curve decides, which a log can only hint at."""
TWIN_SHARE = 0.7
"""Part of the best gain from which a declared twin is named as possible, too."""
EVEN = 0.5
"""Difference in log-likelihood that says nothing."""


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


def dropped(state: State, steps: Sequence[Step], declared: int, number: int) -> tuple[State, list[Step]]:
    """Return a state and its steps without one of these, and what goes with it; `declared` effects have no step."""
    gone = state.effects[declared + number]
    rest = [step for step, effect in zip(steps, state.effects[declared:], strict=True) if not goes_with(effect, gone)]
    return refreshed(without(state, declared + number)), rest


def best_step(able: Sequence[Candidate]) -> Step:
    """Return the best of some supported candidates with those that cannot be told apart from it."""
    most = max(able, key=lambda c: c.gain.whole)
    share = most.gain.likelihood / most.gain.whole if most.gain.whole > 0 else 1.0
    able = sorted(able, key=lambda c: -c.merit(share))
    highest = able[0].merit(share)
    near = [c for c in able if c.merit(share) > highest - max(NEAR, NEAR_SHARE * highest)]
    # among equals the one with the fewest parameters: the others hold it as a special case, or fit its noise
    fewest = min((c.size, c.gain.width) for c in near)
    simplest = [c for c in near if (c.size, c.gain.width) == fewest]
    # of twins that differ by less than chance a joint's own effect goes before the whole robot's
    top = max(c.merit(share) for c in simplest)
    best = min(simplest, key=lambda c: (c.merit(share) <= top - EVEN, c.effect.whole_robot, -c.merit(share)))
    twins = [c for c in able if c not in near and are_twins(best, c) and c.merit(share) > TWIN_SHARE * highest]
    return Step(best, tuple(c for c in (*near, *twins) if c is not best))


def are_twins(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are declared to imitate each other at this place."""
    kinds = type(one.effect), type(other.effect)
    named = kinds[1].name in twins_of(kinds[0])
    return named and (one.effect.joint == other.effect.joint or any(kind.whole_robot for kind in kinds))
