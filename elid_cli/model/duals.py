"""Derivatives of traced scalars by their inputs: arithmetic that carries them along (forward mode)."""

from __future__ import annotations

from collections.abc import Mapping

from elid_cli.model.tracing import Scalar


class Dual:
    """A scalar with its derivatives by some inputs, those that are zero left out.

    Takes the place of a traced scalar in kinematics and terms, which only add, subtract and multiply.
    """

    __slots__ = ("slopes", "value")

    def __init__(self, value: Scalar, slopes: Mapping[int, Scalar] | None = None) -> None:
        self.value = value
        self.slopes = dict(slopes or {})

    def __neg__(self) -> Dual:
        return Dual(-self.value, {k: -slope for k, slope in self.slopes.items()})

    def __add__(self, other: Dual | Scalar) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.value + other, self.slopes)
        slopes = dict(self.slopes)
        for k, slope in other.slopes.items():
            slopes[k] = slopes[k] + slope if k in slopes else slope
        return Dual(self.value + other.value, slopes)

    __radd__ = __add__

    def __sub__(self, other: Dual | Scalar) -> Dual:
        return self + (-other)

    def __rsub__(self, other: Scalar) -> Dual:
        return -self + other

    def __mul__(self, other: Dual | Scalar) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.value * other, {k: slope * other for k, slope in self.slopes.items() if _there(other)})
        slopes = {k: slope * other.value for k, slope in self.slopes.items() if _there(other.value)}
        for k, slope in other.slopes.items():
            if _there(self.value):
                slopes[k] = slopes[k] + slope * self.value if k in slopes else slope * self.value
        return Dual(self.value * other.value, slopes)

    __rmul__ = __mul__


def _there(value: Scalar) -> bool:
    return not (isinstance(value, float) and value == 0.0)
