"""The motor side's equations over an unknown motion of the links: residuals and their derivatives.

The links' motion is a quintic spline of unknown coefficients C (knots, n); what else is unknown is the vector x
(`Unknowns`). Residuals are of the two signals that were measured, each over its own noise:

    θ - (q + c (s - T s' + T² s'') + b tanh(s / s0)),    τ(t - d) - (J (θ'' + a) + fv θ' + friction + s + offset)

and what sensors on links measure (`link_sensors`), rows beside those of the torques;
with s = what the link side needs of the transmission and θ in the motor's row as the first equation gives it. Both are
regular at c = 0, a rigid joint. Torque rows are low-passed: friction's kinks and the spline's errors live above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import Mounted
from elid_cli.estimation.motor_side.link_side import LinkSide, LinkTerms
from elid_cli.estimation.motor_side.motor_log import STRIBECK_WIDTHS, MotorLog
from elid_cli.estimation.motor_side.operators import SHORT_WIDTH, WIDTH, KnotSpline, low_pass_rows
from elid_cli.estimation.motor_side.pieces import Pieces
from elid_cli.estimation.motor_side.unknowns import RotorPrior, Unknowns, prior_of
from elid_cli.model.link_vectors import Slopes

PARTS = ("load", "bumps", "lost")
"""Unknowns that are in the model only where they are asked for."""
POSITIONS, TORQUES = 8, 20
"""Samples that a group of position rows, and of torque rows, spans."""
_LOAD_ROUNDING = 0.01
"""Torque within which |s| is rounded off, share of the joint's torque."""
_GEARED, _DEEPEST = 30.0, 2
"""Gear ratios from which on derivatives follow no more rotors in a row than that: each counts for less by its ratio."""


@dataclass(frozen=True)
class Friction:
    """A further friction of one joint: tanh(v / width), exp'd below a speed or growing with the square of the speed."""

    joint: int
    kind: str
    """``bump``, ``square`` or ``wide``."""
    speed: float
    """Speed of a bump's decay, or friction's width, rad/s (m/s)."""
    width: float

    def values(self, v: Array) -> Array:
        """Return the friction per unit of its amplitude at speeds v."""
        found: Array
        if self.kind == "square":
            found = v * np.abs(v)
        elif self.kind == "wide":
            found = np.tanh(v / self.speed)
        else:
            found = np.tanh(v / self.width) * np.exp(-((v / self.speed) ** 2))
        return found


@dataclass(frozen=True)
class Model:
    """What the unknowns mean at the log's samples, (N, n) each."""

    q: tuple[Array, Array, Array]
    terms: LinkTerms
    spring: Array
    """s, N·m."""
    lagged: Array
    """s - T s' + T² s''."""
    theta: Array
    speed: Array
    acceleration: Array
    sign: Array
    """Friction's smooth sign."""
    rounded: Array
    """|s|, rounded off at zero; empty without load friction."""
    bumps: Array
    """Stribeck bumps, (bumps, N, n); empty without."""
    tau: Array
    felt: tuple[Slopes, ...]
    """What the sensors on links feel in the links' frames, of every kind."""
    sensed: Array
    """What they measure, kind by kind, (N, 3 m)."""


