"""Student's t without SciPy's special functions, whose import would take as long as a short log."""

from __future__ import annotations

import math

import numpy as np

MANY = 400.0
"""Degrees of freedom from which on Student's t is the normal distribution."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def student_quantile(degrees: float, probability: float) -> float:
    """Return the quantile of Student's t with `degrees` (1 or more) of freedom at a probability from 0.5 to 0.999.

    Substituting t = sqrt(d) tan(a) makes the density proportional to cos(a)^(d - 1) on a finite interval, which is
    integrated by Gauss's rule and solved by Newton's.
    """
    constant = math.exp(math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)) / math.sqrt(math.pi)
    angle = math.atan(2.0 / math.sqrt(degrees))
    for _ in range(50):
        half = angle / 2
        area = constant * half * float(_WEIGHTS @ np.cos(half * (_NODES + 1)) ** (degrees - 1))
        step = (area - (probability - 0.5)) / (constant * math.cos(angle) ** (degrees - 1))
        angle = min(max(angle - step, angle / 2), (angle + math.pi / 2) / 2)
        if abs(step) < 1e-13:
            break
    return math.sqrt(degrees) * math.tan(angle)


def beyond_normal(degrees: float) -> float:
    """Return how many times wider than the normal distribution's Student's interval of 95 % is, at least 1."""
    return student_quantile(max(degrees, 1.0), 0.975) / 1.96 if degrees < MANY else 1.0
