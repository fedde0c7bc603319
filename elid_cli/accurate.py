"""The accurate estimator: collocation started from the default fit, and accepted only if it proves itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.collocation import Equations, Iterate, Outcome, Piece, Problem, Setting, States, iterate
from elid_cli.effects import SHAPE_SPREAD, Declared, FittedEffects, amplitude_prior, declared_effects, extra_of
from elid_cli.fitting import Fit
from elid_cli.model import Model, Row, inputs_of
from elid_cli.motion import Motion
from elid_cli.nuisance import DELAY
from elid_cli.recording import Segment
from elid_cli.reduction import reduce
from elid_cli.signals import Signals
from elid_cli.smoothing import fit_spline
from elid_cli.solve import solve
from elid_cli.terms.effect import DIRECTION_WIDTH, Effect, Scene
from elid_cli.trace import Graph, Program, Scalar, compile_program

Array = NDArray[np.float64]

KNOTS = (0.01, 0.02)
"""Range of knot spacings, s: the equations of motion hold the trajectory, so noise asks for no coarser ones."""
MODEL_ERROR = 1e-4
"""Standard deviation of the equations' own error, as a share of the rms torque of the joint."""
STEPS = 16
MOVED = 10.0
"""Standard errors of the default estimate that no parameter may move by."""
LOWEST_SIGNAL = 30.0
"""Signal-to-noise ratio of the positions, dB, below which the iteration is not started."""
_SLOW_WEIGHT = 0.05
_POINTS = 15


@dataclass(frozen=True)
class Accurate:
    """A collocation's answer in the columns of the fit it started from."""

    values: Array
    """Solution over all columns of the fit, (p + e,)."""
    covariance: Array
    """Covariance of the fit's basis, (r, r)."""
    effects: FittedEffects | None
    steps: int
    knots: float


@dataclass(frozen=True)
class Refusal:
    """Why the default answer stands."""

    reason: str


def collocate(fit: Fit) -> Accurate | Refusal:
    """Refine a fit by collocation."""
    signals = fit.signals
    if signals.recording is None:
        return Refusal("the raw log is not at hand")
    ratio = _signal_to_noise(signals, fit.model)
    if ratio < LOWEST_SIGNAL:
        return Refusal(f"positions are {ratio:.0f} dB above their noise, less than the {LOWEST_SIGNAL:g} dB it needs")
    best: tuple[float, _Setup, Outcome] | None = None
    for start in _starts(fit):
        setup = _Setup(start)
        if not setup.pieces:
            return Refusal("no segment is long enough")
        outcome = iterate(setup.problem, setup.start, setup.prior, STEPS)
        final = setup.common_cost(outcome)
        if best is None or final < best[0]:
            best = (final, setup, outcome)
    assert best is not None
    return best[1].judged(best[2], fit)


def _starts(fit: Fit) -> list[Fit]:
    """Return the fit, and the same with the shapes that the robot file gives: friction curves have several valleys."""
    if fit.effects is None or not any(item.free for item in fit.effects.effects):
        return [fit]
    scene = fit.effects.scene
    given = declared_effects(fit.model.robot, scene)
    extras = tuple(extra_of(item.effect, scene, fit.signals) for item in given)
    triangles = reduce(fit.observation, (*fit.nuisances, *extras))
    first = fit.model.parameters + sum(extra.width for extra in fit.nuisances)
    triangles = replace(triangles, prior=amplitude_prior(given, first, triangles.width))
    solution = solve(triangles, fit.solution.weights, basis=fit.solution.basis)
    values = np.zeros(triangles.width)
    values[solution.basis] = solution.values[solution.basis]
    other = replace(fit.solution, values=values)
    return [fit, replace(fit, effects=FittedEffects(given, extras, scene), solution=other)]


def _signal_to_noise(signals: Signals, model: Model) -> float:
    worst = np.inf
    for k in range(model.robot.n):
        if signals.still[k]:
            continue
        size = float(np.nanstd(signals.motion.q[:, k]))
        noise = float(np.nanmax([signals.noise.q[k], signals.noise.theta[k], 1e-12]))
        worst = min(worst, 20 * np.log10(max(size, 1e-300) / noise))
    return float(worst)


