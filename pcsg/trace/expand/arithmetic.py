"""The arithmetic of rule programs: instructions over registers.

An instruction names the register that it writes and those that it reads, and literals stand behind
all registers. So nothing is moved to a stack and back, and fewer instructions run than on the tape
of `pcsg.graph.tape`, whose results are the same bit for bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.columns import Column, Lookup
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.functions import FUNCTIONS, Form
from pcsg.graph.tape import (
    NUMBER_OF,
    call_binary,
    call_random,
    call_ternary,
    call_unary,
    call_world,
)
from pcsg.indices import place, wide
from pcsg.jit import njit
from pcsg.vec import Vec3, load_affine

FIELDS = 5
"""Of an instruction: ``function << 8 | operation``, the register it writes, three operands."""

_OPERATION = 255
_ONE, _TWO, _THREE, _FOUR, _FIVE = (np.uint64(k) for k in (1, 2, 3, 4, FIELDS))

# Operations.
(
    _END,
    _ADD,
    _SUBTRACT,
    _MULTIPLY,
    _DIVIDE,
    _NEGATE,
    _SELECT,
    _UNARY,
    _BINARY,
    _TERNARY,
    _RANDOM,
    _WORLD,
    _COLUMN,
    _CHECK,
    _MOVE,
    _TRUTH,
    _JUMP,
    _JUMP_IF_ZERO,
) = range(18)

_PROPAGATING = {"+": _ADD, "-": _SUBTRACT, "*": _MULTIPLY, "/": _DIVIDE, "neg": _NEGATE}
"""Functions that are not a number where an argument is none: what is checked is the result."""

_OF_FORM = {
    Form.UNARY: _UNARY,
    Form.BINARY: _BINARY,
    Form.TERNARY: _TERNARY,
    Form.RANDOM: _RANDOM,
    Form.WORLD: _WORLD,
    Form.COLUMN: _COLUMN,
}


@njit
def compute(
    code: NDArray[np.int32],
    sources: NDArray[np.int32],
    columns: NDArray[np.float64],
    params: NDArray[np.float64],
    stack: NDArray[np.float64],
    at: int,
) -> bool:
    """Run instructions until the end; return False where a result is not finite.

    Parameters
    ----------
    code
        The instructions, `FIELDS` numbers each.
    sources
        Registers of functions of many arguments.
    columns
        Of tables, one behind the other.
    params
        Registers, and the literals behind them.
    stack
        Working space.
    at
        The first instruction.
    """
    i = place(FIELDS * at)
    while True:
        word, target = wide(code[i]), place(code[i + _ONE])
        a, b, c = place(code[i + _TWO]), place(code[i + _THREE]), place(code[i + _FOUR])
        op, function = word & _OPERATION, word >> 8
        i += _FIVE
        if op == _ADD:
            x = params[a] + params[b]
        elif op == _MULTIPLY:
            x = params[a] * params[b]
        elif op == _SUBTRACT:
            x = params[a] - params[b]
        elif op == _DIVIDE:
            x = params[a] / params[b]
        elif op == _NEGATE:
            x = -params[a]
        elif op == _SELECT:
            x = params[b] if params[a] != 0.0 else params[c]
        elif op == _UNARY:
            x = call_unary(function, params[a])
        elif op == _BINARY:
            x = call_binary(function, params[a], params[b])
        elif op == _TERNARY:
            x = call_ternary(function, params[a], params[b], params[c])
        elif op == _RANDOM:
            count = wide(b)
            for k in range(count):
                stack[k] = params[place(sources[a + place(k)])]
            x = call_random(function, stack, 0, count, wide(c))
        elif op == _WORLD:
            p, q, r = place(sources[a]), place(sources[a + _ONE]), place(sources[a + _TWO])
            point = Vec3(params[p], params[q], params[r])
            x = call_world(function, load_affine(params, wide(b)), point)
        elif op == _COLUMN:
            # Rows count from 1.
            row = params[a]
            is_there = row >= 1.0 and row <= wide(c)
            x = columns[place(wide(b) + int(row) - 1)] if is_there else math.nan
        elif op == _CHECK:
            x = params[a]
            if x != x:
                return False
            continue
        elif op == _MOVE:
            params[target] = params[a]
            continue
        elif op == _TRUTH:
            params[target] = 1.0 if params[a] != 0.0 else 0.0
            continue
        elif op == _JUMP:
            i = target
            continue
        elif op == _JUMP_IF_ZERO:
            if params[a] == 0.0:
                i = target
            continue
        else:
            return True
        params[target] = x
        if x - x != 0.0:
            return False


class _Visit(NamedTuple):
    """An expression is to be computed: into a register, or into a new one for -1."""

    expr: Expr
    target: int
    is_checked: bool


class _Apply(NamedTuple):
    """The arguments of a function are known."""

    expr: Apply
    target: int
    arity: int


class _Branch(NamedTuple):
    """The condition is known; what follows is computed where it is not zero."""


class _Otherwise(NamedTuple):
    """The first branch is known; it, or its truth, goes to a register. The other one follows."""

    target: int
    is_truth: bool


class _Join(NamedTuple):
    """The other branch is known; it goes to the same register."""

    target: int
    is_truth: bool


class Arithmetic:
    """Writes instructions.

    Attributes
    ----------
    code, sources, literals
        What has been written. Literal k is ``-1 - k`` until it is known how many registers there
        are.
    columns
        Columns of tables that are read, in the order of `compute`.
    registers
        How many the present program uses.
    most_arguments
        Of a function.
    """

    def __init__(self) -> None:
        self.code: list[int] = []
        self.sources: list[int] = []
        self.literals: list[float] = []
        self.columns: list[Column] = []
        self.registers = 0
        self.most_arguments = 0
        self._literal_of: dict[float | str, int] = {}
        self._column_at: dict[tuple[str, str], int] = {}
        self._given = 0
        self._sound: set[int] = set()
        self._branches: list[int] = []

    def begin(self, given: int, registers: int) -> None:
        """Begin a program.

        Parameters
        ----------
        given
            The first registers, which are given, and may have no value.
        registers
            How many there are.
        """
        self._given, self.registers = given, registers
        self._sound = set()

    @property
    def position(self) -> int:
        """Number of the next instruction."""
        return len(self.code) // FIELDS

    def end(self) -> None:
        """End a run of instructions."""
        self._emit(_END)

    def operand(self, expr: Expr) -> int:
        """Return the number of a register or of a literal."""
        if isinstance(expr, Number):
            return -1 - self._literal(float(expr.value))
        assert isinstance(expr, Parameter)
        return int(expr.name[1:])

    def check(self, register: int) -> None:
        """Have it checked that a register has a value."""
        if register < self._given and register not in self._sound:
            self._emit(_CHECK, 0, register)
            if not self._branches:
                self._sound.add(register)

    def assign(self, register: int, root: Expr, frame: int) -> None:
        """Let a register become the value of an expression; world queries see a frame."""
        # A list of what is still to do, instead of recursion.
        todo: list[_Visit | _Apply | _Branch | _Otherwise | _Join] = [_Visit(root, register, False)]
        known: list[int] = []
        while todo:
            step = todo.pop()
            if isinstance(step, _Visit):
                todo += reversed(self._visit(step, known))
            elif isinstance(step, _Apply):
                self._apply(step, known, frame)
            elif isinstance(step, _Branch):
                self._branches.append(self.position)
                self._emit(_JUMP_IF_ZERO, 0, known.pop())
            elif isinstance(step, _Otherwise):
                self._emit(_TRUTH if step.is_truth else _MOVE, step.target, known.pop())
                jump = self.position
                self._emit(_JUMP)
                self._land(self._branches.pop())
                self._branches.append(jump)
            else:
                self._emit(_TRUTH if step.is_truth else _MOVE, step.target, known.pop())
                self._land(self._branches.pop())
                known.append(step.target)

    def _visit(
        self, step: _Visit, known: list[int]
    ) -> list[_Visit | _Apply | _Branch | _Otherwise | _Join]:
        """Note the value of a leaf of an expression, or return what computes an application."""
        expr, target = step.expr, step.target
        if not isinstance(expr, Apply):
            operand = self.operand(expr)
            if operand >= 0 and not step.is_checked:
                self.check(operand)
            if target >= 0:
                self._emit(_MOVE, target, operand)
            known.append(operand if target < 0 else target)
            return []
        args, name = expr.args, expr.function
        if target < 0:
            target = self._add_register()
        if name == "if" and not any(isinstance(arg, Apply) for arg in args[1:]):
            # The result is checked, and so what it is chosen from is.
            c, a, b = args
            return [_Visit(c, -1, False), _Visit(a, -1, True), _Visit(b, -1, True),
                    _Apply(expr, target, 3)]  # fmt: skip
        if name in ("if", "and", "or"):
            # Whatever the branches leave is moved to one register.
            one, zero = Number(1.0), Number(0.0)
            a, b = {
                "if": args[1:],
                "and": (args[-1], zero),
                "or": (one, args[-1]),
            }[name]
            return [
                _Visit(args[0], -1, False),
                _Branch(),
                _Visit(a, -1, False),
                _Otherwise(target, name != "if"),
                _Visit(b, -1, False),
                _Join(target, name != "if"),
            ]
        if FUNCTIONS[name].form is not Form.BINARY or len(args) == 2:
            is_checked = name in _PROPAGATING
            if is_checked and not self._branches:
                for arg in args:
                    if isinstance(arg, Parameter):
                        self._sound.add(self.operand(arg))
            parts = [_Visit(arg, -1, is_checked) for arg in args]
            return [*parts, _Apply(expr, target, len(args))]
        if len(args) == 1:
            # The smallest of one number is that number.
            return [_Visit(args[0], target, False)]
        plan: list[_Visit | _Apply | _Branch | _Otherwise | _Join] = [_Visit(args[0], -1, False)]
        for arg in args[1:]:
            plan += [_Visit(arg, -1, False), _Apply(expr, target, 2)]
        return plan

    def _apply(self, step: _Apply, known: list[int], frame: int) -> None:
        """Write the instruction of a function whose arguments are known."""
        name, operands = step.expr.function, known[-step.arity :]
        del known[-step.arity :]
        known.append(step.target)
        if name in _PROPAGATING:
            self._emit(_PROPAGATING[name], step.target, *operands)
            return
        if name == "if":
            self._emit(_SELECT, step.target, *operands)
            return
        form = FUNCTIONS[name].form
        op = NUMBER_OF[name] << 8 | _OF_FORM[form]
        if form in (Form.RANDOM, Form.WORLD):
            at = len(self.sources)
            self.sources += operands
            self.most_arguments = max(self.most_arguments, len(operands))
            rest = (len(operands), step.expr.seeds) if form is Form.RANDOM else (frame, 0)
            self._emit(op, step.target, at, *rest)
        elif isinstance(step.expr, Lookup):
            assert step.expr.column is not None
            begin = self._place_column(step.expr.column)
            self._emit(op, step.target, *operands, begin, len(step.expr.column))
        else:
            self._emit(op, step.target, *operands)

    def _place_column(self, column: Column) -> int:
        """Return where a column begins."""
        if column.key not in self._column_at:
            self._column_at[column.key] = sum(map(len, self.columns))
            self.columns.append(column)
        return self._column_at[column.key]

    def _add_register(self) -> int:
        self.registers += 1
        return self.registers - 1

    def _literal(self, value: float) -> int:
        # Zeros of both signs are equal, but not alike; what is not a number equals nothing.
        key = value if value < 0.0 or value > 0.0 else value.hex()
        at = self._literal_of.setdefault(key, len(self.literals))
        if at == len(self.literals):
            self.literals.append(value)
        return at

    def _emit(self, op: int, target: int = 0, *operands: int) -> None:
        self.code += [op, target, *operands, *[0] * (FIELDS - 2 - len(operands))]

    def _land(self, jump: int) -> None:
        """Let a jump lead to the next instruction."""
        self.code[FIELDS * jump + 1] = len(self.code)
