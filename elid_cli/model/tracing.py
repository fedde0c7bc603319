"""Trace arithmetic once, run it on blocks of samples.

The dynamics of a chain are written as ordinary scalar arithmetic (`kinematics.py`, `terms/`). Run on `Node`s
they record every operation; equal subexpressions become one node (hash-consing) and operations on constants
are folded, so that the zeros and ones of a robot's geometry cost nothing. The recorded program then runs as
NumPy ufunc calls with preallocated outputs on blocks that stay in cache, or as generated scalar Python for a
simulator that needs one sample at a time.
"""

from __future__ import annotations

BLOCK = 8160
"""Samples per block: long enough that NumPy's calls cost little, short enough that live rows stay in the cache."""

_ADD, _SUB, _MUL, NEG = range(4)
NAMES = ("add", "sub", "mul", "neg")


class Graph:
    """Operations recorded so far; inputs are the first nodes."""

    def __init__(self, inputs: int) -> None:
        self.inputs = inputs
        self.operations: list[tuple[int, object, object]] = []
        self._known: dict[tuple[int, object, object], Node] = {}

    def input(self, index: int) -> Node:
        """Return the node of input number `index`."""
        return Node(self, index)

    def record(self, code: int, a: Node | float, b: Node | float) -> Node:
        """Return the node of ``a code b``, the existing one where it was recorded before."""
        left: object = a.index if isinstance(a, Node) else (a,)
        right: object = b.index if isinstance(b, Node) else (b,)
        if code in (_ADD, _MUL) and _order(left) > _order(right):
            left, right = right, left
        key = (code, left, right)
        node = self._known.get(key)
        if node is None:
            node = Node(self, self.inputs + len(self.operations))
            self.operations.append(key)
            self._known[key] = node
        return node


def _order(operand: object) -> tuple[int, float]:
    return (1, float(operand[0])) if isinstance(operand, tuple) else (0, float(operand))  # type: ignore[arg-type]


class Node:
    """A value that is known when the program runs; behaves as a number under + - * and negation."""

    __slots__ = ("graph", "index")

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph = graph
        self.index = index

    def _negated(self) -> Node | None:
        position = self.index - self.graph.inputs
        if position < 0:
            return None
        code, operand, _ = self.graph.operations[position]
        return Node(self.graph, operand) if code == NEG and isinstance(operand, int) else None

    def __neg__(self) -> Node:
        inner = self._negated()
        return inner if inner is not None else self.graph.record(NEG, self, 0.0)

    def __add__(self, other: Scalar) -> Scalar:
        if not isinstance(other, Node):
            return self if other == 0 else self.graph.record(_ADD, self, float(other))
        inner = other._negated()
        if inner is not None:
            return self - inner
        inner = self._negated()
        if inner is not None:
            return other - inner
        return self.graph.record(_ADD, self, other)

    __radd__ = __add__

    def __sub__(self, other: Scalar) -> Scalar:
        if not isinstance(other, Node):
            return self if other == 0 else self.graph.record(_ADD, self, -float(other))
        if other.index == self.index:
            return 0.0
        inner = other._negated()
        if inner is not None:
            return self + inner
        inner = self._negated()
        if inner is not None:  # a sign outside is taken up by what follows, most often
            return -(inner + other)
        return self.graph.record(_SUB, self, other)

    def __rsub__(self, other: float) -> Scalar:
        inner = self._negated()
        if inner is not None:
            return inner + other
        return -self if other == 0 else self.graph.record(_SUB, float(other), self)

    def __mul__(self, other: Scalar) -> Scalar:
        if isinstance(other, Node):
            a, b = self._negated(), other._negated()
            if a is not None and b is not None:
                return a * b
            if a is not None:
                return -(a * other)
            if b is not None:
                return -(self * b)
            return self.graph.record(_MUL, self, other)
        if other == 0:
            return 0.0
        if other == 1:
            return self
        if other == -1:
            return -self
        inner = self._negated()
        if inner is not None:
            return -(inner * other)
        # of a factor and its negative one product is made, whose sign what follows takes up
        return -(self * -other) if other < 0 else self.graph.record(_MUL, self, float(other))

    __rmul__ = __mul__


Scalar = Node | float
"""A traced value or a constant."""
