"""Terms that a recipe needs several times become registers of their own.

Value numbering (Cocke and Schwartz 1970): equal terms have one number. A macro that is used for
red, green and blue is written three times into the text, and evaluated once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pcsg.graph.expr import Apply, Expr, Number, Parameter, operands, postorder
from pcsg.graph.recipes import Assign, Place, Recipe, register

_FIRST_ONLY = frozenset({"if", "and", "or"})
"""Functions of which only the first argument is always evaluated."""


def share_terms(recipe: Recipe) -> None:
    """Let registers stand for terms that are evaluated anyway and used more than once."""
    terms = _Terms()
    roots = [terms.add(s.expr) if isinstance(s, Assign) else -1 for s in recipe.steps]
    shared = terms.worth_sharing(roots)
    if not shared:
        return
    known: dict[int, Parameter] = {}
    steps: list[Assign | Place] = []
    for step, root in zip(recipe.steps, roots, strict=True):
        if isinstance(step, Assign):
            for k in terms.below(root):
                if k in shared and k != root and k not in known:
                    steps.append(Assign(recipe.registers, terms.rebuilt(k, known)))
                    known[k] = register(recipe.registers)
                    recipe.registers += 1
            step = Assign(step.register, terms.rebuilt(root, known))
            known.setdefault(root, register(step.register))
        steps.append(step)
    recipe.steps = steps


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
                key = (e.function, e.seeds, below)
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
                made[k] = Apply(e.function, args, e.seeds, e.span)
            else:
                made[k] = e
        return made[root]
