"""Effects against a log: the scene they are computed from, their columns, and fitting those a robot file declares.

An effect is linear in its amplitudes; its shapes are refined by variable projection (Golub and Pereyra 1973): the
amplitudes and all base parameters are eliminated, and what remains is a small search over shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import RobotError, did_you_mean
from elid_cli.model import Model, Row
from elid_cli.motion import Motion
from elid_cli.observation import Observation, pair
from elid_cli.recording import Segment
from elid_cli.reduction import Extra, full_columns
from elid_cli.robot import EffectSpec, Robot
from elid_cli.signals import Signals
from elid_cli.terms import effect_classes
from elid_cli.terms.effect import Effect, Scene

Array = NDArray[np.float64]

_CHUNK = 16384
"""Samples whose full-rate regressor is held at a time."""
SHAPE_SPREAD = 0.5
"""Prior standard deviation of a shape's logarithm about its start: holds shapes that the log does not show."""
_SCAN = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Moves of a shape's logarithm that are tried before the refinement."""
_SCANNED = 3
"""Shapes of one joint up to which all combinations are tried."""
_STARTS = 3
"""Valleys of the grid that are refined."""
_STEP = 1e-3
"""Relative step of the shapes' finite differences."""


def resolve(robot: Robot, spec: EffectSpec) -> tuple[type[Effect], int]:
    """Return the class of a declared effect and its joint (0 for effects of the whole robot).

    Raises
    ------
    RobotError
        An effect, joint or parameter that does not exist, or an effect that cannot exist at this joint.
    """
    library = effect_classes()
    where = f"{robot.name}: effect {spec.effect}"
    if spec.effect not in library:
        raise RobotError(f"{robot.name}: no effect named {spec.effect!r}", hint=did_you_mean(spec.effect, library))
    kind = library[spec.effect]
    if spec.joint is not None and spec.joint not in robot.joint_names:
        raise RobotError(f"{where}: no joint named {spec.joint!r}", hint=did_you_mean(spec.joint, robot.joint_names))
    if spec.joint is None and not kind.whole_robot and robot.n > 1:
        raise RobotError(f"{where}: no joint", hint=f"joint: {robot.joint_names[0]}")
    joint = 0 if spec.joint is None or kind.whole_robot else robot.joint_names.index(spec.joint)
    if not kind.applies(robot, joint):
        raise RobotError(f"{where}: does not apply to {robot.joints[joint].name}")
    names = kind.parameter_names()
    for name in spec.parameters:
        if name not in names:
            detail = f"it has {', '.join(names)}"
            raise RobotError(f"{where}: no parameter {name!r}", detail=detail, hint=did_you_mean(name, names))
    return kind, joint


def scene_of(model: Model, signals: Signals, standard: Array) -> Scene:
    """Return what effects are computed from: all samples of all segments, one after the other.

    Parameters
    ----------
    model, signals
        The robot's model and a log's signals.
    standard
        Standard parameters (p,), any representative of the base parameters; K of 0 or NaN counts as unknown.
    """
    robot = model.robot
    motion = _joined(signals.motion, signals.segments)
    predicted, link = _torques(model, motion, standard)
    stiffness = np.full(robot.n, np.nan)
    load = link
    for k, joint in enumerate(robot.joints):
        if joint.elastic:
            value = float(standard[model.index[f"K{k + 1}"]])
            if np.isfinite(value) and value > 0:
                stiffness[k] = value
                load[:, k] = value * (motion.theta[:, k] - motion.q[:, k])
    tau = _joined_rows(signals.tau, signals.segments)
    lengths = [len(segment) for segment in signals.segments]
    temperature = None if signals.temperature is None else _joined_rows(signals.temperature, signals.segments)
    return Scene(
        robot=robot,
        motion=motion,
        dt=signals.dt,
        tau=np.where(np.isfinite(tau), tau, predicted),
        load=load,
        predicted=predicted,
        parameters=np.nan_to_num(standard),
        duration=signals.duration,
        stiffness=stiffness,
        starts=tuple(int(k) for k in np.concatenate([[0], np.cumsum(lengths)[:-1]])),
        temperature=temperature,
        **_optional(signals),
    )


def _optional(signals: Signals) -> dict[str, Any]:
    """Return the readings of the joint torque sensors that are used, where there are any; NaN at the other joints."""
    if signals.tau_link is None or not signals.sensed.any():
        return {}
    return {"tau_link": np.where(signals.sensed, _joined_rows(signals.tau_link, signals.segments), np.nan)}


def _whole(segments: Sequence[Segment], samples: int) -> bool:
    return len(segments) == 1 and segments[0].start == 0 and segments[0].stop == samples


def _joined_rows(values: Array, segments: Sequence[Segment]) -> Array:
    if _whole(segments, len(values)):
        return values
    return np.concatenate([values[s.start : s.stop] for s in segments])


