"""Plan the motion whose log tells the hypotheses of a diagnosis apart, and say how surely it will (T-optimality)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, number, optional, options_given, whole
from elid_cli.errors import DataError, check_kind
from elid_cli.experiment.bounds import Bounds, bounds_of, within
from elid_cli.experiment.information import States
from elid_cli.experiment.reference import SplineReference, random_reference
from elid_cli.experiment.resolve.decision import Distance
from elid_cli.experiment.resolve.motions import Family, improved
from elid_cli.experiment.resolve.otherwise import LIKELY, Remedy, remedies
from elid_cli.experiment.resolve.played import Bench
from elid_cli.experiment.resolve.question import Group, Hypothesis, Question
from elid_cli.experiment.resolve.separation import Separation, View, varied
from elid_cli.model.effects import twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import Robot
from elid_cli.tables import Shown

BELOW = 1.0
"""Separation, in standard deviations of the noise, below which no motion tried tells two effects apart."""
CLEAR = 30.0
"""Standard deviations beyond which it does not matter how surely a pair is decided."""
OVER = 20.0
"""Weight of torques beyond their limits, per relative excess."""
DRAWS = ((-np.sqrt(3.0), 1 / 6), (0.0, 2 / 3), (np.sqrt(3.0), 1 / 6))
"""Standard errors by which a hypothesis's parameters are varied, and their weights in what is expected (Gauss-Hermite
of three nodes)."""
FAR_OFF = 1e-3
"""Weight of standard deviations where all pairs are too short of a decision to tell motions apart."""
CAP = 12.0
"""Standard deviations short of a decision beyond which all pairs count alike."""


_RULES = {
    "duration": number(above=0),
    "interval": optional(number(above=0)),
    "starts": whole(1),
    "steps": whole(0),
    "seed": whole(0),
}


@dataclass(frozen=True)
class ResolveOptions:
    """What to look for."""

    duration: float = 20.0
    """s."""
    interval: float | None = None
    """Time between the splines' way-points, s; by default each joint has its own, from its limits."""
    starts: int = 24
    """Random motions of which the best is improved."""
    steps: int = 120
    """Changes of it that are tried."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse a motion that takes no time, or that nothing is tried for (UsageError)."""
        check_fields(self, _RULES)


@dataclass(frozen=True)
class Pair:
    """Two hypotheses and what tells them apart."""

    first: Hypothesis
    second: Hypothesis
    named: bool
    """Whether the diagnosis named one of the two."""
    planned: float
    """Separation by a log of the planned motion, in standard deviations of the noise."""
    random: float
    """The same of a random motion of equal length within the same limits (median of some)."""
    probability: float
    """Probability that a diagnosis of the next log names the right one alone, whichever of the two it is."""
    chance: float
    """The same of the random motion."""
    twins: bool
    """Whether the two are the same in every row whatever the motion."""
    alike: bool = False
    """Whether the two are declared to imitate each other: a diagnosis then asks for a lead that is a share of the gain,
    and which of them it takes first counts as well, so nothing is promised."""
    otherwise: tuple[Remedy, ...] = ()
    """What would decide where this does not."""

    @property
    def behind(self) -> float:
        """Log-likelihood by which the second explains the last log worse than the first."""
        return self.second.behind - self.first.behind

    @property
    def last(self) -> float:
        """Separation by the last log, in standard deviations: the square root of twice that."""
        return float(np.sqrt(2.0 * abs(self.behind)))

    @property
    def verdict(self) -> str:
        """``promised``, ``likely`` (more often than not), ``unlikely`` or ``no motion``."""
        if self.twins or self.planned < BELOW:
            return "no motion"
        if self.probability >= LIKELY and not self.alike:
            return "promised"
        return "likely" if self.probability > 0.5 else "unlikely"


@dataclass(frozen=True, repr=False)
class Resolution(Shown):
    """A planned motion, and what its log will decide."""

    robot: Robot
    question: Question
    trajectory: SplineReference
    pairs: tuple[Pair, ...]
    used: dict[str, Array]
    """Share of each limit that the trajectory uses, (n,); NaN where the robot file has no limit."""
    tried: int
    """Motions that were judged."""
    options: ResolveOptions


def resolve(
    question: Question, options: ResolveOptions | None = None, progress: Callable[[float], None] | None = None
) -> Resolution:
    """Return the motion whose log tells the hypotheses of a diagnosis apart.

    Parameters
    ----------
    question
        What the diagnosis leaves open (`read_question`).
    options
        What to look for.
    progress
        Called with the fraction done.

    Raises
    ------
    UsageError
        An argument of another kind.
    DataError
        The robot cannot even hold itself within its torque limits, or a motion is too short for the filter.
    """
    check_kind("question", question, Question, "read_question(FILE, robot) reads one")
    options = options_given("resolve", options, ResolveOptions)
    bench = Bench(question)
    bounds = bounds_of(question.robot)
    judge = Judge(bench, bounds)
    family = Family.of(bounds, options.duration, options.interval)
    generator = np.random.default_rng([options.seed, 26])
    motion, _ = improved(family, judge.worth, options.starts, options.steps, generator, progress)
    others = [random_reference(question.robot, options.duration, seed) for seed in range(101, 104)]
    others = [within(other, bench.torques, bounds)[0] for other in others]
    # torque limits may have made the best of all that was tried slower than a motion that was only to be compared
    motion, used = within(
        max((within(motion, bench.torques, bounds)[0], *others), key=judge.worth), bench.torques, bounds
    )
    pairs = [pair for group in question.groups for pair in _pairs(judge, group, motion, others)]
    return Resolution(question.robot, question, motion, tuple(pairs), used, judge.tried, options)


