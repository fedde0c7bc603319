"""Friction that fades with the speed, by the exponential or the Gaussian law: is Coulomb friction within its error.

    python -m tests.system.reproduce.friction_forms [LOGS] [FIRST]

LOGS logs (default 90), from number FIRST on (default 100), of random arms of two joints made by inverse dynamics, each
with a Stribeck friction of its own size, speed and law at one joint, noise of 70 or 80 dB on positions and 0.3 or 1 %
on torques. The law is not told: friction that falls from standstill is at times as good as friction that rises
towards it, and the Coulomb friction that goes with each is another.
"""

from __future__ import annotations

import argparse
import sys
from typing import NamedTuple

import numpy as np

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Array, Laws, World, log_of, make, recorded

RATE = 500.0


class Told(NamedTuple):
    """What is said of one log, and what is true."""

    found: Diagnosis
    joint: str
    law: float
    """Exponent."""
    score: float
    """Error of the Coulomb friction over its standard error."""

    @property
    def exponents(self) -> list[float]:
        """The laws that are named at the joint."""
        return [e.parameters["exponent"] for e in self.found.effects if e.joint == self.joint]

    @property
    def ties(self) -> int:
        """How many other laws explain the log as well."""
        return sum(len(e.forms) for e in self.found.effects if e.joint == self.joint)


def told(number: int) -> Told:
    """Return what is said of one log."""
    generator = np.random.default_rng([number, 5])
    made = make(number, 2, rate=RATE)
    k, law = int(generator.integers(2)), float(generator.choice([1.0, 2.0]))
    coulomb = made.truth.joints[k].parameters["fs"]
    size, speed = generator.uniform(0.3, 1.0) * coulomb, generator.uniform(0.04, 0.15)

    def friction(world: World) -> Array:
        extra = np.zeros_like(world.dtheta)
        own = world.dtheta[:, k]
        extra[:, k] = size * np.sign(own) * np.exp(-((np.abs(own) / speed) ** law))
        return extra

    db, torque = float(generator.choice([70.0, 80.0])), float(generator.choice([0.003, 0.01]))
    signals = log_of(made, Laws(motor=[friction]))
    log = recorded(made, signals, db=db, counts=0.0, torque=torque, colour=0.0, seed=number)
    options = SignalOptions.for_diagnosis(RATE)
    found = diagnose(made.truth, prepare(log, made.truth, options), DiagnoseOptions(only=("stribeck",)))
    assert isinstance(found, Diagnosis)
    item = next(p for p in found.identified_after.parameters if p.name == f"fs{k + 1}")
    return Told(found, made.truth.joint_names[k], law, (item.estimate - coulomb) / item.std_error)


def table(logs: list[Told]) -> str:
    """Return the figures of all logs in which the friction was named."""
    named = [log for log in logs if log.exponents]
    scores = np.abs([log.score for log in named])
    right = sum(log.exponents == [log.law] for log in named)
    several = sum(len(log.exponents) > 1 for log in named)
    tied = sum(log.ties > 0 for log in named)
    rms = float(np.sqrt(np.mean(scores**2)))
    return (
        f"{len(logs)} logs: Stribeck friction named in {len(named)}, by the right law alone in {right}, as a curve of "
        f"two terms in {several};\nanother law told as well in {tied}; Coulomb friction within 2 standard errors in "
        f"{100 * np.mean(scores < 2):.1f} %, rms {rms:.2f}, at most {scores.max():.1f}"
    )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("logs", type=int, nargs="?", default=90)
    parser.add_argument("first", type=int, nargs="?", default=100)
    asked = parser.parse_args()
    logs = []
    for number in range(asked.first, asked.first + asked.logs):
        logs.append(told(number))
        last = logs[-1]
        print(f"{number:4d} {last.law:g} {last.exponents} {last.ties} {last.score:+.1f}", file=sys.stderr, flush=True)
    print(table(logs))


if __name__ == "__main__":
    main()
