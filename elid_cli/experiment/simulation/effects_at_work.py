"""Effects at work in a simulation: torques at one instant, internal states, altered robots (`model.effects.effect`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Columns, Effect
from elid_cli.model.effects.kinds import MemoryEffect, OscillatorEffect
from elid_cli.model.effects.scene import Scene, direction_widths
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion


def warm_up(t: float) -> float:
    """Return the motors' temperature (°C) at time t (s): 20 towards 50, two thirds of the way in ten minutes."""
    return 50.0 - 30.0 * math.exp(-t / 600.0)


class ActiveEffect:
    """One effect of a robot file with its amplitudes and, for effects with memory, its state."""

    def __init__(self, effect: Effect, coefficients: Array, values: Mapping[str, float]) -> None:
        self.effect = effect
        self.coefficients = coefficients
        self.values = values
        self._amplitudes: list[float] = coefficients.tolist()
        self._plain = not isinstance(effect, MemoryEffect | OscillatorEffect)
        self._state = 0.0
        self._drive: float | None = None

    def reset(self) -> None:
        """Begin anew: no memory."""
        self._state, self._drive = 0.0, None

    def torques(self, scene: Scene, state: Sequence[float]) -> list[tuple[str, int, float]]:
        """Return (side, joint, torque) of every row it acts on; `state` is an oscillator's."""
        effect = self.effect
        columns: Columns
        if self._plain:
            columns = effect.columns(scene)
        elif isinstance(effect, MemoryEffect):
            columns = effect.columns_of(scene, np.array([self._advanced(scene)]))
        else:
            assert isinstance(effect, OscillatorEffect)
            columns = effect.columns_of(scene, np.array(state)[:, None])
        if len(self._amplitudes) == 1:
            (amplitude,) = self._amplitudes
            return [(key.side, key.joint, amplitude * column.item()) for key, column in columns.items()]
        return [
            (key.side, key.joint, sum(c * v for c, v in zip(self._amplitudes, column[:, 0].tolist(), strict=True)))
            for key, column in columns.items()
        ]

    def accept(self, scene: Scene) -> None:
        """Keep the state that the step just taken has reached."""
        if isinstance(self.effect, MemoryEffect):
            self._state = self._advanced(scene)
            self._drive = float(self.effect.drive(scene)[0])

    def _advanced(self, scene: Scene) -> float:
        assert isinstance(self.effect, MemoryEffect)
        now = float(self.effect.drive(scene)[0])
        if self._drive is None:
            self._drive = now
        return self.effect.advance(self._state, self._drive, now)


class Stage:
    """A `Scene` of one instant whose arrays are overwritten at every evaluation."""

    def __init__(self, dynamics: Dynamics, dt: float, duration: float) -> None:
        n = dynamics.robot.n
        t, self._joint = np.zeros(1), np.zeros((9, 1, n))
        self._t = t
        self._temperature = np.full((1, n), warm_up(0.0))
        q, dq, ddq, theta, dtheta, ddtheta, tau, load, predicted = self._joint
        self.scene = Scene(
            robot=dynamics.robot,
            motion=Motion(t, q, dq, ddq, theta, dtheta, ddtheta),
            dt=dt,
            tau=tau,
            load=load,
            predicted=predicted,
            parameters=dynamics.parameters,
            duration=duration,
            stiffness=dynamics.stiffness,
            temperature=self._temperature,
            rounding=direction_widths(dynamics.robot),  # as without it, which would be sought at every instant
        )
        self._springs = [
            (k, K) for k, K in enumerate(np.nan_to_num(dynamics.stiffness).tolist()) if dynamics.robot.elastic[k]
        ]
        self._rest, self._load = [0.0] * n, [0.0] * n

    def set(
        self, t: float, q: list[float], dq: list[float], theta: list[float], dtheta: list[float], tau: list[float]
    ) -> Scene:
        """Return the scene at an instant; accelerations are 0 (not known yet)."""
        self._t[0] = t
        self._temperature[0] = warm_up(t)
        self.scene.cache.clear()
        for k, stiffness in self._springs:
            self._load[k] = stiffness * (theta[k] - q[k])
        # one assignment of all: each would take as long
        self._joint[:, 0] = (q, dq, self._rest, theta, dtheta, self._rest, tau, self._load, tau)
        return self.scene

    def through(self, joint: int, torque: float) -> None:
        """Add what an effect passes through a transmission beside the spring, N·m (N), to its load."""
        self._load[joint] += torque
        self._joint[7, 0, joint] = self._load[joint]

    def loaded(self, loads: list[float]) -> float:
        """Set the loads of rigid joints, and return by how much they changed, as a part of them."""
        before, self._load = self._load, list(loads)
        for k, _ in self._springs:
            self._load[k] = before[k]
        self._joint[7, 0] = self._load
        self.scene.cache.clear()
        change = max(abs(now - old) for now, old in zip(self._load, before, strict=True))
        return change / max(*map(abs, before), 1e-9)

    def accelerate(self, ddq: list[float], ddtheta: list[float]) -> Scene:
        """Return the scene with accelerations."""
        self._joint[2, 0], self._joint[5, 0] = ddq, ddtheta
        self.scene.cache.clear()
        return self.scene


def active_effects(robot: Robot, scene: Scene) -> list[ActiveEffect]:
    """Return the effects that a robot file declares, in its order.

    Raises
    ------
    RobotError
        An effect, joint or parameter that does not exist or does not fit.

    """
    return [_active(robot, spec, scene) for spec in robot.effects]


def _active(robot: Robot, spec: EffectSpec, scene: Scene) -> ActiveEffect:
    kind, joint = resolve(robot, spec)
    try:
        coefficients, shape = kind.coefficients(scene, joint, spec.parameters)
    except KeyError as problem:
        given = ", ".join(spec.parameters) or "none"
        raise RobotError(
            f"{robot.name}: effect {spec.effect}: needs {problem.args[0]!r}",
            detail=f"given: {given}",
            hint=f"it has {', '.join(kind.parameter_names())}",
        ) from None
    if kind.softens and shape[1] > 0:
        raise RobotError(
            f"{robot.name}: effect {spec.effect}: a simulation does not hold its {kind.shapes[1].name}",
            detail="friction that acts ahead of the speed follows the acceleration that it makes itself",
            hint=f"{kind.shapes[1].name}: 0; elid replay simulates it",
        )
    if kind.simulated == "loop":
        raise RobotError(
            f"{robot.name}: effect {spec.effect}: a simulation without commands has no position loop",
            hint="leave it out; elid replay simulates it, under the commands of a log",
        )
    effect = kind(joint, shape)
    coefficients = np.asarray(coefficients, dtype=float)
    return ActiveEffect(effect, coefficients, effect.named(scene, coefficients))
