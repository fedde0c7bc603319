"""Standard errors beside a found effect whose shape came from the same log: they know that it is not known."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.logs.arrays import recording_of
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.one_pendulum import ROBOT

RATE, LENGTH, SEEDS, SEED = 250.0, 16.0, 24, 1000
COULOMB, VISCOUS = 4.0, 3.0
TRUTH = {"amplitude": 1.2, "phase": 1.0, "order": 1.3}
NOISE = 0.25
"""N·m: so much that the amplitude and the order are known to ten per cent, and no better."""


@cache
def found(seed: int) -> Diagnosis:
    """Return what is said of a log of a pendulum whose Coulomb friction varies with the angle, slowly."""
    t = np.arange(0.0, LENGTH, 1.0 / RATE)
    q, dq, ddq = (np.zeros(len(t)) for _ in range(3))
    for size, rate, phase in ((0.55, 0.31, 0.2), (0.4, 0.73, 1.1), (0.2, 1.37, 2.3)):
        w = 2 * np.pi * rate
        q += size * np.sin(w * t + phase)
        dq += size * w * np.cos(w * t + phase)
        ddq -= size * w**2 * np.sin(w * t + phase)
    direction = np.sign(dq)
    friction = COULOMB * direction + VISCOUS * dq
    friction += TRUTH["amplitude"] * np.sin(TRUTH["order"] * q + TRUTH["phase"]) * direction
    generator = np.random.default_rng(SEED + seed)
    tau = 0.8 * ddq + 9.81 * (1.5 * np.cos(q) - 0.2 * np.sin(q)) + friction + generator.normal(0.0, NOISE, len(t))
    angle = q + generator.normal(0.0, 1e-5, len(t))
    recording = recording_of(ROBOT, {"t": t, "q": angle[:, None], "tau": tau[:, None]})
    signals = prepare(recording, ROBOT, SignalOptions.for_diagnosis(RATE))
    told = diagnose(ROBOT, signals, DiagnoseOptions(only=("position_friction",)))
    assert isinstance(told, Diagnosis)
    return told


def apart(seed: int, name: str, truth: float) -> float:
    """Return by how many of its standard errors a base parameter is off."""
    (item,) = (item for item in found(seed).identified_after.parameters if item.name == name)
    return (item.estimate - truth) / item.std_error


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(("name", "truth"), [("fs1", COULOMB), ("fv1", VISCOUS)])
def test_friction_beside_a_found_shape_is_off_by_its_standard_errors(name: str, truth: float) -> None:
    z = [apart(seed, name, truth) for seed in range(SEEDS)]
    assert 0.7 < rms(z) < 1.35, z


@pytest.mark.parametrize("name", TRUTH)
def test_so_are_the_parameters_of_the_effect(name: str) -> None:
    effects = [effect for seed in range(SEEDS) for effect in found(seed).effects]
    assert len(effects) == SEEDS
    z = [(effect.parameters[name] - TRUTH[name]) / effect.std_error[name] for effect in effects]
    assert 0.7 < rms(z) < 1.35, z