def _joined(motion: Motion, segments: Sequence[Segment]) -> Motion:
    if _whole(segments, motion.samples):
        return motion
    index = np.concatenate([np.arange(s.start, s.stop, dtype=np.intp) for s in segments])
    return motion[index]


def _torques(model: Model, motion: Motion, standard: Array) -> tuple[Array, Array]:
    """Return predicted motor torque and the link's share of it (what passes the transmission), each (N, n)."""
    plan = model.estimation
    known = np.nan_to_num(standard)
    predicted = np.zeros((motion.samples, model.robot.n))
    own = np.zeros_like(predicted)
    for start in range(0, motion.samples, _CHUNK):
        part = slice(start, min(start + _CHUNK, motion.samples))
        rows = model.rows(motion[part])
        for item in plan.rows:
            if item.row.kind != "sum":
                continue
            k = item.row.joint
            predicted[part, k] = known[item.columns] @ rows[item.row]
            for position, column in enumerate(item.columns):
                if model.names[column] in (f"Jm{k + 1}", f"fs{k + 1}", f"fv{k + 1}"):
                    own[part, k] += known[column] * rows[item.row][position]
    return predicted, predicted - own


def full_rate(effect: Effect, scene: Scene) -> dict[Row, Array]:
    """Return an effect's columns in the rows of estimation at the scene's instants, each (d, N)."""
    columns = {(str(key.side), key.joint): values for key, values in effect.columns(scene).items()}
    sensed: NDArray[np.bool_] | None = None
    if scene.tau_link is not None:
        sensed = np.array([np.isfinite(reading).any() for reading in scene.tau_link.T])
    return pair(columns, scene.robot, sensed, reading=effect.place == "sensor")


def extra_of(effect: Effect, scene: Scene, signals: Signals) -> Extra:
    """Return an effect's columns filtered and decimated as the equations are."""
    return _reduced(effect.name, full_rate(effect, scene), signals, tuple(p.unit for p in effect.amplitudes))


def _reduced(name: str, rows: Mapping[Row, Array], signals: Signals, units: tuple[str, ...]) -> Extra:
    samples = signals.motion.samples
    reduced = {}
    for row, values in rows.items():
        spread = values
        if not _whole(signals.segments, samples):
            spread = np.zeros((values.shape[0], samples))
            place = 0
            for segment in signals.segments:
                spread[:, segment.start : segment.stop] = values[:, place : place + len(segment)]
                place += len(segment)
        reduced[row] = signals.decimate(spread)
    return Extra(name, reduced, units)


@dataclass(frozen=True)
class Declared:
    """An effect of the robot file with the shape fitted so far."""

    spec: EffectSpec
    effect: Effect
    mean: Array = field(default_factory=lambda: np.zeros(0))
    """Amplitudes that the file gives, 0 where it gives none, (d,); empty: nothing is known of them."""
    spread: Array = field(default_factory=lambda: np.zeros(0))
    """Prior standard deviation of the amplitudes, (d,); infinite where nothing is known."""

    @property
    def free(self) -> tuple[int, ...]:
        """Positions of the shapes that are refined."""
        return tuple(k for k, p in enumerate(self.effect.shapes) if not getattr(p, "fixed", False))


@dataclass(frozen=True)
class FittedEffects:
    """Declared effects at their fitted shapes, their columns, and the columns of their shapes' derivatives."""

    effects: tuple[Declared, ...]
    extras: tuple[Extra, ...]
    scene: Scene


