"""How the work grows with joints, samples and candidates: seconds at several sizes, and the exponent fitted to them.

Start-up is not counted: with it, every exponent would be smaller.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from tests.system.benchmarks import made

Work = Callable[[], object]


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return the slope of log seconds over log sizes, by least squares."""
    x, y = np.log(sizes), np.log(seconds)
    x = x - x.mean()
    return float(x @ (y - y.mean()) / (x @ x))


def measured(works: dict[float, Work], rounds: int = 3) -> dict[str, float]:
    """Return the least CPU seconds of each size's work, the sizes in turn; what is imported is there before."""
    works[min(works)]()
    least = dict.fromkeys(works, math.inf)
    for _ in range(rounds):
        for size, work in works.items():
            begin = time.process_time()
            work()
            least[size] = min(least[size], time.process_time() - begin)
    return {f"{size:g}": seconds for size, seconds in least.items()}


def classify(*joints: str) -> dict[str, float]:
    """Base parameters and classes of chains of rigid joints, geometry traced anew."""
    from elid_cli.model.base_parameters import find_base
    from elid_cli.model.regressor import Regressor

    # another geometry in each round: what was classified before is remembered
    robots = {int(n): iter([made.chain(int(n), 0.1 + 0.01 * k) for k in range(5)]) for n in joints}

    def classified(n: int) -> Work:
        return lambda: find_base(Regressor(next(robots[n])))

    return measured({n: classified(n) for n in robots})


def identify_joints(*joints: str) -> dict[str, float]:
    """Identification of 20 s at 1 kHz of chains of rigid joints."""
    return measured({int(n): _identified(made.chain(int(n)), 20.0) for n in joints})


def identify_samples(*seconds: str) -> dict[str, float]:
    """Identification of some seconds at 1 kHz of six rigid joints, at a given cut-off."""
    return measured({float(s): _identified(made.rigid(made.puma()), float(s)) for s in seconds})


def _identified(robot, seconds: float) -> Work:  # type: ignore[no-untyped-def]
    from elid_cli.estimation.identify import identify
    from elid_cli.memory import keep_freed_memory
    from elid_cli.signals.options import SignalOptions
    from elid_cli.signals.signals import prepare

    keep_freed_memory()
    recording = made.recording(robot, seconds)
    return lambda: identify(robot, prepare(recording, robot, SignalOptions(cutoff=10.0)))


def diagnose_joints(*joints: str) -> dict[str, float]:
    """Diagnosis of 8 s at 500 Hz of chains of rigid joints that lack nothing: every effect is tried at every joint."""
    return measured({int(n): _diagnosed(made.chain(int(n)), ()) for n in joints}, 1)


def diagnose_candidates(*effects: str) -> dict[str, float]:
    """The same of four joints with so many effects to try, the first by name; the size is that of candidates."""
    from elid_cli.model.effects import effect_classes

    robot = made.chain(4)
    searched = [kind for _, kind in sorted(effect_classes().items()) if kind.searched]
    able = [kind for kind in searched if any(kind.applies(robot, k) for k in range(robot.n))]
    works = {}
    for chosen in (able[: int(count)] for count in effects):
        candidates = sum(kind.applies(robot, k) for kind in chosen for k in range(robot.n))
        works[float(candidates)] = _diagnosed(robot, tuple(kind.name for kind in chosen))
    return measured(works, 1)


def _diagnosed(robot, only: tuple[str, ...]) -> Work:  # type: ignore[no-untyped-def]
    from elid_cli.diagnosis import DiagnoseOptions, diagnose
    from elid_cli.memory import keep_freed_memory
    from elid_cli.signals.options import SignalOptions
    from elid_cli.signals.signals import prepare

    keep_freed_memory()
    recording = made.recording(robot, 8.0, 500.0)
    signals = prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate))
    return lambda: diagnose(robot, signals, DiagnoseOptions(only=only))