class Judge:
    """Judges motions by the least surely decided pair of hypotheses."""

    def __init__(self, bench: Bench, bounds: Bounds) -> None:
        self.bench, self.bounds = bench, bounds
        self.separation = Separation(bench)
        self.tried = 0
        self._hopeful: dict[tuple[str, str], float] = {}

    def worth(self, motion: SplineReference) -> float:
        """Return how far the least surely decided pair of hypotheses clears what a decision needs, softly."""
        self.tried += 1
        margins, sigmas = [], list[float]()
        excess = 0.0
        try:
            for group in self.bench.question.groups:
                for truth, distances in self.judged(motion.sampled(self.bench.rate)[1:], group):
                    for rival, distance in distances:
                        key = (truth.name, rival.name)
                        self._hopeful[key] = max(self._hopeful.get(key, 0.0), distance.sigma)
                        margins.append((key, min(*distance.margins, CLEAR)))
                        sigmas.append(min(distance.sigma, CLEAR))
        except DataError:
            return -np.inf
        torque = np.abs(self.bench.torques(motion.sampled(self.bench.rate)[1:])).max(axis=0)
        excess = float(np.sum(np.maximum(torque / self.bounds.torque - 1.0, 0.0)))
        # what no motion so far tells apart must not hide what some do
        counted = [m for key, m in margins if self._hopeful[key] >= BELOW] or [m for _, m in margins]
        soft = -float(np.log(np.mean(np.exp(-np.clip(counted, -CAP, CLEAR)))))
        return soft + FAR_OFF * float(np.mean(sigmas or [0.0])) - OVER * excess

    def judged(
        self, states: States, group: Group, scale: float = 0.0, *, finely: bool = False
    ) -> Iterator[tuple[Hypothesis, list[tuple[Hypothesis, Distance]]]]:
        """Yield every hypothesis of a group with its distances from the others, if it is true and so far from its
        estimate, in standard errors."""  # noqa: D205, D209
        for truth in group.hypotheses:
            if truth.once:
                continue
            true = varied(truth, scale) if scale else truth
            view = self.separation.view(states, true)
            distances = []
            for rival in group.hypotheses:
                if rival is not truth:
                    shapes = self._shapes(view, rival, finely=finely)
                    distances.append((rival, self.separation.distance(view, true, rival, shapes)))
            yield truth, distances

    def distances(self, group: Group, states: States) -> dict[tuple[str, str], Distance]:
        """Return the distances of a group's hypotheses on one motion, by the names of truth and rival."""
        found = self.judged(states, group, finely=True)
        return {(truth.name, rival.name): distance for truth, all_ in found for rival, distance in all_}

    def same(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Whether two effects are the same in every row, whatever the motion."""
        scene = self.bench.at_rest()
        for a, b in ((one, other), (other, one)):
            together = a.kind.same_together(self.bench.robot, {a.number: a.parameters})
            for twin in (*a.kind.same_here(scene, a.number, a.parameters), *together):
                if (twin.effect, twin.joint) == (b.effect, b.number):
                    return True
        return False

    def _shapes(self, view: View, rival: Hypothesis, *, finely: bool) -> Sequence[Effect]:
        if rival.once:
            return ()
        shapes = self.separation.shapes(view, rival)
        return [*shapes, self.separation.refined(view, shapes)] if finely else shapes


Expected = Mapping[tuple[str, str], tuple[float, float]]
"""(truth, rival) -> separation in standard deviations and probability of a right decision, means over parameters."""


def expected(judge: Judge, group: Group, motion: SplineReference) -> Expected:
    """Return what a log of a motion is expected to show of a group, over its parameters' uncertainty."""
    found: dict[tuple[str, str], tuple[float, float]] = {}
    states = motion.sampled(judge.bench.rate)[1:]
    for scale, weight in DRAWS:
        for truth, distances in judge.judged(states, group, scale, finely=True):
            for rival, distance in distances:
                sigma, probability = found.get((truth.name, rival.name), (0.0, 0.0))
                both = sigma + weight * distance.sigma, probability + weight * distance.probability
                found[truth.name, rival.name] = both
    return found


def _pairs(judge: Judge, group: Group, motion: SplineReference, others: Sequence[SplineReference]) -> Iterator[Pair]:
    """Yield the pairs of a group with what the motion, and random ones, tell of them."""
    mine = expected(judge, group, motion)
    random = [expected(judge, group, other) for other in others]
    for a, b in combinations(group.hypotheses, 2):
        ways = [key for key in ((a.name, b.name), (b.name, a.name)) if key in mine]
        if not ways:
            continue
        sigma, probability = min(mine[k][0] for k in ways), float(np.mean([mine[k][1] for k in ways]))
        others_sigma = float(np.median([min(r[k][0] for k in ways) for r in random]))
        chance = float(np.mean([np.mean([r[k][1] for k in ways]) for r in random]))
        alike = b.effect in twins_of(a.kind)
        pair = Pair(a, b, group.named, sigma, others_sigma, probability, chance, judge.same(a, b), alike)
        if pair.verdict != "promised":
            states = motion.sampled(judge.bench.rate)[1:]
            more = remedies(a, b, states, partial(judge.distances, group), hopeless=pair.twins)
            pair = replace(pair, otherwise=more)
        yield pair