def declared_effects(robot: Robot, scene: Scene) -> tuple[Declared, ...]:
    """Return the effects of a robot file; a shape that it does not give starts in the middle of the effect's grid.

    Raises
    ------
    RobotError
        See `resolve`.
    """
    found = []
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        values = {p.name: 0.0 for p in kind.amplitudes} | dict(spec.parameters)
        mean = np.zeros(len(kind.amplitudes))
        try:
            mean, shape = kind.coefficients(scene, joint, values)
        except KeyError:
            grid = kind.grid(scene, joint)
            if not grid:
                continue
            shape = grid[len(grid) // 2]
        found.append(Declared(spec, kind(joint, shape), mean, _amplitude_spread(kind, joint, mean, scene)))
    return tuple(found)


def _amplitude_spread(kind: type[Effect], joint: int, mean: Array, scene: Scene) -> Array:
    """Return how far amplitudes may lie from what the file gives: by its own size, or by that of the friction."""
    spread = np.where(mean != 0, np.abs(mean), np.inf)
    if kind.place == "motor":
        names = {name: k for k, name in enumerate(scene.robot.parameter_names())}
        speed = np.abs(scene.motion.dtheta[:, joint])
        level = np.sqrt(
            np.mean(
                (scene.parameters[names[f"fs{joint + 1}"]] + scene.parameters[names[f"fv{joint + 1}"]] * speed) ** 2
            )
        )
        units = np.array([p.unit in ("N·m", "N") for p in kind.amplitudes])
        spread = np.where(units & ~(mean != 0) & (level > 0), level, spread)
    return spread


def amplitude_prior(effects: Sequence[Declared], first: int, width: int) -> Array | None:
    """Return the equations that hold amplitudes near what is known of them, (k, width + 1), or None.

    Parameters
    ----------
    effects
        Effects in the order of their columns.
    first
        Column of the first amplitude.
    width
        Number of columns.
    """
    rows = []
    place = first
    for item in effects:
        for d, (mean, spread) in enumerate(zip(item.mean, item.spread, strict=True)):
            if np.isfinite(spread) and spread > 0:
                row = np.zeros(width + 1)
                row[place + d], row[-1] = 1.0 / spread, mean / spread
                rows.append(row)
        place += len(item.effect.amplitudes)
    return np.array(rows) if rows else None


def fit_declared(
    observation: Observation,
    signals: Signals,
    scene: Scene,
    effects: Sequence[Declared],
    weights: Mapping[Row, float],
    others: Sequence[Extra] = (),
    spread: float = SHAPE_SPREAD,
) -> FittedEffects:
    """Refine the shapes of effects together, with all linear parameters eliminated.

    Parameters
    ----------
    observation, signals, scene
        The log.
    effects
        What to fit, with starting shapes.
    weights
        Weight of every row group (one over its noise), as in a `Solution`.
    others
        Further linear columns that are eliminated as well (nuisances).
    spread
        Standard deviation of the prior on a shape's logarithm about its start.
    """
    projection = _Projection(observation, weights, others)
    cache: dict[tuple[int, tuple[float, ...]], Extra] = {}

    def extra(number: int, shape: tuple[float, ...]) -> Extra:
        key = (number, shape)
        if key not in cache:
            effect = type(effects[number].effect)(effects[number].effect.joint, shape)
            cache[key] = extra_of(effect, scene, signals)
        return cache[key]

    places = [(i, k) for i, item in enumerate(effects) for k in item.free]
    start = [item.effect.shape for item in effects]
    if places:
        first = np.array([start[i][k] for i, k in places])
        logarithmic = first > 0
        scale = np.where(logarithmic, 1.0, np.maximum(np.abs(first), 1.0))
        bounds = _bounds(effects, places, logarithmic, scale)

        def shapes(z: Array) -> list[tuple[float, ...]]:
            values = np.where(logarithmic, np.exp(np.where(logarithmic, z, 0.0)), z * scale)
            lists = [list(s) for s in start]
            for value, (i, k) in zip(values, places, strict=True):
                lists[i][k] = float(value)
            return [tuple(s) for s in lists]

        begin = np.where(logarithmic, np.log(np.where(logarithmic, first, 1.0)), first / scale)
        begin = np.clip(begin, bounds[0] + 1e-9, bounds[1] - 1e-9)

        def cost(z: Array) -> Array:
            columns = [extra(i, shape) for i, shape in enumerate(shapes(z))]
            return np.concatenate([projection.residual(columns, effects), (z - begin) / spread])

        owners = [effects[i].effect.joint for i, _ in places]
        found = _search(cost, begin, owners, bounds)
        start = shapes(found)
    fitted = tuple(
        replace(item, effect=type(item.effect)(item.effect.joint, shape))
        for item, shape in zip(effects, start, strict=True)
    )
    return FittedEffects(fitted, tuple(extra(i, shape) for i, shape in enumerate(start)), scene)


def _search(cost: Callable[[Array], Array], begin: Array, owners: Sequence[int], bounds: tuple[Array, Array]) -> Array:
    """Return the shapes of least cost: a grid and refinement from its valleys joint after joint, then all together.

    Shapes of one joint trade against each other, so their cost has more than one valley; those of different joints
    hardly meet.
    """
    best = begin
    for joint in sorted(set(owners)):
        mine = np.array([k for k, owner in enumerate(owners) if owner == joint])

        def inner(part: Array, mine: NDArray[np.intp] = mine, held: Array = best) -> Array:
            whole = held.copy()
            whole[mine] = part
            return cost(whole)

        limits = (bounds[0][mine], bounds[1][mine])
        starts = _valleys(inner, begin[mine], limits) if len(mine) <= _SCANNED else [begin[mine]]
        refined = [_refine(inner, start, limits) for start in starts]
        best = best.copy()
        best[mine] = min(refined, key=lambda item: item[1])[0]
    return _refine(cost, best, bounds)[0] if len(set(owners)) > 1 else best


def _refine(cost: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array]) -> tuple[Array, float]:
    from scipy.optimize import least_squares

    step = np.full(len(start), _STEP)
    found = least_squares(cost, start, bounds=bounds, diff_step=step, x_scale=0.3, max_nfev=25)
    return np.asarray(found.x), float(found.cost)


