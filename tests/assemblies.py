"""Grammars that assemble modules by operations, at random: what engines find hard, all at once.

Modules have two parts, so that nothing of them fits into a table, and stand three levels deep
under several operations at a time, also as what is taken away. Parts are cut off and put back.
Unions are wide, with operations among many small solids.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

_SOLIDS = (
    "sphere",
    "sphere",
    "box",
    "box",
    "cylinder",
    "cone",
    "tetrahedron",
    "torus(0.4)",
    "capsule(0.5)",
)
_CONVEX = (
    "sphere",
    "box",
    "cylinder",
    "cone",
    "tetrahedron",
    "halfspace",
    "capsule(1.5)",
    "infcylinder",
    "infcone(0.5)",
)
_SHEETS = ("tri1", "tri2", "disc", "rectangle")


def assemble(rng: random.Random) -> str:
    """Return the text of a grammar."""
    return _Assembler(rng).write()


class _Assembler:
    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.integral = rng.random() < 0.5
        self.lines: list[str] = []

    def write(self) -> str:
        levels = [[self.module(f"P{k}", self.pair()) for k in range(3)]]
        for level in range(2):
            below = [name for names in levels for name in names[-2:]]
            bodies = [self.body(below) for _ in range(2)]
            levels.append([self.module(f"{'QR'[level]}{k}", b) for k, b in enumerate(bodies)])
        names = [name for level in levels for name in level]
        if self.rng.random() < 0.25:
            names.append(self.recursion(names))
        top = self.operation([*names[-2:], self.rng.choice(names)])
        what = self.rng.random()
        if what < 0.5:
            # Sheets may stand here only: everything else is taken away somewhere.
            top = self.wide(top, names, sheets=True)
        elif what < 0.7:
            top = self.operation([f"({top})", self.rng.choice(names), self.rng.choice(names)])
        return "\n".join([f"{{n={self.rng.randint(1, 3)}}} ({top})", *self.lines]) + "\n"

    def module(self, name: str, body: str) -> str:
        self.lines.append(f"1: {name} -> {body}")
        return name

    def recursion(self, names: Sequence[str]) -> str:
        """Add a module that cuts a part off itself and puts it back at every step."""
        cut, turn = self.solid(_CONVEX), self.placing()
        again = f"({turn} {{n=n-1}} A)"
        other = self.placed(names)
        body = self.rng.choice(
            [
                f"(({cut} & {again}) | ({other} \\ {cut}))",
                f"(({again} \\ {cut}) | ({again} & {cut}))",
                f"(({again} \\ {cut}) | {other})",
            ]
        )
        self.lines += [
            "A if(n > 0, 2, 1)",
            f"1: A -> {self.rng.choice(names)}",
            f"2: A -> {{}} {body}",
        ]
        return "A"

    # Operations

    def body(self, names: Sequence[str]) -> str:
        """Return what a module of two parts is."""
        other = self.placed(names) if self.rng.random() < 0.5 else self.solid()
        parts = [self.operation(names), other]
        self.rng.shuffle(parts)
        return self.wide(parts[0], names) if self.rng.random() < 0.15 else " | ".join(parts)

    def operation(self, names: Sequence[str]) -> str:
        """Return an operation over modules."""
        a, b, c = (self.placed(names) for _ in range(3))
        x = self.solid(_CONVEX)
        forms = (
            f"({a} \\ {x})",
            f"({a} & {x})",
            f"({x} \\ {a})",
            f"({a} \\ {b})",
            f"({a} & {b})",
            f"({a} & ({b} | {x}))",
            f"({a} \\ ({b} | {x}))",
            f"(({a} | {b}) \\ {c})",
            f"({x} \\ ({a} \\ {b}))",
            f"({a} \\ {b} \\ {c})",
            # Cut off and put back: with what was there, with something else, the other way round.
            f"(({a} & {x}) | ({a} \\ {x}))",
            f"(({x} & {a}) | ({b} \\ {x}))",
            f"(({b} \\ {x}) | ({x} & {a}))",
            f"((({a} \\ {x}) | ({x} & {a})) \\ {b})",
            f"(({a} \\ {b}) | ({b} \\ {a}))",
        )
        return self.rng.choice(forms)

    def wide(self, operation: str, names: Sequence[str], sheets: bool = False) -> str:
        """Return a union of more than sixteen, with operations anywhere in it."""
        count = self.rng.randint(16, 24)
        parts = [f"(move({self.places()}) uscale(0.4) {self.solid()})" for _ in range(count)]
        if sheets and self.rng.random() < 0.3:
            parts[:3] = [f"(move({self.places()}) {self.solid(_SHEETS)})" for _ in range(3)]
        for more in (operation, *(self.operation(names) for _ in range(self.rng.randint(0, 1)))):
            parts.insert(self.rng.randint(0, len(parts)), more)
        return "(" + " | ".join(parts) + ")"

    # What they are made of

    def placed(self, names: Sequence[str]) -> str:
        """Return a module somewhere; mostly where it is, so that it meets itself."""
        name = self.rng.choice(names)
        return name if self.rng.random() < 0.6 else f"({self.placing()} {name})"

    def pair(self) -> str:
        """Return a union of two solids, which often lie apart."""
        far = f"move({self.places(5)}) " if self.rng.random() < 0.4 else ""
        return f"{self.solid()} | ({far}{self.solid()})"

    def solid(self, names: Sequence[str] = _SOLIDS) -> str:
        name = self.rng.choice(names)
        return name if self.rng.random() < 0.25 else f"({self.placing()} {name})"

    def placing(self) -> str:
        """Return a transformation."""
        what = self.rng.randint(0, 5)
        if what <= 2:
            return f"move({self.places()})"
        if what == 3:
            angle = self.rng.choice([90, 180, 45, 30] if self.integral else [45, 30, 17, -71])
            return f"rot{self.rng.choice('xyz')}({angle})"
        if what == 4:
            return f"uscale({self.rng.choice([0.5, 2] if self.integral else [0.7, 1.2, 1.7])})"
        scale = [0.5, 1, 2, -1] if self.integral else [0.6, 1.1, 1.9, -0.8]
        return f"scale({self.rng.choice(scale)},{self.rng.choice(scale)},{self.rng.choice(scale)})"

    def places(self, size: int = 2) -> str:
        """Return three coordinates."""
        if self.integral:
            return ",".join(str(self.rng.randint(-size, size)) for _ in range(3))
        return ",".join(str(self.rng.randint(-10 * size, 10 * size) / 10) for _ in range(3))
