"""What effects do along a motion: torques, and what they add to the friction that holds a joint at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.drives import Fading
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.linearised import SLIGHT, Local
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion

CREEP = 1e-4
"""Speed, rad/s (m/s), of a joint that sticks, by which its friction is computed: that of the direction it came from."""


@dataclass(frozen=True)
class Acting:
    """What D amplitudes of 1 do at N instants."""

    push: Array
    """Torque on every coordinate (`rollout.Coordinates`) on the model's side, N·m (N), (D, N, m); 0 of friction that
    holds."""
    grip: Array
    """Coulomb friction at every coordinate, N·m (N), (D, N, m)."""

    def total(self, amplitudes: Array) -> tuple[Array, Array]:
        """Return push and grip of amplitudes (..., D), each (N, ..., m)."""
        return _weighted(amplitudes, self.push), _weighted(amplitudes, self.grip)


def resisting(push: Callable[[Array, Array], Array], x: Array, v: Array) -> tuple[Array, Array]:
    """Return stiffness and damping of effects at every coordinate, (m,) each, where they push back; else 0.

    What is stiff beside the masses must act on the motion that comes out, not on the one before.

    Parameters
    ----------
    push
        Torque of the effects on the model's side, N·m (N), of positions and velocities, (..., m).
    x, v
        The motion.
    """
    here = push(x, v)
    by_place, by_speed = ((push(*moved) - here) / SLIGHT for moved in ((x + SLIGHT, v), (x, v + SLIGHT)))
    return _usual(by_place, np.ones_like(v)), _usual(by_speed, v**2)


def _usual(slope: Array, weight: Array) -> Array:
    """Return the weighted mean of a slope (..., m) over all but the coordinates; 0 of one that is not positive.

    Weighted by v², that of a friction which jumps at reversals is its slope in motion.
    """
    others = tuple(range(slope.ndim - 1))
    whole = np.maximum(weight.sum(axis=others), 1e-300)
    found: Array = np.maximum((slope * weight).sum(axis=others) / whole, 0.0)
    return np.where(np.isfinite(found), found, 0.0)


def _weighted(amplitudes: Array, columns: Array) -> Array:
    found: Array = np.moveaxis(np.tensordot(amplitudes, columns, axes=(-1, 0)), -2, 0)
    return found


def can_act(kind: type[Effect]) -> bool:
    """Return whether an effect's torque follows from the motion alone, so that a simulated motion can hold it."""
    torque = kind.simulated == "torque" and not kind.memory and not kind.local
    torque = torque and kind.by_motion
    return torque and kind.nuisance is None and kind.corrects is None and kind.place in ("motor", "link")


def declared(robot: Robot, spec: EffectSpec, scene: Scene) -> tuple[Effect, Array] | None:
    """Return a declared effect with its amplitudes, (d,), or None where a motion cannot hold it.

    Raises
    ------
    RobotError
        A parameter that it needs is not given.
    """
    kind, joint = resolve(robot, spec)
    if not can_act(kind):
        return None
    try:
        amplitudes, shape = kind.coefficients(scene, joint, spec.parameters)
    except KeyError as error:
        raise _missing(robot, spec, error) from None
    return kind(joint, shape), amplitudes


def declared_fading(robot: Robot) -> Fading | None:
    """Return the friction that a robot declares to fade in over a speed, one variant; None where it declares none.

    Raises
    ------
    RobotError
        A parameter that it needs is not given.
    """
    friction, width, lead = np.zeros((3, 1, robot.n))
    width += 1.0
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        if kind.softens:
            try:
                friction[0, joint], (width[0, joint], lead[0, joint]) = _softness(kind, spec)
            except KeyError as error:
                raise _missing(robot, spec, error) from None
    return Fading(friction, width, lead) if friction.any() else None


def _softness(kind: type[Effect], spec: EffectSpec) -> tuple[float, tuple[float, ...]]:
    values = dict(spec.parameters)
    (amplitude,) = kind.amplitudes
    shape = tuple(float(values[p.name] if p.default is None else values.get(p.name, p.default)) for p in kind.shapes)
    return float(values[amplitude.name]), shape


def _missing(robot: Robot, spec: EffectSpec, error: KeyError) -> RobotError:
    return RobotError(f"{spec.where or robot.name}: {spec.effect} of {spec.joint} has no {error.args[0]}")