class Latent:
    """The residuals of one log.

    Parameters
    ----------
    log, unknowns
        The log and what is unknown beside the links' motion.
    spacing
        Distance of knots, s.
    rotors
        What is known of the rotors.
    parts
        Which of `PARTS` are in the model.
    lost_scale
        Torque s0 over which lost motion is passed, N·m, (n,).
    further
        Further frictions.
    """

    def __init__(
        self,
        log: MotorLog,
        unknowns: Unknowns,
        spacing: float,
        rotors: RotorPrior,
        parts: Sequence[str] = (),
        lost_scale: Array | None = None,
        further: Sequence[Friction] = (),
    ) -> None:
        self.log, self.unknowns, self.spacing, self.rotors = log, unknowns, spacing, rotors
        self.link: LinkSide = unknowns.link
        self.parts, self.further = tuple(parts), tuple(further)
        self.lost_scale = np.ones(log.n) if lost_scale is None else lost_scale
        self.spline = log.kept(("spline", spacing), lambda: KnotSpline(log.t, spacing))
        self.prior_mean, self.prior_spread = prior_of(unknowns, rotors, log.torque, log.samples.sensors)
        self.rounding = _LOAD_ROUNDING * log.torque
        self.levels = self.link.levels if self.link.ratio.min() < _GEARED else min(self.link.levels, _DEEPEST)
        """How many rotors whose deflections load the next one in a row the derivatives follow."""
        reach = self._reach(SHORT_WIDTH // 2)
        self.positions = log.kept(
            ("positions", spacing), lambda: Pieces(self.spline, np.arange(log.count), reach, POSITIONS)
        )
        """The position rows."""
        self.rows: Any
        self.centres: NDArray[np.intp]
        self.kernel: Array
        """Weights of every row of the low-pass, an odd number."""
        self.tau_noise: Array
        """Of the low-passed rows, (n + 3 m,)."""
        self.torques: Pieces
        """The low-passed rows: torques, then sensors on links."""

    def filter_torque(self, cutoff: float, floor: float) -> None:
        """Low-pass the torque rows at `cutoff`, Hz; their noise is at least `floor`, a share of the torque.

        That of sensors on links is at least their `Kind`'s part of it.
        """
        log = self.log
        self.rows, gain, self.centres = log.kept(("rows", cutoff), lambda: low_pass_rows(log.count, log.dt, cutoff))
        self.kernel = self.rows.data[: self.rows.indptr[1]]
        reach = self._reach(len(self.kernel) // 2 + WIDTH // 2 + SHORT_WIDTH // 2)
        self.torques = log.kept(
            ("torques", self.spacing, cutoff), lambda: Pieces(self.spline, self.centres, reach, TORQUES)
        )
        torques = np.hypot(log.tau_noise * gain, floor * log.torque)
        sensors = np.hypot(log.sensed_noise * gain, floor * log.sensed_size)
        self.tau_noise = np.concatenate([torques, sensors])

    def _reach(self, own: int) -> int:
        """Return how many samples to either side a row reaches that touches so many of its transmission's torque."""
        return own + self.levels * (WIDTH // 2 + SHORT_WIDTH // 2)

    # ---- the model

    def lag(self, spring: Array, damping: Array | float) -> Array:
        """Return s - T s' + T² s'': the deflection over the compliance, with a damper beside the spring."""
        first, second = self.log.short_rates
        found: Array = spring - damping * (first @ spring) + damping**2 * (second @ spring)
        return found

    def _transmissions(self, q: tuple[Array, Array, Array], x: Array) -> tuple[LinkTerms, Array, Array, Array]:
        """Return the link side, s, its lagged form and θ: from the tips on, as rotors load the links below."""
        at, (first, second) = self.unknowns.places, self.log.rates
        c, damping, lost, J = x[at["c"]], x[at["damping"]], x[at["lost"]], x[at["J"]]
        terms = self.link.terms(*q)
        spring = terms.columns @ x[at["p"]]
        if not len(terms.by_speed):
            lagged = self.lag(spring, damping)
            return terms, spring, lagged, q[0] + c * lagged + lost * np.tanh(spring / self.lost_scale)
        theta, lagged = q[0].copy(), np.zeros_like(spring)
        for i in reversed(range(self.log.n)):
            for j in self.link.behind[i]:
                deflection = theta[:, j] - q[0][:, j]
                spring[:, i] += J[j] * terms.by_speed[:, i, j] * (q[1][:, j] + first @ deflection)
                spring[:, i] += J[j] * terms.by_acceleration[:, i, j] * (q[2][:, j] + second @ deflection)
            lagged[:, i] = self.lag(spring[:, i], damping[i])
            theta[:, i] += c[i] * lagged[:, i] + lost[i] * np.tanh(spring[:, i] / self.lost_scale[i])
        return terms, spring, lagged, theta

    def model(self, coefficients: Array, x: Array) -> Model:
        """Return what coefficients (knots, n) and unknowns mean."""
        at, (first, second) = self.unknowns.places, self.log.rates
        B = self.spline.matrices
        q = B[0] @ coefficients, B[1] @ coefficients, B[2] @ coefficients
        terms, spring, lagged, theta = self._transmissions(q, x)
        speed, acceleration = first @ theta, second @ theta
        sign = self.log.direction(speed, acceleration)
        tau = x[at["J"]] * (acceleration + terms.carried) + x[at["fv"]] * speed + x[at["fs"]] * sign
        tau += spring + x[at["offset"]]
        rounded, bumps = np.zeros((0, self.log.n)), np.zeros((0, 0, self.log.n))
        if "load" in self.parts:
            rounded = np.hypot(spring, self.rounding)
            tau += x[at["load"]] * sign * rounded
        if "bumps" in self.parts:
            bumps = self.log.bumps(speed, acceleration)
            tau += (self._bump_sizes(x) * bumps).sum(axis=0)
        for amplitude, friction in zip(x[at["further"]], self.further, strict=True):
            tau[:, friction.joint] += amplitude * friction.values(speed[:, friction.joint])
        felt, sensed = self._sensors(q, x)
        return Model(q, terms, spring, lagged, theta, speed, acceleration, sign, rounded, bumps, tau, felt, sensed)

    def _bump_sizes(self, x: Array) -> Array:
        found: Array = x[self.unknowns["bumps"]].reshape(len(STRIBECK_WIDTHS), 1, -1)
        return found

    def friction_slopes(self, now: Model, x: Array) -> Array:
        """Return derivatives of all friction by the motor's speed and acceleration, (2, N, n).

        The latter is there as a sample averages over where friction changes its sign.
        """
        at = self.unknowns.places
        size = x[at["fs"]] + x[at["load"]] * now.rounded if len(now.rounded) else x[at["fs"]]
        found: Array = size * self.log.direction_slopes(now.speed, now.acceleration)
        found[0] += x[at["fv"]]
        if len(now.bumps):
            found += (self._bump_sizes(x) * self.log.bump_slopes(now.speed, now.acceleration)).sum(axis=1)
        return found

    def _sensors(self, q: tuple[Array, Array, Array], x: Array) -> tuple[tuple[Slopes, ...], Array]:
        """Return what sensors on links feel, of every kind, and what they measure, (N, 3 m)."""
        felt, seen = [], []
        for kind in self.link.sensed:
            own = x[self.unknowns[kind.kind.name]]
            felt.append(kind.felt(q, own))
            seen.append(kind.measured(felt[-1], own, self.log.short_rates))
        return tuple(felt), np.concatenate(seen, axis=1)

    def mounted(self, x: Array) -> list[Mounted]:
        """Return how the sensors on links are mounted, of every kind."""
        return [kind.split(x[self.unknowns[kind.kind.name]]) for kind in self.link.sensed]

    def residual(self, coefficients: Array, x: Array) -> tuple[Array, Array, Model]:
        """Return residuals over their noise, of positions (N, n) and low-passed rows (rows, n + 3 m), and the model."""
        now = self.model(coefficients, x)
        acts = self.log.torque_at(float(x[self.unknowns["delay"][0]]))
        theta = (self.log.theta - now.theta) / self.log.theta_noise
        low = np.concatenate([acts - now.tau, self.log.sensed - now.sensed], axis=1)
        return theta, (self.rows @ low) / self.tau_noise, now

    # ---- derivatives

    def on_knots(self, slopes: Array) -> Array:
        """Return sum over d of slopes[d] (N, n) times the d-th derivatives of the six basis values, (N, 6 n)."""
        values = self.log.kept(("values", self.spacing), lambda: np.stack([self.spline.values(d) for d in range(3)], 2))
        found: Array = (values[:, :, : len(slopes)] @ slopes.transpose(1, 0, 2)).reshape(self.log.count, -1)
        return found

    def lost_slope(self, now: Model, x: Array, joint: int) -> Array:
        """Return the derivative of lost motion by the torque through a transmission, (N,)."""
        s0, size = self.lost_scale[joint], x[self.unknowns["lost"][joint]]
        found: Array = size * (1 - np.tanh(now.spring[:, joint] / s0) ** 2) / s0
        return found

    def spring_share(self, now: Model, x: Array, joint: int) -> Array:
        """Return the derivative of a motor's torque by its transmission's, (N,): load friction adds to it."""
        share = np.ones(self.log.count)
        if len(now.rounded):
            load = x[self.unknowns["load"][joint]]
            share += load * now.sign[:, joint] * now.spring[:, joint] / now.rounded[:, joint]
        return share
