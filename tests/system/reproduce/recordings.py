"""Intervals of the measured quadruped's parameters against what recordings give that were not fitted.

    python -m tests.system.reproduce.recordings [--data FOLDER]

The torque of the runs is computed from their commands and gains. Standard errors from one run: by the long-run
covariance of its scores (HAC), by identifying without each of six blocks of time in turn, by the larger of the two, and
as identification gives them (the larger of HAC and of leaving out stretches, as its model does not suffice here); and
those of four runs together. Printed is how often a 95 % interval holds what an unseen run gives, without and with that
run's own error, and the root mean square of the differences in standard errors, by kind of parameter.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli import LogRequest, identify, identify_logs, prepare, read_recording, read_robot
from elid_cli.estimation.regression.normal_equations import jackknife
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.logs import robot_as_logged
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals

DATA = Path(__file__).parents[4] / "shared" / "data"
RUNS, BLOCKS = 5, 6
KINDS = ("friction", "bodies, rotors")
Values = Mapping[str, tuple[float, float]]
"""Estimate and standard error of every supported parameter."""


def values_of(found: Identification) -> Values:
    """Return estimate and standard error of the supported parameters."""
    return {str(p.name): (p.estimate, p.std_error) for p in found.parameters if p.verdict == "supported"}


def without_block(signals: Signals, block: int) -> Signals:
    """Return a log without one of its blocks of time."""
    edges = np.linspace(0, len(signals.motion.t), BLOCKS + 1).astype(int)
    out = range(edges[block], edges[block + 1])
    left = []
    for part in signals.segments:
        for start, stop in ((part.start, min(part.stop, out.start)), (max(part.start, out.stop), part.stop)):
            if stop - start > 2 * signals.margin + 2:
                left.append(Segment(start, stop))
    return replace(signals, segments=tuple(left))


def by_blocks(robot: Robot, signals: Signals, whole: Values) -> Values:
    """Return the same estimates with the standard errors that leaving out blocks gives."""
    parts = [
        {str(p.name): p.estimate for p in identify(robot, without_block(signals, k)).parameters} for k in range(BLOCKS)
    ]
    names = [name for name in whole if all(name in part for part in parts)]
    spread = np.sqrt(np.diag(jackknife(np.array([[part[name] for name in names] for part in parts]))))
    return {name: (whole[name][0], float(s)) for name, s in zip(names, spread, strict=True)}


def kind_of(name: str) -> str:
    """Return the kind of a parameter by its name."""
    return KINDS[0] if name.startswith(("fs", "fv")) else KINDS[1]


def line(words: str, pairs: list[tuple[Values, Values]], *, own: bool) -> None:
    """Print how often intervals of the first hold the second's estimate; `own`: by the errors of both."""
    held: dict[str, list[float]] = {kind: [] for kind in (*KINDS, "all")}
    for fitted, unseen in pairs:
        for name in fitted.keys() & unseen.keys():
            (a, s), (b, other) = fitted[name], unseen[name]
            error = float(np.hypot(s, other if own else 0.0))
            if error > 0:
                held[kind_of(name)].append((b - a) / error)
                held["all"].append((b - a) / error)
    cells = (f"{100 * np.mean(np.abs(z) < 1.96):5.0f} % {np.sqrt(np.mean(np.square(z))):5.2f}" for z in held.values())
    print(f"{words:44s}" + "  ".join(cells) + f"  {len(held['all']):5d}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA)
    data = parser.parse_args().data
    logs = [str(data / f"go2_{k}.h5") for k in range(RUNS)]
    robot = robot_as_logged(read_robot(str(data / "go2.xml")), logs)
    signals = [prepare(read_recording([log], robot), robot) for log in logs]
    plain = [values_of(identify(robot, s, EstimateOptions(guards=False))) for s in signals]
    given = [values_of(identify(robot, s)) for s in signals]
    blocks = [by_blocks(robot, s, v) for s, v in zip(signals, plain, strict=True)]
    larger = [{n: (v, max(s, plain[k][n][1])) for n, (v, s) in own.items()} for k, own in enumerate(blocks)]
    rest = [tuple(log for k, log in enumerate(logs) if k != out) for out in range(RUNS)]
    pooled = [values_of(identify_logs(LogRequest(chosen, robot)).found) for chosen in rest]
    print(f"{'share held, rms difference':44s}" + "  ".join(f"{kind:>13s}" for kind in (*KINDS, "all")) + "  count")
    for own in (False, True):
        beside = " and that of the unseen run" if own else ""
        for name, said in (("HAC", plain), ("six blocks", blocks), ("the larger", larger), ("as identified", given)):
            pairs = [(said[i], said[j]) for i in range(RUNS) for j in range(RUNS) if i != j]
            line(f"one run, {name}{beside}", pairs, own=own)
        for name, said in (("HAC", plain), ("six blocks", blocks), ("as identified", given)):
            words = f"four runs, {name} of the unseen run" if own else "four runs"
            if own or said is given:
                line(words, list(zip(pooled, said, strict=True)), own=own)


if __name__ == "__main__":
    main()
