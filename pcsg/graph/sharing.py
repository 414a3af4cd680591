"""Terms that are needed several times become registers of their own.

Value numbering (Cocke and Schwartz 1970): equal terms have one number. A macro that is used for
red, green and blue is written three times into the text, and evaluated once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder

_FIRST_ONLY = frozenset({"if", "and", "or"})
"""Functions of which only the first argument is always evaluated."""


class Assign(NamedTuple):
    """Register `register` becomes the value of an expression over registers."""

    register: int
    expr: Expr


def register(k: int) -> Parameter:
    """Return the expression that is the value of register k."""
    return Parameter(f"r{k}")


def substitute(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """Return an expression with others in place of its parameters."""
    stack: list[Expr] = []
    for e in postorder(expr, operands):
        if isinstance(e, Parameter):
            stack.append(values[e.name])
        elif isinstance(e, Apply):
            at = len(stack) - len(e.args)
            args = tuple(stack[at:])
            del stack[at:]
            stack.append(e.with_args(args))
        else:
            stack.append(e)
    return stack[0]


def share_terms(
    steps: Sequence[Assign | None], registers: int
) -> tuple[list[tuple[list[Assign], Assign | None]], int]:
    """Let registers stand for terms that are evaluated anyway and used more than once.

    Parameters
    ----------
    steps
        Assignments, and None for other steps.
    registers
        How many registers there are.

    Returns
    -------
    steps, registers
        For every step the assignments that come before it, and what it becomes; the new number.
    """
    terms = _Terms()
    roots = [-1 if s is None else terms.add(s.expr) for s in steps]
    shared = terms.worth_sharing(roots)
    known: dict[int, Parameter] = {}
    found: list[tuple[list[Assign], Assign | None]] = []
    for step, root in zip(steps, roots, strict=True):
        before: list[Assign] = []
        if step is not None and shared:
            for k in terms.below(root):
                if k in shared and k != root and k not in known:
                    before.append(Assign(registers, terms.rebuilt(k, known)))
                    known[k] = register(registers)
                    registers += 1
            step = Assign(step.register, terms.rebuilt(root, known))
            known.setdefault(root, register(step.register))
        found.append((before, step))
    return found, registers


class _Terms:
    """Terms by numbers, arguments before what they are arguments of."""

    def __init__(self) -> None:
        self.terms: list[Expr] = []
        self.arguments: list[tuple[int, ...]] = []
        self.numbers: dict[tuple[object, ...], int] = {}

    def add(self, expr: Expr) -> int:
        """Return the number of a term."""
        stack: list[int] = []
        for e in postorder(expr, operands):
            at = len(stack) - len(operands(e))
            below = tuple(stack[at:])
            del stack[at:]
            key: tuple[object, ...]
            if isinstance(e, Number):
                key = ("number", e.value.hex())
            elif isinstance(e, Parameter):
                key = ("parameter", e.name)
            else:
                assert isinstance(e, Apply)
                key = (*e.head, below)
            if key not in self.numbers:
                self.numbers[key] = len(self.terms)
                self.terms.append(e)
                self.arguments.append(below)
            stack.append(self.numbers[key])
        return stack[0]

    def worth_sharing(self, roots: Sequence[int]) -> set[int]:
        """Return the terms that cost more than a register if they are evaluated at every use."""
        roots = [k for k in roots if k >= 0]
        uses = Counter(roots)
        size = [1] * len(self.terms)
        for k, below in enumerate(self.arguments):
            uses.update(below)
            size[k] += sum(size[j] for j in below)
        certain = set(roots)
        for k in range(len(self.terms) - 1, -1, -1):
            e = self.terms[k]
            if k in certain and isinstance(e, Apply):
                certain.update(self.arguments[k][: 1 if e.function in _FIRST_ONLY else None])
        return {
            k
            for k in certain
            if isinstance(self.terms[k], Apply) and (uses[k] - 1) * size[k] > uses[k] + 1
        }

    def below(self, root: int) -> list[int]:
        """Return the terms that one consists of, arguments first."""
        seen = {root}
        stack = [root]
        while stack:
            new = set(self.arguments[stack.pop()]) - seen
            seen |= new
            stack += new
        return sorted(seen)

    def rebuilt(self, root: int, known: dict[int, Parameter]) -> Expr:
        """Return a term with registers for those of its terms that are known."""
        made: dict[int, Expr] = {}
        for k in self.below(root):
            e = self.terms[k]
            if k in known:
                made[k] = known[k]
            elif isinstance(e, Apply):
                args = tuple(made[j] for j in self.arguments[k])
                made[k] = e.with_args(args)
            else:
                made[k] = e
        return made[root]
