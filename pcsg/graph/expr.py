"""Arithmetic expressions as immutable trees.

``P.cnt - 1`` builds one in Python, the parser builds the same from text. Comparisons build
expressions too, so trees are compared with `same`, never with ``==``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from pcsg.arguments import real, shown, whole
from pcsg.errors import SourceSpan, UsageError
from pcsg.graph.flat import Flattened
from pcsg.graph.functions import FUNCTIONS, Form

Number_ = float | int
T = TypeVar("T")


class Expr(Flattened):
    """A number that may depend on parameters."""

    __slots__ = ()
    __hash__ = object.__hash__

    def __bool__(self) -> bool:
        raise TypeError(
            "an expression over parameters is neither true nor false; "
            "use if_(cond, a, b), & | are not defined on numbers, use and_(a, b), or_(a, b)"
        )

    def __add__(self, other: Expr | Number_) -> Expr:
        return apply("+", self, other)

    def __radd__(self, other: Number_) -> Expr:
        return apply("+", other, self)

    def __sub__(self, other: Expr | Number_) -> Expr:
        return apply("-", self, other)

    def __rsub__(self, other: Number_) -> Expr:
        return apply("-", other, self)

    def __mul__(self, other: Expr | Number_) -> Expr:
        return apply("*", self, other)

    def __rmul__(self, other: Number_) -> Expr:
        return apply("*", other, self)

    def __truediv__(self, other: Expr | Number_) -> Expr:
        return apply("/", self, other)

    def __rtruediv__(self, other: Number_) -> Expr:
        return apply("/", other, self)

    def __mod__(self, other: Expr | Number_) -> Expr:
        return apply("%", self, other)

    def __rmod__(self, other: Number_) -> Expr:
        return apply("%", other, self)

    def __pow__(self, other: Expr | Number_) -> Expr:
        return apply("^", self, other)

    def __rpow__(self, other: Number_) -> Expr:
        return apply("^", other, self)

    def __neg__(self) -> Expr:
        return apply("neg", self)

    def __lt__(self, other: Expr | Number_) -> Expr:
        return apply("<", self, other)

    def __le__(self, other: Expr | Number_) -> Expr:
        return apply("<=", self, other)

    def __gt__(self, other: Expr | Number_) -> Expr:
        return apply(">", self, other)

    def __ge__(self, other: Expr | Number_) -> Expr:
        return apply(">=", self, other)

    def __eq__(self, other: object) -> Expr:  # type: ignore[override]
        return apply("==", self, _operand(other))

    def __ne__(self, other: object) -> Expr:  # type: ignore[override]
        return apply("!=", self, _operand(other))


# Nobody changes one. Not frozen: a long file has hundreds of thousands, made in half the time.
@dataclass(eq=False, slots=True)
class Number(Expr):
    """A constant."""

    value: float
    span: SourceSpan | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False, slots=True)
class Parameter(Expr):
    """The present value of a parameter."""

    name: str
    span: SourceSpan | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False, slots=True)
class Apply(Expr):
    """A function or an operator applied to arguments.

    Attributes
    ----------
    function
        A key of `FUNCTIONS`.
    seeds
        For ``choose(s, ...; w, ...)`` the number of arguments before the semicolon.
    """

    function: str
    args: tuple[Expr, ...]
    seeds: int = 0
    span: SourceSpan | None = field(default=None, repr=False)

    def with_args(self, args: tuple[Expr, ...]) -> Apply:
        """Return the same application to other arguments."""
        return Apply(self.function, args, self.seeds, self.span)

    @property
    def head(self) -> tuple[object, ...]:
        """A value that is equal for, and only for, applications of the same to arguments."""
        return self.function, self.seeds


def _operand(value: object) -> Expr | Number_:
    if isinstance(value, (Expr, float, int)):
        return value
    raise UsageError(f"expected a number or an expression, not {value!r}")


def as_expr(value: Expr | Number_) -> Expr:
    """Return an expression for a number or an expression."""
    if isinstance(value, Expr):
        return value
    return Number(real(value, "an argument of a solid or of a function"))


def apply(name: str, *args: Expr | Number_, seeds: int = 0) -> Apply:
    """Return the expression ``name(args)``; the number of arguments is checked."""
    least, most = FUNCTIONS[name].arity
    if len(args) < least or (most is not None and len(args) > most):
        raise UsageError(f"{name} takes {least} argument(s), not {len(args)}")
    return Apply(name, tuple(as_expr(a) for a in args), seeds)


class _Parameters:
    """``P.name`` is the parameter of that name."""

    def __getattr__(self, name: str) -> Parameter:
        if name.startswith("__"):
            raise AttributeError(name)
        return Parameter(name)

    def __reduce__(self) -> str:
        return "P"


P = _Parameters()


def if_(condition: Expr | Number_, a: Expr | Number_, b: Expr | Number_) -> Expr:
    """Return a where the condition is not zero, else b."""
    return apply("if", condition, a, b)


def and_(a: Expr | Number_, b: Expr | Number_) -> Expr:
    """Return 1 where both are not zero, else 0."""
    return apply("and", a, b)


def or_(a: Expr | Number_, b: Expr | Number_) -> Expr:
    """Return 1 where one is not zero, else 0."""
    return apply("or", a, b)


def not_(a: Expr | Number_) -> Expr:
    """Return 1 where a is zero, else 0."""
    return apply("not", a)


def call(name: str, *args: Expr | Number_, seeds: int = 0) -> Expr:
    """Return a call of any function of the language, such as ``call("rand", P.c, 7)``."""
    if not isinstance(name, str) or name not in FUNCTIONS:
        raise UsageError(f"unknown function {shown(name)}")
    if name == "choose":
        whole(seeds, "seeds", 1, max(1, len(args) - 1))
    elif seeds != 0:
        raise UsageError(f"`{name}` takes no seeds")
    return apply(name, *args, seeds=seeds)


def operands(expr: Expr) -> tuple[Expr, ...]:
    """Return the arguments of an application, nothing for numbers and parameters."""
    return expr.args if isinstance(expr, Apply) else ()


def postorder(root: T, successors: Callable[[T], Sequence[T]]) -> Iterator[T]:
    """Walk a tree from its leaves up, arguments before what they are arguments of.

    Iterative, because the nesting of a user's file has no limit. A tree only: what is shared is
    visited at each of its places.
    """
    stack: list[tuple[T, int]] = [(root, 0)]
    while stack:
        item, k = stack.pop()
        below = successors(item)
        if k < len(below):
            stack.append((item, k + 1))
            stack.append((below[k], 0))
        else:
            yield item


def applications(exprs: Iterable[Expr]) -> Iterator[Apply]:
    """Yield every application in expressions, arguments first; most are numbers and have none."""
    roots: list[Expr] = [x for x in exprs if isinstance(x, Apply)]
    for root in roots:
        for expr in postorder(root, operands):
            if isinstance(expr, Apply):
                yield expr


def parameters_of(*exprs: Expr) -> set[str]:
    """Return the names of all parameters that expressions read."""
    return {
        e.name
        for x in exprs
        if not isinstance(x, Number)
        for e in postorder(x, operands)
        if isinstance(e, Parameter)
    }


def functions_of(*exprs: Expr) -> set[str]:
    """Return the names of all functions that expressions call."""
    return {e.function for e in applications(exprs)}


def asks_world(*exprs: Expr) -> bool:
    """Return whether expressions ask for world coordinates.

    A function that nobody knows does not: it was reported before.
    """
    known = (FUNCTIONS[f] for f in functions_of(*exprs) if f in FUNCTIONS)
    return any(function.form is Form.WORLD for function in known)


def signature(expr: Expr) -> tuple[object, ...]:
    """Return a flat tuple that is equal for, and only for, the same expression.

    The negative of a constant is the negative constant: text cannot tell them apart.
    """
    if isinstance(expr, Number) and isinstance(expr.value, float):  # most are
        return (("n", expr.value.hex()),)
    out: list[object] = []
    for e in postorder(expr, operands):
        if isinstance(e, Number):
            out.append(e.value)
        elif isinstance(e, Parameter):
            out.append(("p", e.name))
        elif isinstance(e, Apply) and e.function == "neg" and isinstance(out[-1], float):
            out[-1] = -out[-1]
        elif isinstance(e, Apply):
            out.append((len(e.args), *e.head))
    return tuple(("n", e.hex()) if isinstance(e, float) else e for e in out)


def same(a: Expr, b: Expr) -> bool:
    """Return whether two expressions are written alike (spans do not count)."""
    return signature(a) == signature(b)


def seeds_first(args: Iterable[Expr | Number_], weights: Iterable[Expr | Number_]) -> Expr:
    """Return ``choose(args; weights)``."""
    first = tuple(args)
    return apply("choose", *first, *weights, seeds=len(first))
