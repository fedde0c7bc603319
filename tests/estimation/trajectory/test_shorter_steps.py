"""Where a fit looks at what shorter steps change, neither equations nor motion are computed twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.trajectory import normal_equations
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.normal_equations import Tracked, refine, simulated
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns, started
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.model.linearised import Linearised
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant


def test_a_motion_that_is_known_is_not_simulated_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 2.0))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    recording = read_recording([log], robot)
    start = started_from(robot, prepare(recording, robot))
    (run,) = commanded_runs(recording, robot)
    unknowns, equations = Unknowns(robot, (), 1, 0), Linearised(robot, without=PARAMETERS)
    z, parameters = started(unknowns, start, ()), robot.reference()
    item, linearised, motions = Tracked.of(run), [], []
    about, stepped = equations.about, normal_equations.stepped
    simulated(equations, item, unknowns, z, parameters, plain=True)
    item.local = None
    monkeypatch.setattr(equations, "about", lambda *of: (linearised.append(of), about(*of))[1])
    monkeypatch.setattr(normal_equations, "stepped", lambda *of, **how: (motions.append(of), stepped(*of, **how))[1])
    refine(equations, item, unknowns, z, parameters)
    assert len(linearised) == 1
    assert len(motions) == 2
    alone, other = replace(item, coming=None, local=None), replace(item)
    known = simulated(equations, item, unknowns, z, parameters, plain=True, rounds=1)
    assert (len(linearised), len(motions)) == (1, 2)
    anew = simulated(equations, alone, unknowns, z, parameters, plain=True, rounds=1)
    assert (len(linearised), len(motions)) == (2, 3)
    np.testing.assert_array_equal(known.error, anew.error)
    np.testing.assert_array_equal(item.x, alone.x)
    np.testing.assert_array_equal(item.v, alone.v)
    # of other unknowns it is not the same motion
    simulated(equations, other, unknowns, z * 1.01, parameters, plain=True, rounds=1)
    assert len(motions) == 4
