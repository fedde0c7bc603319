"""What an effect is refused for, in words its author can use: what is missing, and friction that drives the joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.gradual_friction import GradualFriction
from elid_cli.model.effects.library.load_friction import LoadFriction
from elid_cli.model.effects.library.stribeck import Stribeck
from elid_cli.model.effects.library.tanh_friction import TanhFriction
from elid_cli.model.effects.scene import EquationRow, Scene

LIBRARY = effect_classes()
FRICTION = [name for name, kind in LIBRARY.items() if kind.takes_energy]
WORDS = ("summary", "equation", "physics", "typical", "fingerprint", "record", "place", "amplitudes", "example")
LEAST = 1e-9
"""Part of the largest power that counts as none: rounding."""


def missing(kind: type[Effect]) -> list[str]:
    """Return what an effect does not say of itself."""
    where = "elid_cli/model/effects/effect.py says what it is"
    found = [f"{kind.name}: no `{word}`; {where}" for word in WORDS if not hasattr(kind, word)]
    if kind.shapes and getattr(kind.grid, "__func__", None) is getattr(Effect.grid, "__func__", None):
        found.append(f"{kind.name}: it has shapes and no `grid`, from which a search takes the first ones")
    if hasattr(kind, "example"):
        needed = {p.name for p in kind.amplitudes if p.default is None}
        named = {p.name for p in (*kind.amplitudes, *kind.shapes)}
        found += [f"{kind.name}: its example names {name!r}, no parameter" for name in kind.example.keys() - named]
        found += [f"{kind.name}: its example has no value of {name!r}" for name in needed - kind.example.keys()]
    return found


def shapes_of(kind: type[Effect], scene: Scene, joint: int) -> list[tuple[float, ...]]:
    """Return some shapes that the effect may have."""
    grid = kind.grid(scene, joint)
    return grid[:: max(len(grid) // 4, 1)]


def power(effect: Effect, scene: Scene, coefficients: Sequence[float]) -> np.ndarray:
    """Return the power that it takes from the motor's motion, W, (N,): its torque is on the model's side."""
    columns = effect.columns(scene)[EquationRow("motor", effect.joint)]
    return np.asarray(coefficients) @ columns * scene.motion.dtheta[:, effect.joint]


def driving(kind: type[Effect], scene: Scene) -> list[str]:
    """Return where friction drives the joint, a sentence each.

    An amplitude that may only be positive takes energy at every instant; one of either sign does somewhere, where it is
    positive. Friction that turns gradually lessens what a joint's own friction takes, and never by more than that is.
    """
    found = []
    for joint in (j for j in range(scene.robot.n) if kind.applies(scene.robot, j)):
        own = scene.direction(joint) * scene.motion.dtheta[:, joint] if issubclass(kind, GradualFriction) else 0.0
        for shape in shapes_of(kind, scene, joint):
            swings = any(p.name == "phase" for p in kind.amplitudes)
            for parameter in (p for p in kind.amplitudes if p.name != "phase"):
                values = {**{p.name: 0.0 for p in kind.amplitudes}, parameter.name: 1.0}
                values |= {p.name: size for p, size in zip(kind.shapes, shape, strict=True)}
                linear, form = kind.coefficients(scene, joint, values)
                taken = power(kind(joint, form), scene, linear) + own
                bound = LEAST * float(np.abs(taken).max())
                one_sign = parameter.low >= 0 and not swings
                drives = taken.min() < -bound if one_sign else taken.max() <= bound
                if drives or (issubclass(kind, GradualFriction) and np.any(taken > own + bound)):
                    found.append(f"{kind.name} {shape}: a positive {parameter.name} drives joint {joint + 1}")
    return found


@pytest.mark.parametrize("name", LIBRARY)
def test_an_effect_says_all_that_it_must(name: str) -> None:
    assert missing(LIBRARY[name]) == []


@pytest.mark.parametrize("name", FRICTION)
def test_friction_of_a_positive_amplitude_takes_energy(name: str, planar_scene: Scene, spatial_scene: Scene) -> None:
    assert driving(LIBRARY[name], planar_scene) + driving(LIBRARY[name], spatial_scene) == []


class Turned:
    """A mistake: the columns with the other sign."""

    def columns(self, scene: Scene) -> Columns:
        right: Columns = super().columns(scene)  # type: ignore[misc]
        return {row: -values for row, values in right.items()}


class OneSigned(Stribeck):
    """Friction over a speed whose amplitude may only be positive."""

    amplitudes = (Parameter("amplitude", "N·m", "friction at zero speed", low=0.0),)


class TurnedStribeck(Turned, Stribeck):
    """Of either sign."""


class TurnedOneSigned(Turned, OneSigned):
    """Of one sign."""


class TurnedLoadFriction(Turned, LoadFriction):
    """Without a shape."""


class TurnedTanh(Turned, TanhFriction):
    """In place of the joint's own."""


@pytest.mark.parametrize("kind", [TurnedStribeck, TurnedOneSigned, TurnedLoadFriction, TurnedTanh])
def test_friction_of_the_wrong_sign_is_seen(kind: type[Effect], planar_scene: Scene) -> None:
    assert driving(OneSigned, planar_scene) == []
    assert f"drives joint {1}" in driving(kind, planar_scene)[0]


def test_what_is_missing_is_said() -> None:
    class NoGrid(Effect):
        name = "no_grid"
        amplitudes = (Parameter("peak", "N·m", "largest torque"),)
        shapes = (Parameter("critical", "rad/s", "speed of the largest torque"),)

        def columns(self, scene: Scene) -> Columns:
            return {}

    said = missing(NoGrid)
    assert "no_grid: it has shapes and no `grid`, from which a search takes the first ones" in said
    assert any(line.startswith("no_grid: no `example`") for line in said)
