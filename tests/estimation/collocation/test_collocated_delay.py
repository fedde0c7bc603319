"""A torque delay that the default fit imagines is an unknown of the collocation, which puts it right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from elid_cli.estimation import default_fit as fitting
from elid_cli.estimation.collocation.estimator import Accurate, collocate
from elid_cli.estimation.identify import EstimateOptions, fit_log, identify
from elid_cli.estimation.regression.nuisances import DELAY
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.signals.signals import prepare
from tests.system.reproduce import coverage
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded
from tests.system.reproduce.unseen import arm

IMAGINED = 3e-4


def all_delays(
    observation: Any, solution: Any, extras: Sequence[ExtraColumns], *rest: Any, **more: Any
) -> list[ExtraColumns]:
    return [extra for extra in extras if extra.name == DELAY]


def test_a_delay_that_is_none_ends_at_none(monkeypatch: pytest.MonkeyPatch) -> None:
    made = make(2, 2, rate=500.0, duration=8.0)
    log = recorded(made, log_of(made, Laws()), db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=2)
    model = Regressor(made.robot)
    monkeypatch.setattr(fitting, "significant", all_delays)
    fit = fit_log(model, find_base(model), prepare(log, made.robot), EstimateOptions())
    delays = model.parameters + np.arange(made.robot.n)
    assert set(delays) <= set(fit.solution.basis)
    values = fit.solution.values.copy()
    values[delays] = IMAGINED
    answer = collocate(replace(fit, solution=replace(fit.solution, values=values)))
    assert isinstance(answer, Accurate)
    assert np.abs(answer.values[delays]).max() < 0.05 * IMAGINED


def test_a_delay_that_the_default_fit_cannot_see_bends_no_inertia() -> None:
    # half a sample by the motors' hold: without it in the collocation a rotor's inertia was six standard errors off
    robot = arm(24, 2)
    log = simulate(robot, SimulationOptions(duration=8.0, seed=24, rate=1000.0))
    signals = prepare(coverage.noisy(log, 80.0, 0.003, 0.0, 5), robot)
    usual, found = (identify(robot, signals, EstimateOptions(guards=False, accurate=a)) for a in (False, True))
    imagined = [n.parameters["delay"] for n in usual.nuisances if n.effect == DELAY]
    assert not imagined or max(abs(d - 0.5e-3) for d in imagined) > 0.1e-3
    told = {n.joint: n.parameters["delay"] for n in found.nuisances if n.effect == DELAY}
    assert set(told) == set(robot.joint_names)
    assert all(abs(delay - 0.5e-3) < 0.15e-3 for delay in told.values())
    scores = (found.estimate - found.reference) / found.std_error
    assert np.sqrt(np.nanmean(np.square(scores))) < 1.5
    assert np.nanmax(np.abs(scores)) < 3.5