def scene_along(robot: Robot, x: Array, v: Array, local: Local, dt: float, parameters: Array, samples: int) -> Scene:
    """Return what effects are computed from, along a motion of coordinates x with velocities v, (N, m).

    `local` are the equations about the motion of one stretch; the load is what the bodies need or a spring carries,
    never a measured torque. `samples` is the length of the whole log.
    """
    n, motors = robot.n, coordinates_of(robot).motors
    known = np.nan_to_num(parameters)
    t: Array = dt * np.arange(len(x), dtype=np.float64)
    a, local = np.gradient(v, dt, axis=0), local.at_samples
    need = np.einsum("nij,nj->ni", local.mass[:, 0], a) + local.force[:, 0]
    need += np.einsum("nij,nj->ni", local.slope[:, 0], x - local.place[:, 0])
    need += np.einsum("nij,nj->ni", local.swerve[:, 0], v - local.speed[:, 0])
    motion = Motion(t, x[:, :n], v[:, :n], a[:, :n], x[:, motors], v[:, motors],
                    a[:, motors])  # fmt: skip
    load, stiffness = need[:, :n], np.full(n, np.nan)
    elastic = any(joint.elastic for joint in robot.joints)
    for name, value in zip(robot.parameter_names(), known.tolist(), strict=True) if elastic else ():
        if name.kind == "K" and robot.joints[name.joint].elastic:
            stiffness[name.joint] = value
            load[:, name.joint] = value * (motion.theta[:, name.joint] - motion.q[:, name.joint])
    return Scene(robot, motion, dt, load, load, load, known, samples * dt, stiffness)


def acting(effects: Sequence[Effect], scene: Scene) -> Acting:
    """Return what effects do along a scene, amplitude by amplitude."""
    places = coordinates_of(scene.robot)
    shape = (sum(len(effect.amplitudes) for effect in effects), scene.samples, places.count)
    push, grip = np.zeros((2, *shape))
    creeping, direction = _creeping(scene) if any(effect.holds() for effect in effects) else (scene, np.zeros(0))
    first = 0
    for effect in effects:
        last = first + len(effect.amplitudes)
        if effect.acts_as == "directed friction":
            _directed(effect, creeping, places.motors, push[first:last], grip[first:last])
            first = last
            continue
        for row, columns in effect.columns(creeping if effect.holds() else scene).items():
            place = row.joint if row.side == "link" else places.motors[row.joint]
            if effect.holds():
                # a friction that holds is whole at rest: the effect's rounded sign of motion is taken out
                whole = direction[:, row.joint] / np.abs(creeping.direction(row.joint))
                grip[first:last, :, place] += columns * whole
            else:
                push[first:last, :, place] += columns
        first = last
    return Acting(push, grip)


def _directed(effect: Effect, creeping: Scene, motors: NDArray[np.intp], push: Array, grip: Array) -> None:
    """Add what a friction does that is of another size in each direction, of D amplitudes: (D, N, m) each.

    Between the frictions of both directions a joint rests: half their difference holds it, half their sum pushes it.
    """
    speed = np.abs(creeping.motion.dtheta)
    ways = [replace(creeping, motion=replace(creeping.motion, dtheta=sign * speed), cache={}) for sign in (1, -1)]
    forwards, backwards = (effect.columns(way) for way in ways)
    for row, columns in forwards.items():
        place = motors[row.joint]
        whole = np.abs(ways[0].direction(row.joint))
        push[:, :, place] += 0.5 * (columns + backwards[row]) / whole
        grip[:, :, place] += 0.5 * (columns - backwards[row]) / whole


def _creeping(scene: Scene) -> tuple[Scene, Array]:
    """Return the scene with joints that stick moving slowly as they moved last, and the direction of all, (N, n)."""
    if "creeping" in scene.cache:
        known: tuple[Scene, Array] = scene.cache["creeping"]
        return known
    v = scene.motion.dtheta
    moving = np.abs(v) > 1e-9
    latest = np.maximum.accumulate(np.where(moving, np.arange(len(v))[:, None], 0), axis=0)
    direction = np.sign(np.take_along_axis(v, latest, axis=0))
    direction[direction == 0] = 1.0
    speed = direction * np.maximum(np.abs(v), CREEP)
    found = replace(scene, motion=replace(scene.motion, dtheta=speed), cache={}), direction
    scene.cache["creeping"] = found
    return found
