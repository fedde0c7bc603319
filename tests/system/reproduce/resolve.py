"""Whether the planned next log decides what a first log left open: ``elid excite --resolve`` on simulated ties.

    python -m tests.system.reproduce.resolve [--pairs 0-15] [--arms 0-1] [--logs 3] [--seconds 10]

For every pair of effects, the first of them as the truth, a random arm of two joints moves a little, slowly and for a
short time until a diagnosis with those two effects cannot tell them apart. The answer is given to the planner; the log
of the planned motion, of a random motion and of plain ``elid excite``, all as long and as noisy, are diagnosed anew,
each alone. The shorter these are, the more it matters how the robot moves. Logs are made by inverse dynamics with
effects written a second time (`inverse_logs`), not by the simulator that shares its formulas with the planner.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.errors import ElidError
from elid_cli.experiment.excitation import ExciteOptions, excite
from elid_cli.experiment.reference import SplineReference, random_reference
from elid_cli.experiment.resolve import Pair, Question, ResolveOptions, question_of, resolve
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import WHOLE, Array, Made, laws_of, log_of, make, recorded

PAIRS = (
    ("transmission_damping", "link_viscous"),
    ("load_friction", "position_friction"),
    ("position_friction", "load_friction"),
    ("velocity_coupling", "quadratic_viscous"),
    ("torque_ripple", "kinematic_error"),
    ("torque_ripple", "position_friction"),
    ("position_friction", "torque_ripple"),
    ("load_friction", "quadratic_viscous"),
    ("load_friction", "friction_drift"),
    ("load_friction", "stribeck"),
    ("link_viscous", "encoder_skew"),
    ("link_spring", "gravity_direction"),
    ("gravity_direction", "link_spring"),
    ("encoder_skew", "link_viscous"),
    ("torque_offset", "asymmetric_coulomb"),
    ("asymmetric_coulomb", "torque_offset"),
)
"""Truth and rival, of which some poor log ties the two. Not so with these effects' sizes: backlash, hysteresis, cubic
stiffness and friction of the link, which poor logs show or do not show at all."""
RATE = 500.0
SHORT, LONG = 5.0, 10.0
"""Length of the first log, and of the next one where nothing else is asked for, s."""
NOISES = (0.005, 0.01, 0.02, 0.04)
"""White torque noise, as a part of the joint's typical torque: an arm's is the first with which a poor log ties."""
POSITION = 2e-6
"""rad; white noise of the encoders."""
ATTEMPTS = 24
"""Poor motions that are tried until one leaves a tie."""


@dataclass
class Count:
    """Outcomes of logs of one kind."""

    right: int = 0
    wrong: int = 0
    open: int = 0

    def add(self, outcome: str) -> None:
        """Count one outcome."""
        setattr(self, outcome, getattr(self, outcome) + 1)

    def __str__(self) -> str:
        return f"{self.right}/{self.wrong}/{self.open}"


@dataclass
class Line:
    """One pair with one of the two as the truth, over arms."""

    truth: str
    rival: str
    ties: int = 0
    promises: int = 0
    sigma: list[float] = field(default_factory=list)
    random: list[float] = field(default_factory=list)
    probability: list[float] = field(default_factory=list)
    planned: Count = field(default_factory=Count)
    promised: Count = field(default_factory=Count)
    by_chance: Count = field(default_factory=Count)
    excited: Count = field(default_factory=Count)


def log(made: Made, effect: str, joint: int, motion: tuple[Array, Array, Array], noise: float, seed: int) -> Recording:
    """Return the log of a motion of the arm in which an effect acts, with the same absolute noise whatever it is."""
    t = np.arange(len(motion[0])) / RATE
    moving = replace(made, t=t, q=motion[0], dq=motion[1], ddq=motion[2])
    signals = log_of(moving, laws_of(effect, moving, joint))
    clean = recorded(made, signals, db=np.inf, counts=0.0, torque=0.0, colour=0.0, seed=seed)
    rng = np.random.default_rng([seed, 78])
    sizes = np.array([s.torque for s in made.sizes])
    q, theta = (x + POSITION * rng.standard_normal(x.shape) for x in (signals["q"], signals["theta"]))
    tau = signals["tau"] + noise * sizes * rng.standard_normal(q.shape)
    return replace(clean, t=t, q=q, theta=theta, tau=tau, segments=(replace(clean.segments[0], stop=len(t)),))


def looked(made: Made, recording: Recording, only: tuple[str, str]) -> Diagnosis:
    """Return a diagnosis with two effects."""
    signals = prepare(recording, made.truth, SignalOptions.for_diagnosis(RATE))
    return diagnose(made.truth, signals, DiagnoseOptions(only=only))


def outcome(found: Diagnosis, truth: str, rival: str) -> str:
    """Return whether a diagnosis names the truth alone (right), the rival alone (wrong), or leaves it open."""
    named = {e.effect for e in found.effects}
    possible = named | {r.effect for r in found.also_possible}
    if truth in named and rival not in possible:
        return "right"
    return "wrong" if rival in named and truth not in possible else "open"


def poor_motions(made: Made, joint: int, seed: int) -> Iterator[tuple[Array, Array, Array]]:
    """Yield what an operator plays who tries one joint: it swings with one or two sines, the others hardly move."""
    rng = np.random.default_rng([seed, 79])
    t = np.arange(round(SHORT * RATE)) / RATE
    for _ in range(ATTEMPTS):
        states = np.zeros((3, len(t), made.truth.n))
        for k in range(made.truth.n):
            size = rng.uniform(0.1, 0.8) if k == joint else rng.uniform(0.0, 0.05)
            centre = rng.uniform(-0.4, 0.4)
            for share in (1.0, rng.uniform(0.0, 0.3)):
                w, phase = 2 * np.pi / rng.uniform(1.5, 5.0), rng.uniform(0, 2 * np.pi)
                for order in range(3):
                    states[order, :, k] += size * share * w**order * np.sin(w * t + phase + order * np.pi / 2)
            states[0, :, k] += centre
        yield states[0], states[1], states[2]


def tie(made: Made, truth: str, rival: str, joint: int, seed: int) -> tuple[Question, float] | None:
    """Return what the first poor log that ties two effects leaves open, and its noise; None where none of some does."""
    for number, motion in enumerate(poor_motions(made, joint, seed)):
        noise = NOISES[number * len(NOISES) // ATTEMPTS]
        try:
            found = looked(made, log(made, truth, joint, motion, noise, 100 * seed + number), (truth, rival))
            question = question_of(found.to_dict(), made.truth)
        except ElidError:
            continue
        question = replace(question, groups=tuple(g for g in question.groups if _asks(g.hypotheses, truth, rival)))
        if question.groups:
            return question, noise
    return None


def _asks(hypotheses: Sequence[object], truth: str, rival: str) -> bool:
    return {truth, rival} <= {getattr(h, "effect") for h in hypotheses}  # noqa: B009


def played(reference: SplineReference) -> tuple[Array, Array, Array]:
    """Return a planned motion at the rate of the log."""
    return reference.evaluate(np.arange(round(reference.duration * RATE)) / RATE)


@cache
def arm_of(arm: int) -> Made:
    """Return an arm of two joints."""
    return make(31 + arm, 2, rate=RATE, duration=LONG)


@cache
def usual(arm: int, seconds: float) -> SplineReference:
    """Return the motion that plain ``elid excite`` plans for an arm's parameters."""
    return excite(arm_of(arm).truth, ExciteOptions(duration=seconds, seed=arm)).trajectory


