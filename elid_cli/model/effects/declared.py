"""Effects as a robot file declares them, and what is known of their amplitudes beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError, did_you_mean
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect, Parameter
from elid_cli.model.effects.scene import Scene, with_stiffness
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals


def resolve(robot: Robot, spec: EffectSpec) -> tuple[type[Effect], int]:
    """Return the class of a declared effect and its joint (of one of the whole robot: see `Effect.number`).

    Raises
    ------
    RobotError
        An effect, joint or parameter that does not exist, or an effect that cannot exist at this joint.
    """
    kind = _known(robot, spec)
    where = _where(robot, spec)
    if spec.joint is not None and spec.joint not in robot.joint_names:
        raise RobotError(f"{where}: no joint named {spec.joint!r}", hint=did_you_mean(spec.joint, robot.joint_names))
    if spec.joint is None and not kind.whole_robot and robot.n > 1:
        raise RobotError(f"{where}: no joint", hint=f"joint: {robot.joint_names[0]}")
    joint = kind.number(robot, spec.joint)
    reason = kind.unfit(robot, joint)
    if reason:
        elastic = f", or set 'transmission: elastic' of {robot.joints[joint].name}" if kind.elastic_only else ""
        raise RobotError(
            f"{where}: does not apply to {robot.joints[joint].name}", detail=reason, hint=f"leave it out{elastic}"
        )
    return kind, joint


def is_soft_in_mjcf(robot: Robot, spec: EffectSpec) -> bool:
    """Whether an effect is friction that fades in, at a joint whose friction is the joint's own in an MJCF."""
    kind, joint = resolve(robot, spec)
    return kind.softens and not robot.joints[joint].elastic and robot.joints[joint].gear_ratio is None


def check_effects(robot: Robot) -> Robot:
    """Return the robot, all of whose declared effects and their parameters have names that the library knows.

    Raises
    ------
    RobotError
        An effect or parameter that does not exist.
    """
    for spec in robot.effects:
        _known(robot, spec)
    return robot


def _known(robot: Robot, spec: EffectSpec) -> type[Effect]:
    """Return the class of a declared effect whose name and parameters' names exist (RobotError)."""
    library = effect_classes()
    if spec.effect not in library:
        what = f"{spec.where or robot.name}: unknown effect {spec.effect!r}"
        raise RobotError(what, hint=did_you_mean(spec.effect, library))
    kind = library[spec.effect]
    names = kind.parameter_names()
    for name in spec.parameters:
        if name not in names:
            what = f"{_where(robot, spec)}: unknown parameter {name!r}"
            detail = f"{spec.effect} has {', '.join(names)}"
            raise RobotError(what, detail=detail, hint=did_you_mean(name, names))
    for parameter in kind.shapes:
        if parameter.name in spec.parameters:
            _check(robot, spec, parameter, spec.parameters[parameter.name])
    return kind


def _check(robot: Robot, spec: EffectSpec, parameter: Parameter, value: float) -> None:
    """Refuse a value of a shape with which an effect cannot be computed (RobotError)."""
    most, what = float(parameter.high), f"{_where(robot, spec)}: {parameter.name} {value:g}"
    if parameter.of_joint:
        others = [k + 1 for k, name in enumerate(robot.joint_names) if name != spec.joint]
        if value not in others:
            raise RobotError(f"{what} is no other joint", hint=f"one of {', '.join(map(str, others)) or 'none'}")
    elif not parameter.low - ROUNDED * abs(parameter.low) <= value <= most + ROUNDED * abs(most):
        unit = f" {parameter.unit}" if parameter.unit != "1" else ""
        between = f"at least {parameter.low:g}{unit}" if np.isinf(most) else f"{parameter.low:g} to {most:g}{unit}"
        raise RobotError(f"{what}{unit} cannot be", detail=parameter.meaning, hint=between)


def _where(robot: Robot, spec: EffectSpec) -> str:
    """Return where an effect is declared, with its name."""
    of = f" of {spec.joint}" if spec.joint else ""
    return f"{spec.where}: {spec.effect}{of}" if spec.where else f"{robot.name}: effect {spec.effect}"


def as_observed(robot: Robot, log: Signals | Recording) -> Robot:
    """Return the robot as a log shows it: rigid where it holds no link positions, without motors where no motor torque.

    Declared effects that such a robot cannot have are left out (`lost_effects`).
    """
    seen = robot.stiffened(log.missing_link).read_behind(log.link_torque)
    lost = [spec for spec, _ in lost_effects(robot, seen)]
    return replace(seen, effects=tuple(spec for spec in robot.effects if spec not in lost)) if lost else seen


