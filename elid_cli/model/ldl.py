"""Solve small symmetric positive definite systems in plain Python: straight-line code written for each size.

A simulator solves one such system some hundred thousand times; for a dozen unknowns a call into LAPACK costs more
than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache


class NotPositiveError(ValueError):
    """A pivot is not positive; `pivot` counts unknowns from 0."""

    def __init__(self, pivot: int) -> None:
        super().__init__(f"pivot {pivot} is not positive")
        self.pivot = pivot


@cache
def ldl_solver(n: int) -> Callable[[list[float]], list[float]]:
    """Return a function that solves A x = b for symmetric A of size n.

    Its argument is one list: b, then A's upper triangle by rows; what follows is not looked at.

    Raises
    ------
    NotPositiveError
        (from the returned function) A is not positive definite.

    """
    place = {}
    position = n
    for i in range(n):
        for j in range(i, n):
            place[i, j] = position
            position += 1
    lines = ["def solve(x):"]
    # A = L D L'; u_kj = d_k l_jk, rows of the upper triangle
    for k in range(n):
        for j in range(k, n):
            products = "".join(f" - l{k}_{i} * u{i}_{j}" for i in range(k))
            lines.append(f" u{k}_{j} = x[{place[k, j]}]{products}")
        lines.append(f" if not u{k}_{k} > 0.0: raise NotPositiveError({k})")
        lines += [f" l{j}_{k} = u{k}_{j} / u{k}_{k}" for j in range(k + 1, n)]
    for k in range(n):
        lines.append(f" y{k} = x[{k}]" + "".join(f" - l{k}_{i} * y{i}" for i in range(k)))
    for k in reversed(range(n)):
        lines.append(f" y{k} = y{k} / u{k}_{k}" + "".join(f" - l{i}_{k} * y{i}" for i in range(k + 1, n)))
    lines.append(f" return [{', '.join(f'y{k}' for k in range(n))}]")
    scope: dict[str, object] = {"NotPositiveError": NotPositiveError}
    exec("\n".join(lines), scope)  # the text holds nothing but the names above
    return scope["solve"]  # type: ignore[return-value]
