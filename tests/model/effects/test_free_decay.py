"""Oscillators in logs that start in motion: the free decay is told by the torque."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import DiagnoseOptions, diagnose
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.estimation.identify import identify
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.free_decay import decaying, missing_torque
from elid_cli.model.effects.library.flexible_mode import FlexibleMode
from elid_cli.model.effects.library.link_spring import LinkSpring
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.model.effects.effect_scenes import DT, planar, scene_of, torque_of

SHAPE, INERTIA = (9.0, 0.03), 0.4
STEP, LENGTH, GAP = 2.5e-3, 8000, slice(4000, 4240)


def rigid() -> Robot:
    return replace(planar(), joints=tuple(replace(joint, transmission="rigid") for joint in planar().joints))


def brisk_motion(robot: Robot) -> Motion:
    """Return sums of sines up to 4 Hz, in full swing from the first sample on."""
    generator, t = np.random.default_rng(3), STEP * np.arange(LENGTH)
    q, dq, ddq = np.zeros((3, LENGTH, robot.n))
    for j in range(robot.n):
        for w in 2 * np.pi * generator.uniform(0.2, 4.0, 8):
            size, phase = 4.0 / w**1.5, generator.uniform(0, 6.28)
            q[:, j] += size * np.sin(w * t + phase)
            dq[:, j] += size * w * np.cos(w * t + phase)
            ddq[:, j] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, dq, ddq, q, dq, ddq)


def swinging(shape: tuple[float, float], push: np.ndarray, dt: float, start: complex) -> np.ndarray:
    """Return the torque of a mode of inertia 1 whose y of y' = pole y + push has the value `start` at first, (N,)."""
    mode = FlexibleMode(0, shape)
    step = complex(np.exp(mode.pole * dt))
    whole, ramp = (step - 1) / mode.pole, (step - 1 - mode.pole * dt) / (mode.pole**2 * dt)
    driven = ramp * push + 0j
    driven[1:] += (whole - ramp) * push[:-1]
    driven[0] = start
    y = decaying(step, driven)
    z, dz = -y.imag / mode.pole.imag, -(mode.pole * y + push).imag / mode.pole.imag
    omega = 2 * np.pi * shape[0]
    return np.asarray(-(omega**2 * z + 2 * shape[1] * omega * dz))


@cache
def log() -> Recording:
    """Return a log with a gap, whose second link carries a mode that swings before the log begins."""
    robot, generator = rigid(), np.random.default_rng(5)
    motion = brisk_motion(robot)
    tau = torque_of(robot, motion, np.nan_to_num(robot.reference()), np.sign(motion.dq)).sum(axis=0)
    tau[:, 1] += INERTIA * swinging(SHAPE, motion.ddq[:, 1], STEP, 1.5 - 1.0j)
    q = motion.q + 1e-6 * generator.standard_normal(motion.q.shape)
    tau += 0.02 * generator.standard_normal(tau.shape)
    left = np.delete(np.arange(LENGTH), np.arange(GAP.start, GAP.stop))
    parts = Segment(0, GAP.start), Segment(GAP.start, len(left))
    return Recording(robot.joint_names, STEP, motion.t[left], q[left], q[left], tau[left], segments=parts)


def check(values: dict[str, float], errors: dict[str, float]) -> None:
    assert abs(values["inertia"] - INERTIA) < 3 * errors["inertia"] < 0.1 * INERTIA
    assert abs(values["frequency"] / SHAPE[0] - 1) < 5e-3
    assert abs(values["damping"] / SHAPE[1] - 1) < 0.1


def test_identification_finds_a_mode_that_swings_when_segments_start() -> None:
    start = {"frequency": 8.0, "damping": 0.02}
    robot = replace(rigid(), effects=(EffectSpec("flexible_mode", "joint2", start),))
    found = identify(robot, prepare(log(), robot, SignalOptions(cutoff=20.0)))
    (mode,) = found.effects
    check(dict(mode.parameters), dict(mode.std_error))
    off = [(p.estimate - p.reference) / p.std_error for p in found.parameters if p.verdict == "supported"]
    assert len(off) > 5
    assert np.max(np.abs(off)) < 4


def test_diagnosis_names_a_mode_that_swings_when_segments_start() -> None:
    found = diagnose(
        rigid(), prepare(log(), rigid(), SignalOptions(cutoff=20.0)), DiagnoseOptions(only=("flexible_mode",))
    )
    assert isinstance(found, Diagnosis)
    (mode,) = found.effects
    assert mode.joint == "joint2"
    check(dict(mode.parameters), dict(mode.std_error))
    assert abs(mode.parameters["frequency"] - SHAPE[0]) < 4 * mode.std_error["frequency"]


