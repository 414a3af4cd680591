"""The operators on solids: one row each of a truth table over membership."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Operator:
    """An operator on two solids, folded from the left over more.

    Attributes
    ----------
    name
        In English.
    kind
        Its number in kernels.
    symbols
        Spellings in text; the first is written back.
    precedence
        The larger binds tighter.
    table
        Bit ``2a + b`` tells whether a point is in the result that is (a) or is not in the first,
        (b) or is not in the second operand.
    associative
        Whether both operands flatten; otherwise only the first does.
    """

    name: str
    kind: int
    symbols: tuple[str, ...]
    precedence: int
    table: int
    associative: bool

    def __reduce__(self) -> str:
        return self.name.upper()  # there is one of each, compared by identity


UNION = Operator("union", 0, ("|", "\u222a"), 1, 0b1110, True)
INTERSECTION = Operator("intersection", 1, ("&", "\u2229"), 3, 0b1000, True)
DIFFERENCE = Operator("difference", 2, ("\\", "-", "\u2216"), 4, 0b0100, False)

SUM = Operator("sum", 3, ("+",), 2, 0b1110, True)
"""The sum of fields, in blobs only; between union and intersection."""

OPERATORS = (UNION, INTERSECTION, DIFFERENCE)