def _pair(pairs: Sequence[Pair], truth: str, rival: str) -> Pair:
    return next(p for p in pairs if {p.first.effect, p.second.effect} == {truth, rival})


def tried(truth: str, rival: str, arms: Sequence[int], logs: int, seconds: float = LONG) -> Line:
    """Return what becomes of a pair with one of them as the truth."""
    line = Line(truth, rival)
    for arm in arms:
        made = arm_of(arm)
        joint = 0 if truth in WHOLE or rival in WHOLE else arm % 2
        tied = tie(made, truth, rival, joint, arm)
        if tied is None:
            continue
        question, noise = tied
        plan = resolve(question, ResolveOptions(duration=seconds, seed=arm))
        pair = _pair(plan.pairs, truth, rival)
        line.ties += 1
        line.promises += pair.verdict == "promised"
        line.sigma.append(pair.planned)
        line.random.append(pair.random)
        line.probability.append(pair.probability)
        motions = (
            (line.planned, plan.trajectory),
            (line.by_chance, random_reference(made.truth, seconds, 500 + arm)),
            (line.excited, usual(arm, seconds)),
        )
        for number in range(logs):
            for count, reference in motions:
                recording = log(made, truth, joint, played(reference), noise, 7000 + 10 * arm + number)
                got = outcome(looked(made, recording, (truth, rival)), truth, rival)
                count.add(got)
                if count is line.planned and pair.verdict == "promised":
                    line.promised.add(got)
    return line


def main(pairs: Sequence[tuple[str, str]], arms: Sequence[int], logs: int, seconds: float = LONG) -> list[Line]:
    """Print the table."""
    print("plan, random: separation in σ; p: probability of a right decision; sure: promised, of so many ties")
    print("then right/wrong/open of the logs of the planned motion, a random one, and plain elid excite")
    print(f"{'truth':>20} {'rival':>20} {'plan':>6} {'random':>6} {'p':>5} {'sure':>5} {'plan':>7} {'random':>7} "
          f"{'excite':>7}")  # fmt: skip
    lines = []
    for truth, rival in pairs:
        line = tried(truth, rival, arms, logs, seconds)
        lines.append(line)
        if not line.ties:
            print(f"{truth:>20} {rival:>20}  no tie among {len(arms) * ATTEMPTS} poor logs", flush=True)
            continue
        sigma, random, probability = (float(np.mean(x)) for x in (line.sigma, line.random, line.probability))
        print(f"{truth:>20} {rival:>20} {sigma:>6.1f} {random:>6.1f} {probability:>5.2f} {line.promises:>3}/{line.ties}"
              f" {line.planned!s:>7} {line.by_chance!s:>7} {line.excited!s:>7}", flush=True)  # fmt: skip
    for title, name in (("planned motion", "planned"), ("of them promised", "promised"),
                        ("random motion", "by_chance"), ("plain excite", "excited")):  # fmt: skip
        counts = [getattr(line, name) for line in lines]
        right, wrong, left = (sum(getattr(c, kind) for c in counts) for kind in ("right", "wrong", "open"))
        total = max(right + wrong + left, 1)
        print(f"{title:>18}: {right + wrong + left:>4} logs, right {right / total:.1%}, wrong {wrong / total:.1%}, "
              f"open {left / total:.1%}")  # fmt: skip
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", default=f"0-{len(PAIRS) - 1}")
    parser.add_argument("--arms", default="0-1")
    parser.add_argument("--logs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=LONG)
    asked = parser.parse_args()
    chosen = [range(int(low), int(high or low) + 1) for low, _, high in (
        text.partition("-") for text in (asked.pairs, asked.arms))]  # fmt: skip
    main([PAIRS[k] for k in chosen[0]], chosen[1], asked.logs, asked.seconds)
