"""Fits of further effects: where no step leads on, they start again from what each recording says alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion import refits
from elid_cli.diagnosis.by_motion import search as search_module
from elid_cli.diagnosis.by_motion.candidates import Candidate
from elid_cli.diagnosis.by_motion.searched_log import SearchedLog
from elid_cli.diagnosis.by_motion.together import Kind
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects import effect_classes
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

STIFFNESS = 3.0


def test_a_motion_that_runs_away_with_an_effect_ends_no_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grip = lambda x, v, load: np.eye(3)[1] * 0.4 * np.exp(-np.abs(v) / 0.3)  # noqa: E731
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 5.0, grip=grip))
    robot = plant.robot(tmp_path)
    signals = prepare(read_recording([log], robot), robot)
    assert signals.recording is not None
    grown, tries = search_module.grown, list[int]()

    def away(fit: TrajectoryFit, effects, tell=None) -> TrajectoryFit:  # type: ignore[no-untyped-def]
        tries.append(len(effects))
        if len(tries) == 1:
            raise DataError("the simulated motion runs away from the measured one")
        return grown(fit, effects, tell)

    monkeypatch.setattr(search_module, "grown", away)
    runs, start = commanded_runs(signals.recording, robot), started_from(robot, signals)
    found = search_module.search(robot, runs, start, (), (), only=("stribeck", "quadratic_viscous"))
    assert len(tries) > 1
    assert not found.partial
    assert found.after.equations.lighter.sum() < 1.01 * found.before.equations.lighter.sum()


def test_an_effect_that_screening_promises_enough_of_is_tried_beside_one_that_it_prefers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction that holds is tried for less: another effect, of which more but not enough is promised, hid it."""
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 5.0))
    robot = plant.robot(tmp_path)
    signals = prepare(read_recording([log], robot), robot)
    assert signals.recording is not None
    fit = fit_trajectory(robot, commanded_runs(signals.recording, robot), started_from(robot, signals))
    library = effect_classes()
    preferred, holding = library["quadratic_viscous"](1, (2.0,)), library["stribeck"](1, (0.3, 1.0))

    def promised(*gains: float) -> list[search_module.Named]:
        of = [
            Candidate(effect, gain, 1.0, np.ones(1)) for effect, gain in zip((preferred, holding), gains, strict=True)
        ]
        monkeypatch.setattr(search_module, "best_of", lambda *of_views: of if of_views[0] else [])
        monkeypatch.setattr(search_module, "screened", lambda views, joint, kinds, effects: [joint] * (joint == 1))
        return search_module._best(fit, list(library.values()))[0]

    (named,) = promised(0.9 * search_module.LEAST, 1.5 * search_module.STUCK)
    assert named.effect is holding
    assert [rival.effect for rival in named.rivals] == [preferred]
    (named,) = promised(1.1 * search_module.LEAST, 1.5 * search_module.STUCK)
    assert named.effect is preferred
    assert not promised(0.9 * search_module.LEAST, 0.9 * search_module.STUCK)


def test_a_log_asks_a_fit_for_a_kind_of_change_once(tmp_path: Path) -> None:
    robot = plant.robot(tmp_path)
    log_file = plant.written(tmp_path, "log.h5", plant.moved(3, 5.0))
    signals = prepare(read_recording([log_file], robot), robot)
    assert signals.recording is not None
    runs = commanded_runs(signals.recording, robot)
    fit, asked = fit_trajectory(robot, runs, started_from(robot, signals)), list[TrajectoryFit]()
    effect = effect_classes()["payload"]

    def alone(near: TrajectoryFit) -> None:
        asked.append(near)

    kind = Kind(alone, lambda joints: NotImplemented)
    log = SearchedLog(signals, runs, ((), ()), (), None)
    assert log.ask(effect, kind, fit) is None
    log.ask(effect, kind, fit)
    assert len(asked) == 1
    log.ask(effect, kind, replace(fit))
    log.delivering(np.ones(robot.n)).ask(effect, kind, fit)  # other drives, another answer
    assert len(asked) == 3
    log.ask(effect, Kind(None, kind.of), replace(fit))
    assert len(asked) == 3


def test_an_effect_beside_which_no_step_leads_on_is_fitted_from_the_recordings_own_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 5.0, push=lambda x, v, load: np.eye(3)[1] * STIFFNESS * x))
    robot = plant.robot(tmp_path)
    signals = prepare(read_recording([log], robot), robot)
    assert signals.recording is not None
    fit = fit_trajectory(robot, commanded_runs(signals.recording, robot), started_from(robot, signals))
    again, starts = refits.again, list[np.ndarray]()

    def stays(fit: TrajectoryFit, unknowns, z, tell=None, cycles=refits.QUICK) -> TrajectoryFit:  # type: ignore[no-untyped-def]
        starts.append(z)
        return again(fit, unknowns, z, tell, 1 if len(starts) == 1 else cycles)

    monkeypatch.setattr(refits, "again", stays)
    found = refits.grown(fit, [effect_classes()["link_spring"](1, ())])
    assert len(starts) == 2
    assert found.equations.lighter.sum() < 0.01 * fit.equations.lighter.sum()
    assert found.z[found.unknowns.amplitudes_of(0)][0] == pytest.approx(STIFFNESS, rel=0.01)
