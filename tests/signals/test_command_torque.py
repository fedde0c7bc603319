"""What commands make of a torque: the stairs of held commands, and what a delay moves."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.model.effects.shifts import Shifts, corrected
from elid_cli.signals.command_torque import at_limit, command_torque, held_mean, smoothed_stairs
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.one_pendulum import ROBOT

KP, KD, DT = 40.0, 1.5, 0.004


def commanded() -> Recording:
    """Return a log of commands that make a smooth torque."""
    t = DT * np.arange(3000)
    q = (0.5 * np.sin(1.1 * t) + 0.2 * np.sin(4.3 * t + 1))[:, None]
    q_des = q + 0.1 * np.sin(2.0 * (t[:, None] + DT / 2) + 0.4)
    gains = {"kp": np.full_like(q, KP), "kd": np.full_like(q, KD)}
    dq = np.gradient(q, DT, axis=0)
    tau = KP * (held_mean(q_des, [(0, len(t))]) - q) - KD * dq
    return Recording(("j",), DT, t, q, q, tau, dq=dq, commands={"q_des": q_des, **gains},
                     segments=(Segment(0, len(t)),), sources={"tau": "command"})  # fmt: skip


@pytest.mark.parametrize("hertz", [1.0, 3.0, 6.0])
def test_stairs_below_the_sample_rate(hertz: float) -> None:
    t = DT * np.arange(2000)
    command = np.sin(2 * np.pi * hertz * t)[:, None]
    stairs = smoothed_stairs(held_mean(command, [(0, 2000)]), [(0, 2000)])[5:-5, 0]
    # held samples are the command times sinc(f dt), half a sample later
    expected = np.sinc(hertz * DT) * np.sin(2 * np.pi * hertz * (t - DT / 2))[5:-5]
    assert np.abs(stairs - expected).max() < (np.pi * hertz * DT) ** 4 / 4


def test_stretches_do_not_reach_into_each_other() -> None:
    command = np.r_[np.zeros(10), np.ones(10)][:, None]
    bounds = [(0, 10), (10, 20)]
    assert np.array_equal(smoothed_stairs(held_mean(command, bounds), bounds), command)
    assert np.array_equal(smoothed_stairs(held_mean(command[:3], [(0, 3)]), [(0, 3)]), command[:3])


def test_a_logged_torque_is_told_as_a_whole() -> None:
    log = commanded()
    tau, told = command_torque(Recording(("j",), DT, log.t, log.q, log.q, log.tau, segments=log.segments))
    assert told is None
    assert tau is log.tau


def test_a_delay_moves_the_commands_and_leaves_the_positions() -> None:
    signals = prepare(commanded(), ROBOT)
    late = 2.5 * DT
    moved = corrected(signals, Shifts.none(1).moved("torque", 0, late))
    assert signals.command_torque is not None
    assert moved.command_torque is not None
    inner = slice(20, -20)
    t = signals.motion.t
    later = np.interp(t - late, t, signals.command_torque[:, 0])
    assert moved.command_torque[inner, 0] == pytest.approx(later[inner], abs=2e-3)
    at_once = signals.tau - signals.command_torque
    assert np.abs(moved.tau - moved.command_torque - at_once).max() < 1e-12


def test_torques_at_a_limit() -> None:
    tau = np.array([[1.0, 5.0], [5.0, 2.0], [-5.0, 1.0], [np.nan, 3.0]])
    assert at_limit(tau).tolist() == [[False, False], [True, False], [True, False], [False, False]]