class _Setup:
    """A fit turned into a collocation problem."""

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        signals, robot = fit.signals, fit.model.robot
        self.channels = [("q", k) for k in range(robot.n) if not signals.still[k]]
        self.channels += [("theta", k) for k in range(robot.n) if robot.joints[k].elastic and not signals.still[k]]
        self.rows = [item.row for item in fit.model.equations.rows]
        self.p_columns = fit.solution.basis
        self.active = np.array([k for k, c in enumerate(self.p_columns)], dtype=np.intp)
        self.setting = self._setting()
        self.delay = self._delays()
        self.robot_equations = _RobotEquations(self)
        self.pieces = [p for s in signals.segments if (p := self._piece(s)) is not None]
        self.first = [s for s in signals.segments if self._intervals(s) >= 12]
        rho = self._rho()
        z = _free_shapes(fit.effects)
        given = None
        if fit.effects is not None:
            given = replace(fit.effects, effects=declared_effects(robot, fit.effects.scene))
        self.z_start = _free_shapes(given)
        start = Iterate([p.start for p in self.pieces], fit.solution.values[self.p_columns].copy(), z.copy())
        self.start = start
        rows = self.robot_equations
        equations = Equations(rows.residual, rows.columns, rows.trust)
        self.problem = Problem(self.setting, self.pieces, equations, rho)

    def _setting(self) -> Setting:
        signals = self.fit.signals
        known = signals.knots[np.isfinite(signals.knots) & ~signals.still]
        wanted = float(np.clip(known.min() if len(known) else KNOTS[1], *KNOTS))
        stride = max(4, round(wanted / signals.dt))
        points = max(d for d in range(1, min(_POINTS, stride) + 1) if stride % d == 0)
        if points < 5:  # a prime stride: take the next even one
            stride += 1
            points = max(d for d in range(1, min(_POINTS, stride) + 1) if stride % d == 0)
        motion = signals.motion
        scale = np.array(
            [
                [max(float(np.nanstd(getattr(motion, "d" * d + side)[:, k])), 1e-9) for side, k in self.channels]
                for d in range(3)
            ]
        )
        return Setting(signals.dt, stride, points, scale)

    def _intervals(self, segment: Segment) -> int:
        return len(segment) // self.setting.stride

    def _delays(self) -> Array:
        delays = np.zeros(self.fit.model.robot.n)
        for k, extra in enumerate(self.fit.nuisances):
            if extra.name == DELAY:
                delays[next(iter(extra.rows)).joint] = self.fit.solution.values[self.fit.model.parameters + k]
        return delays

    def _piece(self, segment: Segment) -> Piece | None:
        intervals = self._intervals(segment)
        if intervals < 12:
            return None
        signals, recording, stride = self.fit.signals, self.fit.signals.recording, self.setting.stride
        assert recording is not None
        part = slice(segment.start, segment.start + intervals * stride)
        measured = np.empty((len(self.channels), intervals * stride))
        weight = np.zeros_like(measured)
        smooth = np.empty_like(measured)
        for c, (side, k) in enumerate(self.channels):
            raw = (recording.q if side == "q" else recording.theta)[part, k]
            noise = (signals.noise.q if side == "q" else signals.noise.theta)[k]
            if not self.fit.model.robot.joints[k].elastic and not np.isfinite(raw).any():
                raw, noise = recording.theta[part, k], signals.noise.theta[k]
            measured[c] = raw
            smooth[c] = getattr(signals.motion, side)[part, k]
            sigma = max(float(noise), 1e-9 * float(np.nanstd(smooth[c])) + 1e-15)
            weight[c] = np.where(np.isfinite(raw), 1.0 / sigma, 0.0)
        start = fit_spline(smooth, stride, signals.dt).spline.coefficients[:, : intervals + 5].T
        torque, mask = self._right_side(part)
        shape = (len(self.channels), intervals, stride)
        return Piece(
            measured.reshape(shape),
            weight.reshape(shape),
            torque.reshape(len(self.rows), intervals, self.setting.points),
            mask.reshape(len(self.rows), intervals, self.setting.points),
            np.ascontiguousarray(start),
        )

    def _right_side(self, part: slice) -> tuple[Array, Array]:
        """Return torque averaged over the samples around each point, and the rows' weights there."""
        signals = self.fit.signals
        every = self.setting.stride // self.setting.points
        torque, mask = [], []
        for row in self.rows:
            raw = signals.tau[part, row.joint]
            known = np.isfinite(raw)
            t = np.arange(len(raw)) * signals.dt
            acting = np.interp(t - self.delay[row.joint], t[known], raw[known]) if known.any() else np.zeros(len(raw))
            mean = acting.reshape(-1, every).mean(axis=1)
            count = known.reshape(-1, every).all(axis=1).astype(float)
            if row.kind == "link":
                torque.append(np.zeros_like(mean))
                mask.append(np.ones_like(mean))
                continue
            torque.append(mean)
            mask.append(count)
        return np.array(torque), np.array(mask)

    def _rho(self) -> Array:
        signals = self.fit.signals
        every = self.setting.stride // self.setting.points
        rho = []
        for row in self.rows:
            torque = signals.tau[:, row.joint]
            size = float(np.sqrt(np.nanmean(torque**2))) if np.isfinite(torque).any() else 1.0
            noise = 0.0 if row.kind == "link" else float(np.nan_to_num(signals.noise.tau[row.joint]))
            rho.append(np.hypot(MODEL_ERROR * size, noise / np.sqrt(every)))
        floor: Array = np.maximum(np.array(rho), 1e-9)
        return floor

    def prior(self, now: Iterate) -> tuple[float, Array, Array]:
        """Return (cost, matrix, gradient) of the priors on amplitudes and shapes."""
        size = len(now.p) + len(now.z)
        matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        if self.fit.effects is None:
            return cost, matrix, gradient
        k = len(now.p) + np.arange(len(now.z))
        matrix[k, k] = 1.0 / SHAPE_SPREAD**2
        gradient[k] = (now.z - self.z_start) / SHAPE_SPREAD**2
        cost += float(np.sum((now.z - self.z_start) ** 2)) / SHAPE_SPREAD**2
        first = self.fit.model.parameters + sum(extra.width for extra in self.fit.nuisances)
        rows = amplitude_prior(self.fit.effects.effects, first, self.fit.triangles.width)
        if rows is not None:
            here = rows[:, self.p_columns]
            miss = here @ now.p - rows[:, -1]
            matrix[: len(now.p), : len(now.p)] += here.T @ here
            gradient[: len(now.p)] += here.T @ miss
            cost += float(miss @ miss)
        return cost, matrix, gradient

    def common_cost(self, outcome: Outcome) -> float:
        """Return an outcome's cost with the noise that was assumed at first, to compare outcomes by."""
        now = Iterate(outcome.coefficients, outcome.p, outcome.z)
        held = self.problem.rho
        self.problem.rho = self._rho()
        self.problem.trust(self.start)
        cost = self.problem.cost(now) + self.prior(now)[0]
        self.problem.rho = held
        return cost

    def judged(self, outcome: Outcome, fit: Fit) -> Accurate | Refusal:
        """Accept or refuse an outcome, which came from `fit`."""
        if len(outcome.costs) < 2 or not np.isfinite(outcome.costs[-1]):
            return Refusal("its cost did not fall")
        covariance = outcome.covariance[: len(outcome.p), : len(outcome.p)]
        if not np.isfinite(outcome.p).all() or not np.isfinite(covariance).all() or np.any(np.diag(covariance) < 0):
            return Refusal("its errors are not finite")
        values = np.zeros(fit.triangles.width)
        values[self.p_columns] = outcome.p
        for k, extra in enumerate(fit.nuisances):
            if extra.name == DELAY:
                values[fit.model.parameters + k] = fit.solution.values[fit.model.parameters + k]
        transform = fit.transform
        known = fit.solution.estimable(transform)
        used = transform[:, fit.solution.basis]
        before = np.sqrt(np.maximum(np.diag(used @ fit.covariance @ used.T), 0.0))
        moved = np.abs(transform @ (values - fit.solution.values))
        far = known & (moved > MOVED * before)
        if far.any():
            worst = int(np.argmax(np.where(far, moved / np.maximum(before, 1e-300), 0.0)))
            return Refusal(f"{fit.base.names[worst]} moved by {moved[worst] / before[worst]:.0f} standard errors")
        effects = self.robot_equations.final_effects(outcome.z)
        return Accurate(values, covariance, effects, len(outcome.costs) - 1, self.setting.width)


