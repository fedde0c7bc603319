"""Numbers as people write them in robot files: ``pi/2``, ``-2*pi/3``, ``1/160``, ``sqrt(2)/2``.

A tiny arithmetic evaluator over Python's syntax tree with a short list of allowed nodes; nothing is ever executed.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable

CONSTANTS = {"pi": math.pi, "π": math.pi}
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "radians": math.radians,
}
SMALLEST, LARGEST = 1e-100, 1e12
"""Sizes, in any of elid's units, that a number of a robot can have; rounding leaves numbers such as 1e-17."""
LONGEST = 200
"""Characters of an expression; longer text is not a number but an attempt to keep the parser busy."""

_BINARY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # of floats: overflows at once instead of computing a huge integer
}
_UNARY: dict[type[ast.unaryop], Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


def evaluate(text: str) -> float:
    """Return the finite value of a number or an arithmetic expression.

    Raises
    ------
    ValueError
        With a message fit for users: not a number, not finite, unknown name, division by zero.
    """
    text = text.strip()
    if not text:
        raise ValueError("empty, a number is needed")
    if len(text) > LONGEST:
        raise ValueError(f"an expression of {len(text)} characters; at most {LONGEST} are read")
    value = _plain(text)
    if value is None:
        try:
            value = _value(ast.parse(text, mode="eval").body)
        except (SyntaxError, RecursionError, MemoryError):
            raise ValueError(f"{text!r} is not a number") from None
        except ZeroDivisionError:
            raise ValueError(f"{text!r} divides by zero") from None
        except OverflowError:
            raise ValueError(f"{text!r} is not finite") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    if value and not SMALLEST < abs(value) < LARGEST:
        raise ValueError(f"{text!r} is no quantity of a robot: its size must lie between {SMALLEST:g} and {LARGEST:g}")
    return value


def _plain(text: str) -> float | None:
    """Return what float() makes of the text (YAML's .inf and .nan too), or None where it is no plain number."""
    bare = text.lower().lstrip("+-")
    if bare in (".inf", ".nan"):
        return math.inf
    try:
        return float(text)
    except ValueError:
        return None


def _value(node: ast.expr) -> float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        if node.id not in CONSTANTS:
            raise ValueError(f"{node.id!r} is not a number (known: pi, {', '.join(FUNCTIONS)})")
        return CONSTANTS[node.id]
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _defined(node, _BINARY[type(node.op)], _value(node.left), _value(node.right))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return _UNARY[type(node.op)](_value(node.operand))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1 and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise ValueError(f"unknown function {node.func.id!r} (known: {', '.join(FUNCTIONS)})")
        return _defined(node, FUNCTIONS[node.func.id], _value(node.args[0]))
    raise ValueError(f"{ast.unparse(node)!r} is not a number")


def _defined(node: ast.expr, function: Callable[..., float], *arguments: float) -> float:
    try:
        return function(*arguments)
    except ValueError:  # a negative number's root
        raise ValueError(f"{ast.unparse(node)!r} is not a real number") from None
