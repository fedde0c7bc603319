"""Before a lower cut-off is tried on all of a long log, a part of it is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation import cutoff
from elid_cli.estimation.cutoff import HINT
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.identify import EstimateOptions, fit_log, identify
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded

ARM, RATE, ONCE, TIMES = 301, 500.0, 12.0, 5
WHOLE = ONCE * TIMES


def logged(db: float, torque: float) -> tuple[Robot, Recording]:
    """Return an arm and a minute of its motion, one of 12 s five times over, with noise on positions and torque."""
    made = make(ARM, 2, rate=RATE, duration=ONCE)
    samples = len(made.t)
    signals = {name: np.tile(values, (TIMES, 1)) for name, values in log_of(made, Laws()).items()}
    longer = replace(made, t=np.arange(TIMES * samples) / RATE)
    log = recorded(longer, signals, db=db, counts=0.0, torque=torque, colour=0.0, seed=ARM)
    return made.robot, replace(log, segments=tuple(Segment(k * samples, (k + 1) * samples) for k in range(TIMES)))


def asked(
    monkeypatch: pytest.MonkeyPatch, hint: int, db: float, torque: float
) -> tuple[float, list[tuple[float, ...]]]:
    """Return the cut-off chosen, and duration and cut-off of every fit on the way."""
    fits: list[tuple[float, ...]] = []

    def seen(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> DefaultFit:
        fits.append((signals.duration, signals.filter.cutoff))
        return fit_log(model, base, signals, options)

    monkeypatch.setattr(cutoff, "HINT", hint)
    monkeypatch.setattr(cutoff, "fit_log", seen)
    robot, log = logged(db, torque)
    found = identify(robot, prepare(log, robot), EstimateOptions(guards=False))
    return float(found.settings["cutoff"]), fits


def test_noisy_positions_still_lower_the_cut_off_of_a_long_log(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen, fits = asked(monkeypatch, 4000, db=90.0, torque=0.0)
    assert fits[:4] == [(pytest.approx(24.0), 7.0), (pytest.approx(24.0), 10.0), (WHOLE, 10.0), (WHOLE, 7.0)]
    assert chosen < 7.0
    assert chosen == asked(monkeypatch, HINT, db=90.0, torque=0.0)[0]


def test_where_a_part_says_no_the_whole_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen, fits = asked(monkeypatch, 4000, db=130.0, torque=0.01)
    assert chosen == 10.0
    assert fits == [(pytest.approx(24.0), 7.0), (pytest.approx(24.0), 10.0), (WHOLE, 10.0)]


def test_a_log_that_is_not_long_is_asked_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen, fits = asked(monkeypatch, HINT, db=130.0, torque=0.01)
    assert chosen == 10.0
    assert fits == [(WHOLE, 10.0), (WHOLE, 7.0)]


def test_a_part_that_is_too_little_decides_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cutoff, "SHORTEST", 0.3)  # a lower cut-off's filter is longer
    chosen, fits = asked(monkeypatch, 800, db=90.0, torque=0.0)
    assert fits[:2] == [(WHOLE, 10.0), (WHOLE, 7.0)]
    assert chosen < 7.0
