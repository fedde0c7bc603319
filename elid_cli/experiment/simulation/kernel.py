"""The robot without effects as one straight-line function per controller period, compiled where Numba is installed.

It is the arithmetic of `System.step` written out, without lists in between, for the robot in its base parameters.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.compiling import compiled, has_numba
from elid_cli.errors import RobotError
from elid_cli.experiment.simulation.compiled_periods import periods_source
from elid_cli.model.base_parameters import find_base
from elid_cli.model.dynamics import Dynamics

WORTH = 200_000
"""Evaluations of the dynamics from which compiling them, a few seconds, pays."""

TRIED, SAME = 5, 1e-9
"""Random states at which a robot in its base parameters must move as described, and how nearly."""

Numbers = tuple[float, ...]


class Kernel:
    """Motion of a robot without effects under torques that are held.

    Parameters
    ----------
    dynamics
        The robot.
    evaluations
        How often its dynamics will be evaluated.
    """

    def __init__(self, dynamics: Dynamics, evaluations: int) -> None:
        self.compiled = evaluations >= WORTH and has_numba()
        sources = _sources(_regrouped(dynamics))
        # Numba keeps what it compiled by name, place and bytecode, which does not hold the numbers: the name must
        mark = hashlib.sha256("".join(text for _, text in sources).encode()).hexdigest()[:16]
        scope: dict[str, Any] = {"__name__": __name__, "sin": math.sin, "cos": math.cos, "tanh": math.tanh, "np": np}
        for name, text in sources:
            marked = text.replace(f"def {name}(", f"def {name}_{mark}(", 1)
            exec(compile(marked, __file__, "exec"), scope)  # the text holds nothing but the names below and numbers
            scope[name] = compiled(scope[f"{name}_{mark}"]) if self.compiled else scope[f"{name}_{mark}"]
        self._accelerations: Callable[..., Numbers] = scope["accelerations"]
        self._advance: Callable[..., Numbers] = scope["advance"]
        self.through: Callable[..., Array] | None = scope["through"] if self.compiled else None
        """Steps of `ExactSprings`, where compiled."""
        self.periods: Callable[..., tuple[int, int]] | None = scope["periods"] if self.compiled else None
        """Controller periods of `ExactSprings.follow`, where compiled (`compiled_periods.py`)."""

    def accelerations(self, x: Sequence[float], tau: Sequence[float]) -> Numbers:
        """Return q'' and θ'' of the elastic joints at a state of `System`; not finite where there are none."""
        return _tried(self._accelerations, *x, *tau)

    def advance(self, x: Sequence[float], tau: Sequence[float], h: float, steps: int) -> Numbers:
        """Return the state after some steps of h s; not finite where the motion gets no further."""
        return _tried(self._advance, h, steps, *x, *tau)


def _regrouped(dynamics: Dynamics) -> Dynamics:
    """Return the same robot described by its base parameters alone, all others 0: the same motion, fewer operations."""
    base = find_base(dynamics.model)
    parameters = np.zeros_like(dynamics.parameters)
    parameters[base.leaders] = base.transform @ dynamics.parameters
    found = dynamics.described_by(parameters)
    return found if _moves_alike(found, dynamics) else dynamics


def _moves_alike(one: Dynamics, other: Dynamics) -> bool:
    """Whether two descriptions move the same: right angles that a file rounds make base parameters nearly dependent."""
    n, draw = one.robot.n, np.random.default_rng(0)
    nothing = [0.0] * n
    for q, dq, tau in draw.uniform(-1.0, 1.0, (TRIED, 3, n)).tolist():
        try:
            ours, theirs = (np.concatenate(each.solve(q, dq, dq, nothing, nothing, tau)) for each in (one, other))
        except (RobotError, ValueError):  # where it cannot move, either says so
            return False
        if not np.abs(ours - theirs).max() <= SAME * np.abs(theirs).max():
            return False
    return True


def _tried(function: Callable[..., Numbers], *numbers: float) -> Numbers:
    try:
        return function(*numbers)
    except (ValueError, OverflowError):  # compiled functions return NaN where Python's raise
        return (math.nan,)


def _sources(dynamics: Dynamics) -> list[tuple[str, str]]:
    n, elastic = dynamics.robot.n, dynamics.elastic
    half = n + len(elastic)
    state = [f"x{i}" for i in range(2 * half)]
    torque = [f"f{k}" for k in range(n)]
    statements, results = dynamics.statements()
    motor = {k: n + i for i, k in enumerate(elastic)}
    lines = [f"def accelerations({', '.join([*state, *torque])}):"]
    for k in range(n):
        place = motor.get(k, k)
        lines += [f"q{k} = x{k}", f"v{k} = x{half + k}", f"w{k} = x{half + place}", f"g{k} = x{k} - x{place}"]
    nothing = f"return {', '.join(['1e999'] * half)},"
    lines += [line.split("return")[0] + nothing if "return" in line else line for line in statements]
    lines.append(f"return {', '.join(results)},")  # a tuple of one, too
    return [
        ("accelerations", "\n ".join(lines)),
        ("advance", _runge_kutta(half, state, torque)),
        ("through", _exponential(half, n)),
        ("periods", periods_source(half, n)),
    ]


def _runge_kutta(half: int, state: Sequence[str], torque: Sequence[str]) -> str:
    """Return `System.step`, `steps` times: positions are states 0 to half, their rates the others."""
    lines = [f"def advance(h, steps, {', '.join([*state, *torque])}):", " half, sixth = 0.5 * h, h / 6.0",
             " for _ in range(steps):"]  # fmt: skip
    before = ["", "half", "half", "h"]
    at = list(state)
    rates: list[list[str]] = []
    for stage, step in enumerate(before):
        if stage:
            at = [f"y{stage}_{i}" for i in range(2 * half)]
            lines += [f"  {name} = x{i} + {step} * {rates[-1][i]}" for i, name in enumerate(at)]
        found = [f"a{stage}_{i}" for i in range(half)]
        lines.append(f"  {', '.join(found)}, = accelerations({', '.join([*at, *torque])})")
        rates.append([*at[half:], *found])
    k1, k2, k3, k4 = rates
    lines += [f"  z{i} = x{i} + sixth * ({k1[i]} + 2.0 * ({k2[i]} + {k3[i]}) + {k4[i]})" for i in range(2 * half)]
    lines += [f"  x{i} = z{i}" for i in range(2 * half)]
    lines.append(f" return {', '.join(state)}")
    return "\n".join(lines)


def _exponential(half: int, n: int) -> str:
    """Return `ExactSprings._stepped`; a sum runs in the order of its terms."""

    def rates(place: str, source: str) -> list[str]:
        states = [f"{source}[{i}]" for i in range(2 * half)]
        return [f"found = accelerations({', '.join([*states, *(f'tau[{k}]' for k in range(n))])})",
                *(f"z[{place} + {i}] = found[{i}]" for i in range(half))]  # fmt: skip

    def product(matrix: str, width: str, source: str, store: str) -> list[str]:
        return [f"for i in range({matrix}.shape[0]):", " total = 0.0", f" for j in range({width}):",
                f"  total += {matrix}[i, j] * {source}[j]", f" {store}"]  # fmt: skip

    size = 2 * half
    lines = [f"z, x, at = np.empty({size + 4 * half}), x.copy(), np.empty({size})", "for number in range(steps):"]
    step = [f"z[:{size}] = x", "if number == 0:", f" z[{size}:{size + half}] = start", "else:",
            *(f" {line}" for line in rates(str(size), "x")),
            *product("linear", str(size), "x", f"z[{size} + i] -= total")]  # fmt: skip
    for stage, weight in enumerate(("first", "second", "third"), 1):
        end = size + stage * half
        step += [*product(weight, str(end), "z", "at[i] = total"), *rates(str(end), "at"),
                 *product("linear", str(size), "at", f"z[{end} + i] -= total")]  # fmt: skip
    step += product("last", str(size + 4 * half), "z", "x[i] = total")
    head = "def through(x, tau, start, linear, first, second, third, last, steps):"
    return "\n ".join([head, *lines, *(f" {line}" for line in step), "return x"])