def starts_of(scene: Scene) -> list[int]:
    return [*sorted({0, *scene.starts}), scene.samples]


def swinging_scene(starts: tuple[int, ...] = (0, 1200)) -> tuple[Scene, np.ndarray]:
    """Return a scene whose torque holds a mode that swings in every segment, and the torque of the mode."""
    scene = replace(scene_of(planar()), starts=starts)
    push, torque = scene.motion.ddq[:, 0], np.zeros(scene.samples)
    for number, (first, last) in enumerate(pairwise(starts_of(scene))):
        torque[first:last] = swinging(SHAPE, push[first:last], DT, (0.3 - 0.5j) * (-1.0) ** number)
    tau = np.array(scene.predicted)
    tau[:, 0] += INERTIA * torque
    return replace(scene, tau=tau, cache={}), torque


def column_of(scene: Scene, shape: tuple[float, float] = SHAPE) -> np.ndarray:
    return np.asarray(FlexibleMode(0, shape).columns(scene)[EquationRow("link", 0)][0])


@pytest.mark.parametrize("starts", [(0,), (0, 1200), (0, 700, 1500, 1502, 1503)])
def test_every_segment_starts_as_its_torque_shows(starts: tuple[int, ...]) -> None:
    scene, torque = swinging_scene(starts)
    long = np.concatenate([np.arange(a, b) for a, b in pairwise(starts_of(scene)) if b - a > 10])
    np.testing.assert_allclose(column_of(scene)[long], torque[long], atol=1e-2 * np.abs(torque).max())


def test_nothing_is_guessed_where_the_torque_shows_no_mode() -> None:
    scene, _ = swinging_scene()
    alone = column_of(replace(scene, tau=scene.predicted, cache={}))
    noise = 0.3 * np.random.default_rng(0).standard_normal(scene.tau.shape)
    other, told = np.zeros_like(scene.predicted), -scene.tau
    for tau, predicted in ((scene.predicted + noise, scene.predicted), (scene.tau, other), (told, scene.predicted)):
        same = column_of(replace(scene, tau=tau, predicted=predicted, cache={}))
        assert np.mean((same - alone) ** 2) < 0.02 * np.mean(alone**2)
    np.testing.assert_allclose(column_of(replace(scene, predicted=other, cache={})), alone)


def test_a_swing_that_is_logged_late_starts_at_its_own_phase() -> None:
    scene, torque = swinging_scene((0,))
    delay, t = 2e-3, scene.motion.t
    logged = np.stack([np.interp(t - delay, t, values) for values in scene.tau.T], axis=1)
    scene = replace(scene, tau=logged, cache={})
    # W p = u - delay du/dt: the nuisance's coefficient is negative where the torque is logged late
    corrected = column_of(replace(scene, late=np.full(scene.robot.n, -delay), cache={}))
    first = slice(5, 600)
    off, rough = (float(np.sqrt(np.mean((c - torque)[first] ** 2))) for c in (corrected, column_of(scene)))
    assert off < 0.3 * rough


def test_what_other_effects_explain_is_no_free_decay() -> None:
    scene, torque = swinging_scene()
    spring, second = LinkSpring(0), FlexibleMode(0, (17.0, 0.02))
    others: list[tuple[Effect, np.ndarray]] = [(spring, np.array([30.0, -12.0])), (second, np.array([0.2]))]
    added = np.zeros_like(scene.tau)
    for effect, linear in others:
        rows = effect.columns(replace(scene, tau=scene.predicted, cache={}))
        added[:, 0] += linear @ rows[EquationRow("link", 0)]
    full = replace(scene, tau=scene.tau + added, found=others, cache={})
    np.testing.assert_allclose(column_of(full), torque, atol=0.03 * np.abs(torque).max())
    # the mode's own former shape is no other effect, whether or not its torque is predicted already
    mine = [*others, (FlexibleMode(0, (9.3, 0.02)), np.array([INERTIA]))]
    np.testing.assert_array_equal(column_of(replace(full, found=mine, cache={})), column_of(full))
    whole = replace(full, found=mine, predicted=full.tau, alone=full.predicted, cache={})
    np.testing.assert_array_equal(column_of(whole), column_of(full))
    np.testing.assert_allclose(missing_torque(full, 0, others[:1]), (scene.tau + added - scene.predicted)[:, 0]
                               - others[0][1] @ spring.columns(full)[EquationRow("link", 0)])  # fmt: skip
