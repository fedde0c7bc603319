"""Programs: traced operations in an order and in few arrays, run on blocks of samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import or_
from typing import cast

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.tracing import BLOCK, NAMES, NEG, Graph, Node, Scalar


@dataclass(frozen=True)
class Program:
    """A traced function: `inputs` rows of samples to `outputs` rows of samples.

    An instruction is (ufunc, left, right, target). Operands are slots (int), or constants (1-tuples).
    Slots: inputs first, then `registers`, then outputs. Constant outputs are in `constants`, outputs that
    repeat another slot in `copies`.
    """

    inputs: int
    outputs: int
    registers: int
    instructions: tuple[tuple[int, object, object, int], ...]
    constants: tuple[tuple[int, float], ...]
    copies: tuple[tuple[int, int], ...]

    def run(self, rows: Array, out: Array, constants: Sequence[Array] = ()) -> None:
        """Evaluate on samples: `rows` (inputs, N), `out` (outputs, N), both C-contiguous in samples.

        Inputs that follow those in `rows` may be the same at all samples: `constants`, arrays of no dimension.
        Memory beyond the arguments is one block of registers, which is kept for the next call.
        """
        samples = rows.shape[1]
        for position, value in self.constants:
            out[position] = value
        block = min(BLOCK, max(samples, 1))
        # a register row starts on its own cache lines, an odd number of them after the last: rows a power of two apart
        # would fall on the same lines of a set-associative cache
        registers = self._rooms.pop() if self._rooms else np.empty((self.registers, BLOCK + 8))
        bound: list[object] = [None] * (self.inputs + self.registers + self.outputs)
        bound[self.inputs : self.inputs + self.registers] = [row[:block] for row in registers]
        for start in range(0, samples, block):
            stop = min(start + block, samples)
            if stop - start < block:
                bound[self.inputs : self.inputs + self.registers] = [row[: stop - start] for row in registers]
            bound[: self.inputs] = [*rows[:, start:stop], *constants]
            bound[self.inputs + self.registers :] = list(out[:, start:stop])
            self._blockwise(bound)
            for target, source in self.copies:
                bound[target][:] = bound[source]  # type: ignore[index]
        self._rooms.append(registers)

    @cached_property
    def _rooms(self) -> list[Array]:
        """Registers of calls that have ended: memory touched for the first time costs as much as the arithmetic."""
        return []

    @cached_property
    def _operands(self) -> frozenset[int]:
        """Slots that instructions read."""
        return frozenset(operand for _, a, b, _ in self.instructions for operand in (a, b) if isinstance(operand, int))

    @cached_property
    def used(self) -> frozenset[int]:
        """Inputs that the program reads."""
        return frozenset(s for s in self._operands | {source for _, source in self.copies} if s < self.inputs)

    @cached_property
    def reads(self) -> tuple[int, ...]:
        """Which inputs every output depends on, as a mask of bits per output."""
        masks = {slot: 1 << slot for slot in range(self.inputs)}
        for _, a, b, target in self.instructions:  # in their order: registers are used again
            operands = (masks.get(operand, 0) for operand in (a, b) if isinstance(operand, int))
            masks[target] = reduce(or_, operands, 0)
        for target, source in self.copies:
            masks[target] = masks.get(source, 0)
        first = self.inputs + self.registers
        return tuple(masks.get(first + output, 0) for output in range(self.outputs))

    @cached_property
    def _blockwise(self) -> Callable[[list[object]], None]:
        """The instructions as one Python function of the slots' rows: a loop over them would cost a third more."""
        scope: dict[str, object] = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "neg": np.negative}
        names = [f"s{k}" for k in range(self.inputs + self.registers + self.outputs)]

        def text(operand: object) -> str:
            if isinstance(operand, int):
                return names[operand]
            # an array of no dimension is taken by a ufunc faster than a Python float
            name = f"c{len(scope)}"
            scope[name] = np.array(operand[0])  # type: ignore[index]
            return name

        lines = ["def traced(slots):", f" {', '.join(names)}, = slots"]
        for code, a, b, target in self.instructions:
            operands = text(a) if code == NEG else f"{text(a)}, {text(b)}"
            lines.append(f" {NAMES[code]}({operands}, {names[target]})")
        exec("\n".join(lines), scope)  # the text holds nothing but slots and constants
        return cast(Callable[[list[object]], None], scope["traced"])

    @cached_property
    def distinct(self) -> tuple[Program, NDArray[np.intp]]:
        """The program without outputs that repeat another, and which of its outputs each of this program's is."""
        first = self.inputs + self.registers
        kept: list[int] = []
        place = np.empty(self.outputs, dtype=np.intp)
        sources: dict[int, int] = {}
        repeated = dict(self.copies)
        for slot in range(first, first + self.outputs):
            source = repeated.get(slot, slot)
            if source not in sources:
                sources[source] = len(kept)
                kept.append(slot)
            place[slot - first] = sources[source]
        number = {slot: slot for slot in range(first)} | {slot: first + k for k, slot in enumerate(kept)}

        def moved(operand: object) -> object:
            return number[operand] if isinstance(operand, int) else operand

        instructions = tuple((code, moved(a), moved(b), number[target]) for code, a, b, target in self.instructions)
        constants = tuple((number[first + k] - first, value) for k, value in self.constants)
        copies = tuple((number[target], source) for target, source in self.copies if target in number)
        return Program(self.inputs, len(kept), self.registers, instructions, constants, copies), place

    def copied(self, inputs: Sequence[int]) -> list[tuple[int, int]] | None:
        """Return (output, position in `inputs`) of every output that is one of these inputs.

        None where the program does anything else with them.
        """
        asked = {slot: position for position, slot in enumerate(inputs)}
        if not self._operands.isdisjoint(asked):
            return None
        first = self.inputs + self.registers
        return [(target - first, asked[source]) for target, source in self.copies if source in asked]

    def statements(self, inputs: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the same function for one sample as scalar statements, and what its outputs are called after them.

        Inputs are called as given; the names r0, r1, … and o0, o1, … are taken.
        """
        names = [*inputs, *(f"r{i}" for i in range(self.registers)), *(f"o{i}" for i in range(self.outputs))]

        def text(operand: object) -> str:
            return names[operand] if isinstance(operand, int) else repr(operand[0])  # type: ignore[index]

        lines = []
        for code, a, b, target in self.instructions:
            value = f"-{text(a)}" if code == NEG else f"{text(a)} {'+-*'[code]} {text(b)}"
            lines.append(f"{names[target]} = {value}")
        lines += [f"{names[target]} = {names[source]}" for target, source in self.copies]
        fixed = {position: repr(value) for position, value in self.constants}
        return lines, [fixed.get(i, f"o{i}") for i in range(self.outputs)]

    def scalar(self) -> Callable[[Sequence[float]], list[float]]:
        """Return the same function for one sample: a list of inputs to a list of outputs (plain Python floats)."""
        statements, outputs = self.statements([f"i{i}" for i in range(self.inputs)])
        lines = ["def traced(x):", *(f" i{i} = x[{i}]" for i in sorted(self.used))]
        lines += [f" {line}" for line in statements]
        lines.append(f" return [{', '.join(outputs)}]")
        scope: dict[str, Callable[[Sequence[float]], list[float]]] = {}
        exec("\n".join(lines), scope)  # the text holds nothing but the numbers and slots above
        return scope["traced"]


def compile_program(graph: Graph, outputs: Sequence[Scalar]) -> Program:
    """Turn recorded nodes into a program that computes `outputs` and nothing else, reusing registers."""
    constants = tuple((k, float(o)) for k, o in enumerate(outputs) if not isinstance(o, Node))
    first_output: dict[int, int] = {}
    repeats: list[tuple[int, int]] = []
    for k, value in enumerate(outputs):
        if isinstance(value, Node):
            if value.index in first_output or value.index < graph.inputs:
                repeats.append((k, value.index))
            else:
                first_output[value.index] = k

    order = _scheduled(graph, [value for value in outputs if isinstance(value, Node)])
    last_use = {operand: index for index in order for operand in _operands(graph, index)}
    slot: dict[int, int] = {i: i for i in range(graph.inputs)}
    free: list[int] = []
    count = 0
    pending: list[tuple[int, object, object, int]] = []
    for index in order:
        code, a, b = graph.operations[index - graph.inputs]
        left = slot[a] if isinstance(a, int) else a
        right = slot[b] if isinstance(b, int) else b
        for operand in {o for o in (a, b) if isinstance(o, int)}:
            if operand >= graph.inputs and operand not in first_output and last_use[operand] == index:
                free.append(slot[operand])
        if index in first_output:
            target = -1 - first_output[index]
        elif free:
            target = free.pop()
        else:
            target = graph.inputs + count
            count += 1
        slot[index] = target
        pending.append((code, left, right, target))

    def place(operand: object) -> object:
        return graph.inputs + count - 1 - operand if isinstance(operand, int) and operand < 0 else operand

    base = graph.inputs + count
    instructions = tuple((code, place(a), place(b), int(place(t))) for code, a, b, t in pending)  # type: ignore[call-overload]
    copies = tuple((base + k, int(place(slot[index]))) for k, index in repeats)  # type: ignore[call-overload]
    return Program(graph.inputs, len(outputs), count, instructions, constants, copies)


def _scheduled(graph: Graph, outputs: Sequence[Node]) -> list[int]:
    """Return the operations that outputs need, each after its operands and as late as possible.

    Outputs are taken in the order in which they were recorded, which is body by body, so that few values live at a
    time and stay in the cache.
    """
    order: list[int] = []
    done: set[int] = set()
    for output in sorted({node.index for node in outputs}):
        stack = [output]
        while stack:
            index = stack[-1]
            waiting = [k for k in _operands(graph, index) if k >= graph.inputs and k not in done]
            if index in done or index < graph.inputs or not waiting:
                stack.pop()
                if index >= graph.inputs and index not in done:
                    done.add(index)
                    order.append(index)
            else:
                stack += waiting
    return order


def _operands(graph: Graph, index: int) -> list[int]:
    if index < graph.inputs:
        return []
    _, a, b = graph.operations[index - graph.inputs]
    return [operand for operand in (a, b) if isinstance(operand, int)]
