"""Fixed-step integration (fourth-order Runge-Kutta) of a robot, its effects' states and its controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.experiment.simulation.effects_at_work import ActiveEffect, Stage
from elid_cli.experiment.simulation.exponential import ExactSprings
from elid_cli.experiment.simulation.kernel import Kernel
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects.kinds import OscillatorEffect
from elid_cli.model.effects.scene import Scene

Torque = Callable[[list[float], list[float]], list[float]]
"""Motor torques from (θ, θ') of all joints, at one instant."""

MODE_STEP = 1.0
"""Step in radians of the fastest elastic mode (stable below 2.8); that mode loses 0.7 % of its size per step,
slower ones hardly anything, since the loss falls with the sixth power."""
FRICTION_STEP = 1.5
"""Step in time constants of rounded friction (stable below 2.8)."""
LONGEST_STEP = 2.5e-4
"""s; a motor passes the rounded zone of friction in a few ms, which needs a few steps."""
LOADED, SETTLED = 4, 1e-7
"""Rounds in which the load of a rigid joint and the friction that follows it come to agree, and how closely."""
_NUDGE = 1e-6
"""rad or m, and per s: small against every width that friction and backlash are rounded over."""


class System:
    """State derivatives of a robot with effects.

    A state is a list: q (n), θ of elastic joints (m), their velocities (n + m), then the oscillators' states.
    """

    def __init__(self, dynamics: Dynamics, effects: Sequence[ActiveEffect], dt: float, duration: float) -> None:
        self.dynamics = dynamics
        n, elastic = dynamics.robot.n, dynamics.elastic
        self._n, self._m = n, len(elastic)
        self._motor = [n + elastic.index(k) if k in elastic else k for k in range(n)]
        self._elastic = elastic
        self._effects = [active for active in effects if active.effect.simulated == "torque"]
        self._stage = Stage(dynamics, dt, duration)
        spring = [a for a in self._effects if a.effect.place == "spring"]
        self._passing = spring if any(a.effect.from_model for a in self._effects) else []
        """Effects that add to the torque through a transmission, where friction follows that."""
        self._loaded = any(a.effect.from_model and a.effect.joint not in elastic for a in self._effects)
        self._places: list[tuple[int, int]] = []
        size = 2 * (n + self._m)
        for active in self._effects:
            count = active.effect.states if isinstance(active.effect, OscillatorEffect) else 0
            self._places.append((size, size + count))
            size += count
        self.size = size
        self._kernel: Kernel | None = None
        self._exact: ExactSprings | None = None
        self._last: tuple[list[float], list[float], list[float]] | None = None

    def reset(self) -> None:
        """Let effects with memory begin anew."""
        for active in self._effects:
            active.reset()

    def initial(self, q: Array, theta: Array) -> list[float]:
        """Return the state at rest at given positions, shape (n,)."""
        motors = [float(theta[k]) for k in self._elastic]
        return [*q.tolist(), *motors, *([0.0] * (self.size - self._n - self._m))]

    def split(self, x: list[float]) -> tuple[list[float], list[float], list[float], list[float]]:
        """Return (q, q', θ, θ') of all joints."""
        n, half = self._n, self._n + self._m
        return x[:n], x[half : half + n], [x[i] for i in self._motor], [x[half + i] for i in self._motor]

    def split_all(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return (q, q', θ, θ') of all joints for states in rows, each of shape (N, n)."""
        n, motors = self._n, np.array(self._motor)
        half = self._n + self._m
        return x[:, :n], x[:, half : half + n], x[:, motors], x[:, half + motors]

    def prepare(self, evaluations: int) -> None:
        """Make ready for so many evaluations of the dynamics: what has no effects runs as one function."""
        self._kernel = None if self._effects else Kernel(self.dynamics, evaluations)
        self._exact = self._last = None

    def hold(self, period: float, steps: int, accuracy: float) -> None:
        """Make ready for torques that are held over periods (s), for which classical steps must be so many.

        Where stiff modes or friction ask for more of them than everything else does, springs are taken exactly.
        """
        if self._kernel is not None and steps > math.ceil(period / LONGEST_STEP * accuracy):
            self._exact = ExactSprings(self.dynamics, self._kernel, period, accuracy)

    @property
    def longest(self) -> float | None:
        """The longest step where springs are taken exactly, s; else None."""
        return None if self._exact is None else self._exact.longest

    @property
    def looped(self) -> ExactSprings | None:
        """What follows a controller through many periods in one compiled loop, where there is such a thing."""
        return self._exact if self._kernel is not None and self._kernel.periods is not None else None

    def advance(self, t: float, h: float, steps: int, x: list[float], tau: list[float]) -> list[float]:
        """Return the state after some steps of h s with torques that are held."""
        if self._exact is not None and self._kernel is not None:
            known = self._last if self._last is not None and self._last[0] is x and self._last[1] is tau else None
            now = self._exact.advance(x, tau, self._kernel.accelerations(x, tau) if known is None else known[2])
            if all(map(math.isfinite, now)):
                return now
        if self._kernel is not None:
            now = list(self._kernel.advance(x, tau, h, steps))
            if all(map(math.isfinite, now)):
                return now  # else what follows says what is wrong

        def held(theta: list[float], dtheta: list[float]) -> list[float]:
            return tau

        for s in range(steps):
            x = self.step(t + s * h, h, x, (held, held, held))
        return x

    def derivative(self, t: float, x: list[float], torque: Torque) -> list[float]:
        """Return x' with torques from a controller."""
        _, _, theta, dtheta = self.split(x)
        tau = torque(theta, dtheta)
        ddq, ddtheta, rates = self.accelerations(t, x, tau)
        half = self._n + self._m
        return [*x[half : 2 * half], *ddq, *ddtheta, *rates]

    def accelerations(self, t: float, x: list[float], tau: list[float]) -> tuple[list[float], list[float], list[float]]:
        """Return (q'', θ'' of elastic joints, derivatives of the oscillators' states)."""
        if self._kernel is not None:
            found = list(self._kernel.accelerations(x, tau))
            if all(map(math.isfinite, found)):
                self._last = (x, tau, found)  # a step that begins here need not ask again
                return found[: self._n], found[self._n :], []
        q, dq, theta, dtheta = self.split(x)
        deflection = [a - b for a, b in zip(q, theta, strict=True)]
        if not self._effects:
            ddq, ddtheta = self.dynamics.solve(q, dq, dtheta, deflection, [0.0] * self._n, tau)
            return ddq, ddtheta, []
        scene = self._stage.set(t, q, dq, theta, dtheta, tau)
        for active in self._passing:
            for side, joint, value in active.torques(scene, x):
                if side == "motor":
                    self._stage.through(joint, value)
        ddq, ddtheta = self._solved(x, (q, dq, dtheta), scene, deflection, tau)
        for _ in range(LOADED if self._loaded else 0):
            # the load of a rigid joint is known with its acceleration, which friction that grows with it changes
            loads = self.dynamics.rigid_loads(q, dq, ddq)
            if self._stage.loaded(loads) < SETTLED:
                break
            ddq, ddtheta = self._solved(x, (q, dq, dtheta), scene, deflection, tau)
        return ddq, ddtheta, self._rates(x, ddq, ddtheta)

    def _solved(
        self,
        x: list[float],
        motion: tuple[list[float], list[float], list[float]],
        scene: Scene,
        deflection: list[float],
        tau: list[float],
    ) -> tuple[list[float], list[float]]:
        link, motor = [0.0] * self._n, list(tau)
        for active, (start, stop) in zip(self._effects, self._places, strict=True):
            for side, joint, value in active.torques(scene, x[start:stop]):
                if side == "link":
                    link[joint] -= value
                else:
                    motor[joint] -= value
        return self.dynamics.solve(*motion, deflection, link, motor)

    def _rates(self, x: list[float], ddq: list[float], ddtheta: list[float]) -> list[float]:
        if self.size == 2 * (self._n + self._m):
            return []
        full = list(ddq)
        for k, value in zip(self._elastic, ddtheta, strict=True):
            full[k] = value
        scene = self._stage.accelerate(ddq, full)
        rates: list[float] = []
        for active, (start, stop) in zip(self._effects, self._places, strict=True):
            if isinstance(active.effect, OscillatorEffect):
                rates += active.effect.rates(scene, np.array(x[start:stop])[:, None])[:, 0].tolist()
        return rates

    def step(self, t: float, h: float, x: list[float], torques: tuple[Torque, Torque, Torque]) -> list[float]:
        """Return the state after one step of h s; torques at its start, middle and end."""
        half = 0.5 * h
        k1 = self.derivative(t, x, torques[0])
        k2 = self.derivative(t + half, [a + half * b for a, b in zip(x, k1, strict=True)], torques[1])
        k3 = self.derivative(t + half, [a + half * b for a, b in zip(x, k2, strict=True)], torques[1])
        k4 = self.derivative(t + h, [a + h * b for a, b in zip(x, k3, strict=True)], torques[2])
        sixth = h / 6.0
        new = [a + sixth * (p + 2.0 * (q + r) + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)]
        if any(active.effect.memory for active in self._effects):
            q_, dq, theta, dtheta = self.split(new)
            scene = self._stage.set(t + h, q_, dq, theta, dtheta, torques[2](theta, dtheta))
            for active in self._effects:
                active.accept(scene)
        return new

    def transmitted(self, t: float, x: list[float], tau: list[float]) -> list[float]:
        """Return the torque through every transmission, N·m: spring and spring-path effects; NaN where rigid."""
        q, dq, theta, dtheta = self.split(x)
        if not self._effects:
            springs = zip(self.dynamics.stiffness.tolist(), theta, q, strict=True)
            return [K * (b - a) for K, b, a in springs]
        scene = self._stage.set(t, q, dq, theta, dtheta, tau)
        load = scene.load[0].tolist()
        for active, (start, stop) in zip(self._effects, self._places, strict=True):
            if active.effect.place == "spring":
                for side, joint, value in active.torques(scene, x[start:stop]):
                    load[joint] += value if side == "motor" else 0.0
        return [load[k] if k in self._elastic else math.nan for k in range(self._n)]


def reference_scene(dynamics: Dynamics, dt: float, duration: float) -> Scene:
    """Return a scene at rest at the origin, from which effects read the robot's parameters."""
    return Stage(dynamics, dt, duration).scene


def longest_step(system: System, positions: Array, accuracy: float = 1.0) -> float:
    """Return an integration step (s) that is stable and accurate near link positions (N, n); finer with `accuracy`.

    It follows from the eigenvalues of the linearised robot at rest, effects included: at rest rounded friction is
    steepest.
    """
    limits = [LONGEST_STEP]
    for q in positions:
        eigenvalues = np.linalg.eigvals(_jacobian(system, q))
        rates = np.abs(eigenvalues)
        swinging = np.abs(eigenvalues.imag) > 0.1 * rates
        limits += [MODE_STEP / float(rate) for rate in rates[swinging]]
        limits += [FRICTION_STEP / float(rate) for rate in rates[~swinging] if rate > 0]
    system.reset()
    return min(limits) / accuracy


def _jacobian(system: System, q: Array) -> Array:
    """Return d(x')/dx at rest at a position, by forward differences."""
    none = [0.0] * len(q)

    def rate(x: list[float]) -> Array:
        system.reset()
        system.derivative(0.0, base, lambda theta, dtheta: none)  # effects with memory begin at the base
        return np.array(system.derivative(0.0, x, lambda theta, dtheta: none))

    base = system.initial(q, q)
    still = rate(base)
    columns = []
    for k in range(system.size):
        x = list(base)
        x[k] += _NUDGE
        columns.append((rate(x) - still) / _NUDGE)
    return np.stack(columns, axis=1)
