"""Drives whose torque chatters: what is missing is judged by what is left, and not by the chatter."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.signals.signals import prepare
from tests.estimation.test_unsaid_causes import made_rigid
from tests.system.reproduce.inverse_logs import Laws, World, log_of, recorded


def _stribeck(speed: Array, torque: Array) -> Array:
    return np.asarray(0.05 * np.std(torque) * np.tanh(speed / 0.005) * np.exp(-((speed / 0.15) ** 2)))


def _load(speed: Array, torque: Array) -> Array:
    return np.asarray(0.05 * np.abs(torque) * np.tanh(speed / 0.005))


def _diagnosed(seed: int, joint: int, law: str | None) -> Diagnosis:
    """Diagnose three rigid joints whose drives chatter above the motion's frequencies, one with an effect."""
    laws = {"stribeck": _stribeck, "load_friction": _load}

    def read(_: World, signals: dict[str, Array]) -> None:
        tau, speed = signals["tau"], np.gradient(signals["q"], 1 / 250.0, axis=0)
        if law:
            tau[:, joint] += laws[law](speed[:, joint], tau[:, joint])
        for k in range(tau.shape[1]):
            tau[:, k] += 0.5 * np.diff(np.random.default_rng(k).normal(size=len(tau) + 2), 2)

    made = made_rigid(seed)
    log = recorded(made, log_of(made, Laws(sensors=[read])), db=0.0, counts=2.0**16, torque=1e-4, colour=0.0, seed=1)
    told = diagnose(made.robot, prepare(log, made.robot))
    assert isinstance(told, Diagnosis)
    return told


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drive_that_chatters_lacks_nothing(seed: int) -> None:
    told = _diagnosed(seed, 0, None)
    assert told.effects == ()
    assert told.unexplained == ()


def test_what_is_far_below_the_chatter_is_found() -> None:
    told = _diagnosed(2, 2, "stribeck")
    assert [(e.effect, e.joint) for e in told.effects] == [("stribeck", "j3")]
    assert told.effects[0].parameters["velocity"] == pytest.approx(0.15, rel=0.02)


def test_what_only_looks_like_it_beside_the_chatter_is_not_named() -> None:
    told = _diagnosed(2, 2, "load_friction")
    assert not {e.effect for e in told.effects} - {"load_friction"}
    assert told.effects or any(item.joint == "j3" for item in told.unexplained)