def lost_effects(robot: Robot, seen: Robot) -> list[tuple[EffectSpec, str]]:
    """Return the declared effects that the robot as its log shows it cannot have, with the reason."""
    library = effect_classes()
    found = []
    for spec in robot.effects if seen is not robot else ():
        known = spec.joint is None or spec.joint in robot.joint_names
        joint = library[spec.effect].number(robot, spec.joint) if known else 0
        reason = library[spec.effect].unfit(seen, joint)
        if reason and not library[spec.effect].unfit(robot, joint):
            found.append((spec, reason))
    return found


def with_lost_effects(recording: Recording, robot: Robot) -> Recording:
    """Return the recording with a warning of every declared effect that it cannot show for want of link positions."""
    if not robot.effects:
        return recording
    lost = [
        f"{spec.joint or robot.joint_names[0]}: the declared {spec.effect} is left out: {reason} in this log"
        for spec, reason in lost_effects(robot, as_observed(robot, recording))
    ]
    return replace(recording, warnings=(*recording.warnings, *lost)) if lost else recording


ROUNDED = 1e-6
"""Part by which a value that was written at a bound may lie beyond it."""
FRICTIONS = 3.0
"""Prior standard deviation of an amplitude that the file does not give, over the friction's rms: terms of one curve
that nearly cancel may each be larger than the friction."""


@dataclass(frozen=True)
class Declared:
    """An effect of the robot file with the shape fitted so far."""

    spec: EffectSpec
    effect: Effect
    mean: Array = field(default_factory=lambda: np.zeros(0))
    """Amplitudes that the file gives, 0 where it gives none, (d,); empty: nothing is known of them."""
    spread: Array = field(default_factory=lambda: np.zeros(0))
    """Prior standard deviation of the amplitudes, (d,); infinite where nothing is known."""
    start: Effect | None = None
    """The effect in the shape that the file gives; None where it gives none."""

    @property
    def searched_with(self) -> tuple[int, str]:
        """Effects of one kind at one joint trade against each other: their shapes are searched together."""
        return (-1 if self.effect.whole_robot else self.effect.joint, self.effect.name)

    @property
    def free(self) -> tuple[int, ...]:
        """Positions of the shapes that are refined."""
        return tuple(k for k, p in enumerate(self.effect.shapes) if not getattr(p, "fixed", False))


def declared_effects(robot: Robot, scene: Scene) -> tuple[Declared, ...]:
    """Return the effects of a robot file; a shape that it does not give starts in the middle of the effect's grid.

    In the form that it gives, such as the exponent of a friction curve, or means by giving none.

    Raises
    ------
    RobotError
        See `resolve`.
    """
    found = []
    rough = scene
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        stiffness = float(robot.joints[joint].parameters.get("K", np.nan))
        scene = with_stiffness(rough, joint, stiffness) if kind.strains_spring and stiffness > 0 else rough
        values = {p.name: 0.0 for p in kind.amplitudes} | dict(spec.parameters)
        mean = np.zeros(len(kind.amplitudes))
        given = True
        try:
            mean, shape = kind.coefficients(scene, joint, values)
        except KeyError:
            given = False
            grid = _grid(kind, scene, joint, spec)
            if not grid:
                continue
            shape = grid[len(grid) // 2]
        effect = kind(joint, shape)
        spread = _amplitude_spread(kind, joint, mean, scene)
        if kind.strains_spring and scene is rough:  # an angle is known, and no torque that it makes
            spread = np.full_like(mean, np.inf)
        found.append(Declared(spec, effect, mean, spread, effect if given else None))
    return tuple(found)


def _grid(kind: type[Effect], scene: Scene, joint: int, spec: EffectSpec) -> list[tuple[float, ...]]:
    """Return the shapes of an effect's grid with the values that the file gives, in the form that it gives or means."""
    grid = kind.grid(scene, joint)
    for k, parameter in enumerate(kind.shapes):
        value = spec.parameters.get(parameter.name, parameter.default if parameter.fixed else None)
        if value is not None:
            formed = [shape for shape in grid if shape[k] == value] or grid
            grid = [(*shape[:k], float(value), *shape[k + 1 :]) for shape in formed]
    return grid


def _amplitude_spread(kind: type[Effect], joint: int, mean: Array, scene: Scene) -> Array:
    """Return how far amplitudes may lie from what the file gives: by its own size, or by some times the friction."""
    spread = np.where(mean != 0, np.abs(mean), np.inf)
    if kind.place == "motor":
        known = dict(zip(scene.robot.parameter_names(), scene.parameters.tolist(), strict=True))
        coulomb, viscous = (known[StandardParameter(name, joint)] for name in ("fs", "fv"))
        speed = np.abs(scene.motion.dtheta[:, joint])
        level = np.sqrt(np.mean((coulomb + viscous * speed) ** 2))
        units = np.array([p.unit in ("N·m", "N") for p in kind.amplitudes])
        spread = np.where(units & ~(mean != 0) & (level > 0), FRICTIONS * level, spread)
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
