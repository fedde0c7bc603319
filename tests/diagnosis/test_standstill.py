"""A motor that slows down into sticking is no push from outside; a push is still one, then and at other times."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.diagnosis.residuals import standing
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, make, recorded

RATE, SLOWS, WITHIN = 500.0, 9.0, 1.5
"""Hz; the motion slows down from here on, s, and creeps after as many seconds more."""
STICKS = 0.02
"""rad/s below which friction gives way to what holds the joint anyway."""


def creeping(seed: int, n: int, *, rigid: bool) -> Made:
    """Return an arm whose motion slows down to rest at the end of the log."""
    made = make(seed, n, rate=RATE, duration=15.0)
    late = np.maximum(made.t - SLOWS, 0.0) / WITHIN
    pace = np.exp(-(late**3) / (1 + late**2))
    change = -pace * (3 * late**2 + late**4) / (1 + late**2) ** 2 / WITHIN
    path, passed = make_interp_spline(made.t, made.q, k=5), make_interp_spline(made.t, pace, k=5).antiderivative()
    q, slope, bend = (path(passed(made.t), derivative) for derivative in range(3))
    motion = {"q": q, "dq": slope * pace[:, None], "ddq": bend * pace[:, None] ** 2 + slope * change[:, None]}
    made = replace(made, **motion)
    if not rigid:
        return made
    stiff = [replace(j, parameters={**j.parameters, "K": 1e4 * j.parameters["K"]}) for j in made.truth.joints]
    bare = [replace(joint, transmission="rigid") for joint in made.robot.joints]
    return replace(made, truth=replace(made.truth, joints=tuple(stiff)), robot=replace(made.robot, joints=tuple(bare)))


def sticking(made: Made) -> Laws:
    """Return motors whose Coulomb friction vanishes as they come to rest."""
    coulomb = np.array([joint.parameters["fs"] for joint in made.truth.joints])

    def torque(world: World) -> np.ndarray:
        return -coulomb * np.sign(world.dtheta) * np.clip(1.0 - np.abs(world.dtheta) / STICKS, 0.0, 1.0)

    return Laws(motor=[torque])


def pushed(made: Made, joint: int, size: float, instant: float) -> Laws:
    """Return a push of `size` times a joint's Coulomb friction at one link."""
    height = size * made.truth.joints[joint].parameters["fs"]

    def torque(world: World) -> np.ndarray:
        push = np.zeros_like(world.q)
        push[:, joint] = height * np.exp(-(((world.t - instant) / 0.15) ** 2))
        return push

    return Laws(link=[torque])


def diagnosed(made: Made, laws: Laws, seed: int) -> Diagnosis:
    signals = log_of(made, laws)
    if not made.robot.elastic.any():
        signals["q"] = signals["theta"]
    log = recorded(made, signals, db=90.0, counts=2e5, torque=0.008, colour=0.0, seed=seed)
    options = DiagnoseOptions(only=("contact", "payload"))
    return diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)), options)


@pytest.mark.parametrize(("arm", "joints"), [(1, 1), (2, 1), (7, 1), (3, 2), (7, 2), (8, 2), (10, 2)])
def test_creeping_to_rest_is_neither_a_contact_nor_a_payload(arm: int, joints: int) -> None:
    made = creeping(arm, joints, rigid=True)
    assert diagnosed(made, sticking(made), arm).effects == ()


@pytest.mark.parametrize(
    ("arm", "rigid", "size", "instant"),
    [
        *((arm, rigid, 4.0, 11.2) for arm in (1, 2, 3, 7) for rigid in (True, False)),  # slowly, but in motion
        *((arm, True, 4.0, 14.0) for arm in (2, 5, 7)),  # at rest, stronger than what friction holds back
        (1, False, 1.0, 14.0),  # weaker than friction, but in the link's row and not in the motor's
        *((arm, False, 4.0, 14.0) for arm in (3, 5)),
    ],
)
def test_a_push_is_still_found_where_it_is_no_friction(arm: int, rigid: bool, size: float, instant: float) -> None:
    made = creeping(arm, 2, rigid=rigid)
    found = diagnosed(made, replace(sticking(made), link=pushed(made, 1, size, instant).link), arm)
    assert [(e.effect, e.joint) for e in found.effects] == [("contact", "j2")]
    assert found.effects[0].parameters["time"] == pytest.approx(instant, abs=0.05)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("stuck", [0.01, 0.02])
def test_friction_that_is_no_law_near_standstill_alone_is_not_unexplained(seed: int, stuck: float) -> None:
    found = _creeping_drive(seed, stuck, quadratic=0.0)
    assert {row.joint for row in found.rows_after if row.ratio > 3.0} == {"joint1"}
    assert (found.effects, found.unexplained) == ((), ())
    assert found.sufficient


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_what_is_missing_in_motion_as_well_is_still_unexplained(seed: int) -> None:
    found = _creeping_drive(seed, 0.01, quadratic=0.8)
    assert [item.joint for item in found.unexplained] == ["joint1"]


def _creeping_drive(seed: int, stuck: float, quadratic: float) -> Diagnosis:
    """Return what is said of a drive that starts and ends creeping, its friction below Coulomb's up to `stuck` rad/s.

    `quadratic` is friction that grows with the square of the speed, N·m·s²/rad²; the search does not try it.
    """
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 1.0 / 250.0)
    ramp = np.clip(np.minimum(t, 20.0 - t) / 2.5, 0.0, 1.0)
    tones = [(f, generator.uniform(0.15, 0.3), generator.uniform(0.0, 2.0 * np.pi)) for f in (0.17, 0.31, 0.53)]
    speed = ramp**4 * (0.02 + sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in tones)) + 0.004 * (1.0 - ramp)
    path = make_interp_spline(t, speed, k=5)
    position, bend = path.antiderivative()(t), path.derivative()(t)
    friction = 2.0 * np.tanh(2.0 * speed / stuck) + 1.0 * speed + quadratic * speed * np.abs(speed)
    torque = 0.25 * bend + friction
    position = position + generator.normal(0.0, 1e-5, len(t))
    torque = torque + generator.normal(0.0, 0.02, len(t))
    robot = Robot("turntable", (Joint("joint1", transmission="rigid"),))
    log = Recording(
        joints=robot.joint_names,
        dt=1.0 / 250.0,
        t=t,
        q=position[:, None],
        theta=position[:, None],
        tau=torque[:, None],
        segments=(Segment(0, len(t)),),
    )
    return diagnose(robot, prepare(log, robot, SignalOptions.for_diagnosis(250.0)), DiagnoseOptions(only=("contact",)))


def test_a_joint_whose_torque_is_never_known_has_no_standstill() -> None:
    """It crashed the diagnosis: a finger without efforts beside an arm that lacks Stribeck friction."""
    speed = np.linspace(-1.0, 1.0, 101)[:, None]
    signals = SimpleNamespace(motion=SimpleNamespace(dtheta=speed), outputs=slice(None))
    state: Any = SimpleNamespace(log=SimpleNamespace(signals=signals))
    assert standing(state, 0, np.ones(101, dtype=bool))[50]
    assert not standing(state, 0, np.zeros(101, dtype=bool)).any()
