"""Blocked cross-validation over quarters: what every effect is worth on a quarter of the log that the fit never saw.

    python tests/measured/quarters.py ../shared/data/kr300_A.csv kr300 [effect@joint …]

diagnoses the log and then, quarter after quarter, fits the model with and without each effect to the other three. The
gain is the part of the error in the effect's rows, on the quarter left out, that it takes away. Effects that are named
on the command line are tried as well, on top of those found, each at the shape that the other quarters prefer.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.conditioning import options_for
from elid_cli.diagnosis.diagnose import held_out_triangles
from elid_cli.diagnosis.encoders import link_load
from elid_cli.diagnosis.screen import score, sensible
from elid_cli.diagnosis.search import touched
from elid_cli.diagnosis.state import Log, State, fit, refreshed, without
from elid_cli.diagnosis.stretches import FOLDS
from elid_cli.logs import read_recording
from elid_cli.robot_file import read_robot
from elid_cli.shifts import SKEW
from elid_cli.signals import prepare
from elid_cli.terms import effect_classes

Array = NDArray[np.float64]
QUARTERS = 4


@dataclass(frozen=True)
class Survival:
    """What an effect is worth on each quarter, predicted from the other three; NaN where it has no equations."""

    effect: str
    joint: str | None
    gains: tuple[float, ...]
    whole: float
    """The same over all quarters together: of the sum of their squared errors."""
    possible: bool = True
    """Whether its values are physically possible, whatever three quarters it is fitted to."""

    @property
    def survives(self) -> bool:
        """Whether it is possible, and helps over all quarters together and on at least three of the four."""
        known = [gain for gain in self.gains if np.isfinite(gain)]
        return self.possible and self.whole > 0 and sum(gain > 0 for gain in known) >= len(known) - 1


def quarters(log: Log) -> Iterator[Log]:
    """Yield the log with each quarter held out in turn; the rest is in the folds of a search."""
    instants = log.observation.instants
    quarter = np.arange(instants) * QUARTERS // instants
    for k in range(QUARTERS):
        rest = np.flatnonzero(quarter != k)
        fold = np.full(instants, -1, dtype=np.intp)
        fold[rest] = np.arange(len(rest)) * FOLDS // len(rest)
        yield replace(log, fold=fold)


def survivals(found: Diagnosis, declared: int = 0) -> list[Survival]:
    """Return what every effect that was found is worth; the first `declared` ones are the robot file's."""
    after, names = found.state_after, found.robot.joint_names
    shown = [_skew(after, names.index(e.joint or "")) for e in found.effects if e.deflection]
    fitted = [refitted(after, log) for log in quarters(after.log)]
    for k in range(declared, len(after.effects)):
        effect = after.effects[k]
        gains = [_weighed(state, k) for state in fitted]
        shown.append(_survival(effect.name, None if effect.whole_robot else names[effect.joint], gains))
    return shown


def tried(found: Diagnosis, name: str, joint: int) -> Survival:
    """Return what a further effect would be worth, at the shape that each quarter's rest prefers."""
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
    return replace(_survival(name, found.robot.joint_names[joint], gains), possible=possible)


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


def _survival(effect: str, joint: str | None, gains: Sequence[tuple[float, float, float]]) -> Survival:
    before, after = (sum(gain[k] for gain in gains) for k in (1, 2))
    return Survival(effect, joint, tuple(gain for gain, *_ in gains), 1 - after / before if before > 0 else 0.0)


def _skew(state: State, joint: int) -> Survival:
    """Return what a skew takes from the deflection on each quarter, all fitted to the others."""
    log = state.log
    motion = log.raw.motion
    deflection = log.raw.decimate((motion.theta[:, joint] - motion.q[:, joint])[None])[0]
    speed = log.raw.decimate(motion.dq[:, joint][None])[0]
    columns = np.array([speed, link_load(state, joint), np.ones(len(deflection))])
    known = np.isfinite(deflection) & np.isfinite(columns).all(axis=0)
    gains = []
    for part in quarters(log):
        train, test = known & (part.fold >= 0), known & (part.fold < 0)
        error = []
        for used in (columns, columns[1:]):
            scale = np.linalg.norm(used[:, train], axis=1)[:, None]
            fitted = np.linalg.lstsq((used / scale)[:, train].T, deflection[train], rcond=None)[0]
            error.append(float(np.sum((deflection - fitted @ (used / scale))[test] ** 2)))
        gains.append((1 - error[0] / error[1], error[1], error[0]))
    return _survival(SKEW, state.log.model.robot.joint_names[joint], gains)


def _word(row: Survival) -> str:
    return "survives" if row.survives else "fails" if row.possible else "fails: impossible values"


def main(arguments: Sequence[str]) -> None:
    """Print the gains of the effects that a diagnosis names, and of those that are asked for."""
    path, name, *further = arguments
    robot = read_robot(name)
    recording = read_recording([path], robot, None)
    found = diagnose(robot, prepare(recording, robot, options_for(recording.rate)))
    rows = survivals(found, len(robot.effects))
    for text in further:
        effect, _, joint = text.partition("@")
        rows.append(tried(found, effect, robot.joint_names.index(joint or robot.joint_names[0])))
    print(f"{'effect':22}{'joint':9}" + "".join(f"{f'quarter {k + 1}':>11}" for k in range(QUARTERS)) + "     whole")
    for row in rows:
        cells = "".join(f"{gain:>11.1%}" for gain in row.gains)
        print(f"{row.effect:22}{row.joint or 'robot':9}{cells}{row.whole:>10.1%}  {_word(row)}")


if __name__ == "__main__":
    main(sys.argv[1:])
