"""Blocked cross-validation over quarters: what every effect is worth on a quarter of the log that the fit never saw.

    python -m tests.system.measured.quarters data/kr300_A.csv kr300 [effect@joint …]

prints what a diagnosis itself asks before it names an effect (see `elid_cli.diagnosis.evidence.quarters`): the part of
the error in the effect's rows, of encoder faults in the deflection, that it takes away on each quarter of the log,
predicted from the other three. Effects that were refuted follow. Effects that are named on the command line are tried
as well, on top of those found, each at the shape that the other quarters prefer. Last comes the
gain: of those found on the held-out stretches, of the others over all quarters together.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.diagnosis.search.screening import score, sensible
from elid_cli.estimation.stretches import QUARTERS, STRETCHES, quarter_of
from elid_cli.logs import read_recording
from elid_cli.model.effects import effect_classes
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare


def quarters(log: Log) -> Iterator[Log]:
    """Yield the log with each quarter held out in turn; the rest is in the folds of a search."""
    instants = log.observation.instants
    quarter = quarter_of(instants)
    for k in range(QUARTERS):
        rest = np.flatnonzero(quarter != k)
        fold = np.full(instants, -1, dtype=np.intp)
        fold[rest] = np.arange(len(rest)) * STRETCHES // len(rest)
        yield replace(log, fold=fold)


def tried(found: Diagnosis, name: str, joint: int) -> tuple[tuple[float, ...], float, str]:
    """Return what a further effect would be worth per quarter and on the whole, and the verdict in words."""
    kind, gains, possible = effect_classes()[name], [], True
    for log in quarters(found.state_after.log):
        state = refitted(found.state_after, log)
        best = max(
            (c for shape in kind.grid(state.scene, joint) if (c := score(state, kind(joint, shape), 1, 1)) is not None),
            key=lambda c: (c.plausible, c.net),
            default=None,
        )
        if best is None:
            gains.append((float("nan"), 0.0, 0.0))
            continue
        grown = refreshed(fit(state.log, (*state.effects, best.effect), state.scene))
        last = len(grown.effects) - 1
        possible &= sensible(grown.effects[last], grown.scene, grown.named(last))
        possible &= grown.impossible <= state.impossible
        gains.append(_weighed(grown, last))
    before, after = (sum(gain[k] for gain in gains) for k in (1, 2))
    whole = 1 - after / before if before > 0 else 0.0
    parts = tuple(gain for gain, *_ in gains)
    helps = whole > 0 and all(gain > 0 for gain in parts if np.isfinite(gain))
    return parts, whole, "impossible values" if not possible else "would survive" if helps else "fails"


def refitted(state: State, log: Log) -> State:
    """Return a model fitted to the folds of `log`."""
    return fit(log, state.effects, state.scene)


def _weighed(state: State, number: int) -> tuple[float, float, float]:
    """Return an effect's gain on the held-out quarter, and the squared errors there without it and with it."""
    lacking = without(state, number)
    rows = touched(lacking, state, state.columns[number].rows)
    unit = {row: max(state.floor.rms[row], 1e-4 * state.triangles.torque_rms(row)) ** -2 for row in rows}
    before, after = (
        sum(unit[row] * t.squares(fit_.solution.values) for row in rows for t in held_out_triangles(fit_).of(row))
        for fit_ in (lacking, state)
    )
    return (1 - after / before if before > 0 else float("nan")), before, after


def main(arguments: Sequence[str]) -> None:
    """Print the gains of the effects that a diagnosis names, and of those that are asked for."""
    path, name, *further = arguments
    robot = read_robot(name)
    recording = read_recording([path], robot, None)
    found = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))
    rows = [(e.effect, e.joint, e.quarters, e.gain, "survives") for e in found.effects]
    rows += [(s.effect, s.joint, s.gains, s.whole, "refuted" + ", kept" * s.kept) for s in found.refuted]
    for text in further:
        effect, _, joint = text.partition("@")
        place = robot.joint_names.index(joint or robot.joint_names[0])
        rows.append((effect, robot.joint_names[place], *tried(found, effect, place)))
    print(f"{'effect':22}{'joint':9}" + "".join(f"{f'stretch {k + 1}':>11}" for k in range(QUARTERS)) + "      gain")
    for name, at, gains, whole, word in rows:
        cells = "".join(f"{'-' if np.isnan(gain) else f'{gain:.1%}':>11}" for gain in gains)
        print(f"{name:22}{at or 'robot':9}{cells}{whole:>10.1%}  {word}")


if __name__ == "__main__":
    main(sys.argv[1:])
