"""Expressions as straight code for a small stack machine.

A `Program` holds the code of every selection, calculation, transformation, attribute and leaf of a
graph, one after the other. `run` interprets it in kernels, `Program.evaluate` in plain Python; they
agree bit for bit. Every result is checked: NaN or infinity is a fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import SourceSpan
from pcsg.graph.columns import Column, Lookup
from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.jit import build_ladder, njit, plain
from pcsg.vec import Affine, Vec3, load_affine

# Operation codes. An instruction is three int32: code, a, b.
END, CONSTANT, LOAD, STORE, JUMP, JUMP_IF_ZERO, TRUTH = range(7)
_FORM_CODE = {
    Form.UNARY: 7,
    Form.BINARY: 8,
    Form.TERNARY: 9,
    Form.RANDOM: 10,
    Form.WORLD: 11,
    Form.COLUMN: 12,
}
UNARY, BINARY, TERNARY, RANDOM, WORLD, COLUMN = _FORM_CODE.values()

# What went wrong.
OK, NOT_FINITE, UNASSIGNED = range(3)

_BY_FORM = {form: [f for f in FUNCTIONS.values() if f.form is form] for form in Form}
NUMBER_OF = {f.name: k for fs in _BY_FORM.values() for k, f in enumerate(fs)}
"""The number of every function among those of its form."""

call_unary = build_ladder("unary", "f", ["a"], [f.kernel for f in _BY_FORM[Form.UNARY]], "a")
call_binary = build_ladder(
    "binary", "f", ["a", "b"], [f.kernel for f in _BY_FORM[Form.BINARY]], "a"
)
call_ternary = build_ladder(
    "ternary", "f", ["a", "b", "c"], [f.kernel for f in _BY_FORM[Form.TERNARY]], "a"
)
call_random = build_ladder(
    "random",
    "f",
    ["stack", "at", "count", "seeds"],
    [f.kernel for f in _BY_FORM[Form.RANDOM]],
    "0.0",
)
call_world = build_ladder(
    "world", "f", ["frame", "point"], [f.kernel for f in _BY_FORM[Form.WORLD]], "0.0"
)


@njit
def run(
    code: NDArray[np.int32],
    constants: NDArray[np.float64],
    at: int,
    frame_slot: int,
    params: NDArray[np.float64],
    slots: int,
    stack: NDArray[np.float64],
) -> tuple[int, int]:
    """Interpret code until END.

    Parameters
    ----------
    code, constants
        The program's arrays.
    at
        Index of the first instruction.
    frame_slot
        First of the 12 parameter slots that hold world_from_local; unused without world queries.
    params, slots
        Parameter values are ``params[slots:]``; STORE changes them.
    stack
        Working space; what the code leaves begins at ``stack[0]``.

    Returns
    -------
    status, instruction
        OK, or what went wrong and the index of the instruction that found it.
    """
    n = 0
    while True:
        i = 3 * at
        op, a, b = code[i], code[i + 1], code[i + 2]
        if op == END:
            return OK, at
        if op == CONSTANT:
            stack[n] = constants[a]
            n += 1
        elif op == LOAD:
            x = params[slots + a]
            if x != x:
                return UNASSIGNED, at
            stack[n] = x
            n += 1
        elif op == STORE:
            n -= 1
            params[slots + a] = stack[n]
        elif op == JUMP:
            at = a
            continue
        elif op == JUMP_IF_ZERO:
            n -= 1
            if stack[n] == 0.0:
                at = a
                continue
        elif op == TRUTH:
            stack[n - 1] = 1.0 if stack[n - 1] != 0.0 else 0.0
        else:
            if op == UNARY:
                x = call_unary(a, stack[n - 1])
            elif op == BINARY:
                n -= 1
                x = call_binary(a, stack[n - 1], stack[n])
            elif op == TERNARY:
                n -= 2
                x = call_ternary(a, stack[n - 1], stack[n], stack[n + 1])
            elif op == RANDOM:
                count, seeds = b & 0xFFFF, b >> 16
                n -= count - 1
                x = call_random(a, stack, n - 1, count, seeds)
            elif op == COLUMN:
                # Rows count from 1; columns stand behind the constants.
                row = stack[n - 1]
                x = constants[a + int(row) - 1] if row >= 1.0 and row <= b else np.nan
            else:
                n -= 2
                point = Vec3(stack[n - 1], stack[n], stack[n + 1])
                x = call_world(a, load_affine(params, slots + frame_slot), point)
            stack[n - 1] = x
            if x - x != 0.0:
                return NOT_FINITE, at
        at += 1


@dataclass
class Fault(Exception):
    """A check failed while code ran in plain Python."""

    status: int
    instruction: int


@dataclass
class Program:
    """Code of many expressions over one set of parameter slots.

    Attributes
    ----------
    slots
        Number of every parameter, by name.
    frame_slot
        First of the 12 slots of world_from_local, -1 without world queries.
    """

    slots: Mapping[str, int]
    frame_slot: int = -1
    _code: list[tuple[int, int, int]] = field(default_factory=list)
    _constants: list[float] = field(default_factory=list)
    _constant_index: dict[float | str, int] = field(default_factory=dict)
    _columns: list[Column] = field(default_factory=list)
    _column_index: dict[tuple[str, str], int] = field(default_factory=dict)
    exprs: list[Expr | None] = field(default_factory=list)
    stack_size: int = 1

    def add(self, exprs: Sequence[Expr], stores: Sequence[str] = ()) -> int:
        """Append code and return where it begins.

        The values of the expressions are left on the stack; with `stores`, each is assigned to the
        parameter of that name before the next one is evaluated.
        """
        start = len(self._code)
        depth = 0
        for k, expr in enumerate(exprs):
            if isinstance(expr, Number):  # most are
                self._emit(CONSTANT, self._constant(expr.value), 0, expr)
                depth += 1
                self.stack_size = max(self.stack_size, depth + 2)
            else:
                depth = self._add_expr(expr, depth)
            if stores:
                self._emit(STORE, self.slots[stores[k]], 0, expr)
                depth -= 1
        self._emit(END, 0, 0, None)
        return start

    def add_parallel(self, exprs: Sequence[Expr], stores: Sequence[str]) -> int:
        """Append code that evaluates all expressions first and assigns them afterwards."""
        start = len(self._code)
        depth = 0
        for expr in exprs:
            depth = self._add_expr(expr, depth)
        for expr, name in zip(reversed(exprs), reversed(stores), strict=True):
            self._emit(STORE, self.slots[name], 0, expr)
        self._emit(END, 0, 0, None)
        return start

    def arrays(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Return the code (flat, three int32 an instruction) and the constants for `run`."""
        code = np.array(self._code or [(END, 0, 0)], dtype=np.int32)
        columns = self._columns
        # Code names a column by its number; behind the constants it begins somewhere.
        begins = np.cumsum([len(self._constants), *map(len, columns)])
        reads = code[:, 0] == COLUMN
        code[reads, 1] = begins[code[reads, 1]]
        constants = np.array(self._constants or [0.0])
        if columns:
            constants = np.concatenate([self._constants, *(column.values for column in columns)])
        return code.ravel(), constants

    def span(self, instruction: int) -> SourceSpan | None:
        """Return the place in the text that an instruction comes from."""
        expr = self.exprs[instruction]
        return getattr(expr, "span", None)

    def _emit(self, op: int, a: int, b: int, expr: Expr | None) -> int:
        self._code.append((op, a, b))
        self.exprs.append(expr)
        return len(self._code) - 1

    def _constant(self, value: float) -> int:
        # Two zeros are equal and not the same.
        key = value or value.hex()
        index = self._constant_index.setdefault(key, len(self._constants))
        if index == len(self._constants):
            self._constants.append(value)
        return index

    def _add_expr(self, root: Expr, depth: int) -> int:
        """Append the code of one expression; `depth` is the height of the stack before it."""
        # A work list of expressions still to do and of what follows them, instead of recursion.
        work: list[tuple[str, Expr, int]] = [("expr", root, 0)]
        patches: list[int] = []
        while work:
            what, expr, k = work.pop()
            args = operands(expr)
            if what == "expr":
                depth = self._begin(expr, work, depth)
            elif what == "apply":
                assert isinstance(expr, Apply)
                depth = self._finish(expr, depth)
            elif what == "fold":
                self._emit(BINARY, NUMBER_OF[expr.function], 0, expr)  # type: ignore[attr-defined]
                depth -= 1
            elif what == "test":  # the condition is on the stack
                patches.append(self._emit(JUMP_IF_ZERO, 0, 0, expr))
                depth -= 1
            elif what == "else":  # the first branch is on the stack
                jump = self._emit(JUMP, 0, 0, expr)
                self._patch(patches.pop())
                patches.append(jump)
                depth -= 1
            elif what == "constant":
                self._emit(CONSTANT, self._constant(float(k)), 0, expr)
                depth += 1
            elif what == "truth":
                self._emit(TRUTH, 0, 0, expr)
            elif what == "end":
                self._patch(patches.pop())
            self.stack_size = max(self.stack_size, depth + len(args) + 2)
        return depth

    def _begin(self, expr: Expr, work: list[tuple[str, Expr, int]], depth: int) -> int:
        """Emit a leaf of the expression, or plan the parts of an application in reverse."""
        if isinstance(expr, Number):
            self._emit(CONSTANT, self._constant(expr.value), 0, expr)
            return depth + 1
        if isinstance(expr, Parameter):
            self._emit(LOAD, self.slots[expr.name], 0, expr)
            return depth + 1
        assert isinstance(expr, Apply)
        function = FUNCTIONS[expr.function]
        plan: list[tuple[str, Expr, int]]
        if expr.function == "if":
            c, a, b = expr.args
            plan = [("expr", c, 0), ("test", expr, 0), ("expr", a, 0), ("else", expr, 0)]
            plan += [("expr", b, 0), ("end", expr, 0)]
        elif expr.function == "and":
            a, b = expr.args
            plan = [("expr", a, 0), ("test", expr, 0), ("expr", b, 0), ("truth", expr, 0)]
            plan += [("else", expr, 0), ("constant", expr, 0), ("end", expr, 0)]
        elif expr.function == "or":
            a, b = expr.args
            plan = [("expr", a, 0), ("test", expr, 0), ("constant", expr, 1), ("else", expr, 0)]
            plan += [("expr", b, 0), ("truth", expr, 0), ("end", expr, 0)]
        elif function.form is Form.BINARY and len(expr.args) != 2:
            plan = [("expr", expr.args[0], 0)]
            for arg in expr.args[1:]:
                plan += [("expr", arg, 0), ("fold", expr, 0)]
        else:
            plan = [*(("expr", arg, 0) for arg in expr.args), ("apply", expr, 0)]
        work.extend(reversed(plan))
        return depth

    def _finish(self, expr: Apply, depth: int) -> int:
        form = FUNCTIONS[expr.function].form
        count = len(expr.args)
        if isinstance(expr, Lookup):
            assert expr.column is not None
            number = self._column_index.setdefault(expr.column.key, len(self._columns))
            if number == len(self._columns):
                self._columns.append(expr.column)
            self._emit(COLUMN, number, len(expr.column), expr)
            return depth
        detail = count | expr.seeds << 16 if form is Form.RANDOM else 0
        self._emit(_FORM_CODE[form], NUMBER_OF[expr.function], detail, expr)
        return depth - count + 1

    def _patch(self, jump: int) -> None:
        op, _, b = self._code[jump]
        self._code[jump] = (op, len(self._code), b)

    def evaluate(self, at: int, params: list[float]) -> list[float]:
        """Run code in plain Python: the reference of `run`.

        Parameters
        ----------
        params
            Value of every slot; NaN where nothing was assigned. STORE changes it.

        Returns
        -------
        list of float
            What the code leaves on the stack.

        Raises
        ------
        Fault
            A result is not finite, or a parameter was never assigned.
        """
        stack: list[float] = []
        code = self._code
        with np.errstate(all="ignore"):
            while True:
                op, a, b = code[at]
                if op == END:
                    return stack
                if op == CONSTANT:
                    stack.append(self._constants[a])
                elif op == LOAD:
                    if math.isnan(params[a]):
                        raise Fault(UNASSIGNED, at)
                    stack.append(params[a])
                elif op == STORE:
                    params[a] = stack.pop()
                elif op == JUMP:
                    at = a
                    continue
                elif op == JUMP_IF_ZERO:
                    if stack.pop() == 0.0:
                        at = a
                        continue
                elif op == TRUTH:
                    stack[-1] = 1.0 if stack[-1] != 0.0 else 0.0
                else:
                    try:
                        x = self._apply(op, a, b, stack, params)
                    except (ValueError, OverflowError, ZeroDivisionError):
                        x = math.nan
                    if not math.isfinite(x):
                        raise Fault(NOT_FINITE, at)
                    stack.append(x)
                at += 1

    def _apply(self, op: int, a: int, b: int, stack: list[float], params: list[float]) -> float:
        """Pop the arguments of a function and return its value; it may raise where it has none."""
        if op == COLUMN:
            return self._columns[a].at(stack.pop())
        kernel = _twins(op)[a]
        if op == BINARY:
            right = stack.pop()
            return float(kernel(stack.pop(), right))
        if op == UNARY:
            return float(kernel(stack.pop()))
        count = b & 0xFFFF if op == RANDOM else 3
        args = stack[len(stack) - count :]
        del stack[len(stack) - count :]
        if op == RANDOM:
            return float(kernel(args, 0, count, b >> 16))
        if op == WORLD:
            frame = Affine(*params[self.frame_slot : self.frame_slot + 12])
            return float(kernel(frame, Vec3(*args)))
        return float(kernel(*args))


@cache
def _twins(op: int) -> tuple[Callable[..., Any], ...]:
    """Return the Python twins of the functions of one operation code."""
    (form,) = (form for form, code in _FORM_CODE.items() if code == op)
    return tuple(plain(f.kernel) for f in _BY_FORM[form])