def _valleys(cost: Callable[[Array], Array], begin: Array, bounds: tuple[Array, Array]) -> list[Array]:
    """Return the lowest grid points that are no neighbours of each other, at most `_STARTS`."""
    moves = list(product(_SCAN, repeat=len(begin)))
    points = [np.clip(begin + np.array(move), bounds[0] + 1e-9, bounds[1] - 1e-9) for move in moves]
    values = np.array([float(np.sum(cost(point) ** 2)) for point in points])
    found: list[Array] = []
    for k in np.argsort(values):
        if all(np.max(np.abs(points[k] - other)) > 0.6 for other in found):
            found.append(points[k])
        if len(found) == _STARTS:
            break
    return found


def _bounds(
    effects: Sequence[Declared], places: Sequence[tuple[int, int]], logarithmic: NDArray[np.bool_], scale: Array
) -> tuple[Array, Array]:
    low, high = np.full(len(places), -np.inf), np.full(len(places), np.inf)
    for number, (i, k) in enumerate(places):
        spec = effects[i].effect.shapes[k]
        if logarithmic[number]:
            low[number] = np.log(spec.low) if spec.low > 0 else -30.0
            high[number] = np.log(spec.high) if np.isfinite(spec.high) else 30.0
        else:
            low[number], high[number] = spec.low / scale[number], spec.high / scale[number]
    return low, high


class _Projection:
    """Weighted equations of a log with their base columns eliminated once."""

    def __init__(self, observation: Observation, weights: Mapping[Row, float], others: Sequence[Extra]) -> None:
        self._groups = [g for g in observation.groups if weights.get(g.row, 0.0) > 0 and g.count]
        self._weights = weights
        parameters = observation.parameters
        width = parameters + sum(extra.width for extra in others)
        rows, targets = [], []
        for group in self._groups:
            index, columns = full_columns(group, others, parameters)
            part = np.zeros((group.count, width))
            part[:, index] = weights[group.row] * columns[:, group.use].T
            rows.append(part)
            targets.append(weights[group.row] * group.target[group.use])
        system = np.concatenate(rows)
        norms = np.linalg.norm(system, axis=0)
        live = norms > 0
        left, singular, _ = np.linalg.svd(system[:, live] / norms[live], full_matrices=False)
        self._base = left[:, singular > 1e-8 * singular[0]]
        self._target = self._rest(np.concatenate(targets))

    def _rest(self, values: Array) -> Array:
        rest: Array = values - self._base @ (self._base.T @ values)
        return rest

    def residual(self, extras: Sequence[Extra], effects: Sequence[Declared]) -> Array:
        """Return the weighted residual with everything linear eliminated, the amplitudes' prior last, (rows,)."""
        columns = []
        for extra in extras:
            for d in range(extra.width):
                parts = [
                    self._weights[g.row] * extra.rows[g.row][d][g.use] if g.row in extra.rows else np.zeros(g.count)
                    for g in self._groups
                ]
                columns.append(np.concatenate(parts))
        if not columns:
            return self._target
        block, target = self._rest(np.array(columns).T), self._target
        prior = amplitude_prior(effects, 0, block.shape[1])
        if prior is not None:
            block, target = np.concatenate([block, prior[:, :-1]]), np.concatenate([target, prior[:, -1]])
        norms = np.linalg.norm(block, axis=0)
        block = block[:, norms > 0] / norms[norms > 0]
        solution = np.linalg.lstsq(block, target, rcond=1e-8)[0]
        residual: Array = target - block @ solution
        return residual


def shape_columns(fitted: FittedEffects, signals: Signals, coefficients: Sequence[Array]) -> list[Extra]:
    """Return the columns of the shapes' logarithms (or values) at the fit: what their uncertainty costs the rest.

    Parameters
    ----------
    fitted
        Fitted effects.
    signals
        The log.
    coefficients
        Fitted amplitudes of each effect, (d,).
    """
    extras = []
    for item, base, values in zip(fitted.effects, fitted.extras, coefficients, strict=True):
        for k in item.free:
            shape = list(item.effect.shape)
            step = _STEP * max(abs(shape[k]), 1e-6)
            shape[k] += step
            moved = extra_of(type(item.effect)(item.effect.joint, shape), fitted.scene, signals)
            relative = abs(item.effect.shape[k]) or 1.0
            rows = {row: ((values @ (moved.rows[row] - base.rows[row])) * (relative / step))[None] for row in base.rows}
            extras.append(Extra(f"shape of {item.effect.name}", rows, ("",)))
    return extras