def _free_shapes(effects: FittedEffects | None) -> Array:
    """Return the logarithms of the shapes that are refined (only positive ones are)."""
    if effects is None:
        return np.zeros(0)
    shapes = [item.effect.shape[k] for item in effects.effects for k in item.free]
    return np.array([np.log(shape) for shape in shapes if shape > 0])


def _shaped(effects: FittedEffects, z: Array) -> list[Effect]:
    found, place = [], 0
    for item in effects.effects:
        shape = list(item.effect.shape)
        for k in item.free:
            if shape[k] > 0:
                shape[k] = float(np.exp(z[place]))
                place += 1
        found.append(type(item.effect)(item.effect.joint, shape))
    return found


def _inputs(motion: Motion) -> Array:
    """Return the traced rows' inputs with sign(v) rounded, so that its slope is seen where a velocity changes sign."""
    inputs = inputs_of(motion)
    inputs[7::9] = np.tanh(motion.dtheta.T / DIRECTION_WIDTH)
    return inputs


class _RobotEquations:
    """Link and motor rows of the robot at given states."""

    def __init__(self, setup: _Setup) -> None:
        self._setup = setup
        self._fit = setup.fit
        self._model = setup.fit.model
        self._place = {int(c): k for k, c in enumerate(setup.p_columns)}
        self._row = {row: k for k, row in enumerate(setup.rows)}
        self._still = {
            (side, k): float(np.nanmean(getattr(setup.fit.signals.motion, side)[:, k]))
            for side in ("q", "theta")
            for k in np.flatnonzero(setup.fit.signals.still).tolist()
        }
        self._folded: tuple[bytes, Program] | None = None

    def motion(self, states: States) -> Motion:
        """Return the motion of all joints at the collocation points."""
        n, instants = self._model.robot.n, states.values.shape[2]
        arrays = {name: np.zeros((instants, n)) for name in ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")}
        for (side, k), value in self._still.items():
            arrays[side][:, k] = value
        for c, (side, k) in enumerate(self._setup.channels):
            for d in range(3):
                arrays["d" * d + side][:, k] = states.values[d, c]
                if side == "q" and not self._model.robot.joints[k].elastic:
                    arrays["d" * d + "theta"][:, k] = states.values[d, c]
        t = (states.first + np.arange(instants)) * self._setup.setting.width / self._setup.setting.points
        return Motion(t, *(arrays[k] for k in ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")))

    def residual(self, states: States, p: Array, z: Array) -> Array:
        """Return the model's torques in link and motor rows, (rows, instants)."""
        motion = self.motion(states)
        out = np.empty((len(self._setup.rows), motion.samples))
        self._program(p).run(_inputs(motion), out)
        extra = self._extra_columns(motion, z, states)
        for place, values in extra.items():
            out += p[place] * values
        return out

    def trust(self, states: States) -> Array:
        """Return the weight of every row at given states: friction is undefined where a motor reverses or sticks."""
        motion, signals = self.motion(states), self._fit.signals
        weight = np.ones((len(self._setup.rows), motion.samples))
        for k, row in enumerate(self._setup.rows):
            if row.kind != "link" and not signals.still[row.joint]:
                slow = np.abs(motion.dtheta[:, row.joint]) < signals.min_velocity[row.joint]
                weight[k] = np.where(slow, _SLOW_WEIGHT, 1.0)
        return weight

    def columns(self, states: States, z: Array) -> Array:
        """Return the columns of all linear parameters, (rows, p, instants)."""
        motion = self.motion(states)
        plan = self._model.equations
        columns = np.zeros((len(plan.rows), len(self._place), motion.samples))
        out = np.empty((plan.program.outputs, motion.samples))
        plan.program.run(_inputs(motion), out)
        rows = {item.row: out[item.slots] for item in plan.rows}
        for k, item in enumerate(plan.rows):
            for position, column in enumerate(item.columns):
                if int(column) in self._place:
                    columns[k, self._place[int(column)]] = rows[item.row][position]
        for place, values in self._extra_columns(motion, z, states).items():
            columns[:, place] = values
        return columns

    def _program(self, p: Array) -> Program:
        """Return the traced rows with the parameters folded in."""
        key = p.tobytes()
        if self._folded is None or self._folded[0] != key:
            values = dict.fromkeys(self._model.names, 0.0)
            for column, place in self._place.items():
                if column < self._model.parameters:
                    values[self._model.names[column]] = float(p[place])
            graph = Graph(9 * self._model.robot.n)
            traced = self._model.trace(graph, paper=True)
            outputs: list[Scalar] = []
            for row in self._setup.rows:
                total: Scalar = 0.0
                for name, value in traced[row].items():
                    total = total + value * values[name]
                outputs.append(total)
            self._folded = (key, compile_program(graph, outputs))
        return self._folded[1]

    def _extra_columns(self, motion: Motion, z: Array, states: States) -> dict[int, Array]:
        """Return columns of offsets and effects by their place in p, each (rows, instants)."""
        found: dict[int, Array] = {}
        number = self._model.parameters
        shape = (len(self._setup.rows), motion.samples)
        for extra in self._fit.nuisances:
            if extra.name != DELAY and number in self._place:
                values = np.zeros(shape)
                for row in extra.rows:
                    target = row if row in self._row and row.kind != "sum" else None
                    if row.kind == "sum" and not self._model.robot.joints[row.joint].elastic:
                        target = row
                    if target is not None:
                        values[self._row[target]] = 1.0
                found[self._place[number]] = values
            number += extra.width
        if self._fit.effects is None:
            return found
        scene = self._scene(motion, states)
        for effect in _shaped(self._fit.effects, z):
            columns = effect.columns(scene)
            for d in range(len(effect.amplitudes)):
                if number + d in self._place:
                    values = np.zeros(shape)
                    for key, rows in columns.items():
                        elastic = self._model.robot.joints[key.joint].elastic
                        target = Row(key.side, key.joint) if elastic else Row("sum", key.joint)
                        values[self._row[target]] += rows[d]
                    found[self._place[number + d]] = values
            number += len(effect.amplitudes)
        return found

    def _scene(self, motion: Motion, states: States) -> Scene:
        assert self._fit.effects is not None
        scene = self._fit.effects.scene
        every = self._setup.setting.stride // self._setup.setting.points
        begin = scene.starts[min(states.piece, len(scene.starts) - 1)] + states.first * every
        index = begin + np.arange(motion.samples) * every
        index = np.minimum(index, len(scene.tau) - 1)
        stiffness = np.nan_to_num(scene.stiffness)
        load = np.where(np.isfinite(scene.stiffness), stiffness * (motion.theta - motion.q), scene.load[index])
        return replace(
            scene, motion=motion, dt=scene.dt * every, tau=scene.tau[index], load=load,
            predicted=scene.predicted[index], starts=(0,), temperature=None, cache={},
        )  # fmt: skip

    def final_effects(self, z: Array) -> FittedEffects | None:
        """Return the fit's effects with the shapes found."""
        fitted = self._fit.effects
        if fitted is None:
            return None
        items: Sequence[Declared] = [
            replace(item, effect=effect) for item, effect in zip(fitted.effects, _shaped(fitted, z), strict=True)
        ]
        return replace(fitted, effects=tuple(items))
