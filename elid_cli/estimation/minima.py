"""Least values of functions of a few unknowns.

SciPy has all three; its package of optimisers takes longer to import than they take here together.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elid_cli._types import Array

_GOLDEN = 0.5 * (3.0 - 5.0**0.5)
_SMALLEST = 2.2e-16**0.5
"""Relative distance of arguments below which a smooth function's values differ by rounding."""
_FALL = 1e-7
"""Relative fall of a sum of squares below which a step is the last."""
_DAMPED, _LESS, _MORE, _MOST = 1e-2, 0.1, 10.0, 1e8
"""First damping of a step, as a part of the largest curvature, and factors on it after steps that help or do not."""


def between(cost: Callable[[float], float], low: float, high: float, most: int, apart: float = 1e-5) -> float:
    """Return the argument of least cost in an interval by parabolas and golden sections (Brent 1973, fminbound).

    Parameters
    ----------
    cost
        A function with one valley.
    low, high
        The interval.
    most
        Most evaluations.
    apart
        Distance from the least at which it may end.
    """
    best = second = third = low + _GOLDEN * (high - low)
    least = after = last = cost(best)
    step = before = 0.0
    for _ in range(most - 1):
        middle = 0.5 * (low + high)
        near = _SMALLEST * abs(best) + apart / 3.0
        if abs(best - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        move = None
        if abs(before) > near:
            move = _parabola((best, least), (second, after), (third, last), (low, high), before)
        if move is None:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        else:
            before, step = step, move
            if min(best + step - low, high - best - step) < 2.0 * near:
                step = near if middle >= best else -near
        place = best + (max(abs(step), near) if step >= 0 else -max(abs(step), near))
        value = cost(place)
        if value <= least:
            low, high = (best, high) if place >= best else (low, best)
            third, last, second, after, best, least = second, after, best, least, place, value
            continue
        low, high = (place, high) if place < best else (low, place)
        if value <= after or second == best:
            third, last, second, after = second, after, place, value
        elif value <= last or third in (best, second):
            third, last = place, value
    return best


def _parabola(
    best: tuple[float, float],
    second: tuple[float, float],
    third: tuple[float, float],
    limits: tuple[float, float],
    before: float,
) -> float | None:
    """Return the move to the lowest point of a parabola through three points (place, cost), None where it is no use.

    It is none out of the interval, or where it is not half as far as the move before the last, `before`.
    """
    (place, value), (other, far) = best, second
    r = (place - other) * (value - third[1])
    q = (place - third[0]) * (value - far)
    p = (place - third[0]) * q - (place - other) * r
    q = 2.0 * (q - r)
    p, q = (-p, q) if q > 0.0 else (p, -q)
    inside = q * (limits[0] - place) < p < q * (limits[1] - place)
    return p / q if inside and abs(p) < abs(0.5 * q * before) else None


def by_simplex(cost: Callable[[Array], float], simplex: Array, most: int, apart: float = 1e-4) -> Array:
    """Return the arguments of least cost that a simplex (n + 1, n) of points comes to (Nelder and Mead 1965).

    It ends after about `most` evaluations, or where points and costs lie within `apart`.
    """
    points = simplex.copy()
    costs = np.array([cost(point) for point in points])
    used = len(points)
    while True:
        order = np.argsort(costs)
        points, costs = points[order], costs[order]
        if used >= most or max(np.abs(points[1:] - points[0]).max(), costs[-1] - costs[0]) <= apart:
            best: Array = points[0]
            return best
        centre = points[:-1].mean(axis=0)

        def along(by: float, centre: Array = centre, worst: Array = points[-1]) -> tuple[Array, float]:
            place = centre + by * (centre - worst)
            return place, cost(place)

        tried, value = along(1.0)
        used += 1
        if costs[0] <= value < costs[-2]:
            points[-1], costs[-1] = tried, value
            continue
        used += 1
        further, there = along(2.0 if value < costs[0] else 0.5 if value < costs[-1] else -0.5)
        if there < min(value, costs[-1]) or value < costs[0]:
            points[-1], costs[-1] = (further, there) if there < value else (tried, value)
            continue
        points[1:] = points[0] + 0.5 * (points[1:] - points[0])
        costs[1:] = [cost(point) for point in points[1:]]
        used += len(points) - 1


def least_squares(
    residual: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array], step: float, most: int
) -> tuple[Array, float]:
    """Return the arguments within bounds of the least sum of squares, and half of it (Levenberg, Marquardt).

    Parameters
    ----------
    residual
        What is squared and summed, (rows,).
    start
        First arguments, (n,).
    bounds
        Lowest and highest arguments, (n,) each.
    step
        Step of the differences that stand for derivatives.
    most
        Most steps that are tried.
    """
    low, high = bounds
    here, now = start, residual(start)
    cost, damping = 0.5 * float(now @ now), _DAMPED
    slopes: Array | None = None
    for _ in range(most):
        if slopes is None:
            slopes = _slopes(residual, here, now, np.where(here + step > high, -step, step))
        pull, curvature = slopes @ now, slopes @ slopes.T
        free = ~((here <= low) & (pull > 0) | (here >= high) & (pull < 0))
        move = np.zeros_like(here)
        size = damping * max(float(np.diag(curvature).max()), 1e-300)
        move[free] = -np.linalg.solve(curvature[np.ix_(free, free)] + size * np.eye(int(free.sum())), pull[free])
        place = np.clip(here + move, low, high)
        there = residual(place)
        value = 0.5 * float(there @ there)
        if not value < cost:
            damping *= _MORE
            if damping > _MOST or np.abs(place - here).max(initial=0.0) < _SMALLEST:
                break
            continue
        settled = cost - value < _FALL * cost
        here, now, cost, slopes, damping = place, there, value, None, damping * _LESS
        if settled:
            break
    return here, cost


def _slopes(residual: Callable[[Array], Array], here: Array, now: Array, steps: Array) -> Array:
    """Return the residual's derivatives by differences, (n, rows)."""
    found = np.empty((len(here), len(now)))
    for k, step in enumerate(steps):
        moved = here.copy()
        moved[k] += step
        found[k] = (residual(moved) - now) / (moved[k] - here[k])
    return found
