"""Grammars, spoilt and made up: whatever a file holds, what follows is told as its mistake."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from driver import Subject
from mutations import NUMBERS, spoil_text

from pcsg.commands import warmup
from pcsg.grammar import check_text
from pcsg.grammar.tokens import words
from pcsg.graph.functions import FUNCTIONS
from pcsg.graph.settings import SETTINGS
from pcsg.graph.transforms import TRANSFORMS
from pcsg.scene import Scene

GRAMMARS = Path(__file__).parents[2] / "grammars"

WORDS = (
    *(f"{word} " for word in words()),
    *(f"{name}(" for name in FUNCTIONS),
    *(f"{name} {{ " for name in SETTINGS),
    *"(){}|&\\-=:;,\n",
    "->",
    "#define ",
    '#include "',
    "{c = c-1} ",
    "2: ",
    "worldx(0,0,0)",
    "choose(c; 1, 2)",
    "blob { ",
    "pcm { ",
)

SMALL = (
    "{c = 3} S\nS if(c>0,2,1)\n1: S -> sphere\n2: S -> {c=c-1} (move(0,0,2) uscale(.5) S | box)\n",
    "{c=2; a=1} A | label(c) B\nA iff2\n#define iff2 if(c>0,2,1)\n1: A -> cone(0.5)\n"
    "2: A -> {c=c-1; a=a*2} (rotz(a*30) A \\ B)\nB = box & move(.5,0,0) sphere\n",
    "w: F(3)\np1: F(n) : n > 0 -> move(0,0,1) (F(n-1) | rotx(30) F(n-2))\n"
    "p2: F(n) : else -> cylinder\n",
    "{n=2} color(n/2,0,1) material(m) S\nS choose(n, SEED; 1, 2)\n1: S -> torus(0.3)\n"
    "2: S -> tetrahedron\nmaterial m { roughness = n/4; texture = t }\ntexture t { kind = wood }\n"
    "camera { eye = (n, 3, 4) }\nsun { direction = (1,n,2) }\nfilm { exposure = n }\n",
    "{d=4} T\nT if(worldz(0,0,0) > 3, 1, 2)\n1: T -> sphere\n"
    "2: T -> move(0,0,1) scale(.8,.8,1) T\n",
    "{} blob { point(1) + move(q,0,0) segment(2, 1) }\nq = 0.5\n",
    "{q=.5} blob { pcm(0.2,0.3) { point(q) , move(1,0,0) line(1, q) } } | halfspace\n",
    "{x=1} rot(x, 1,2,3) align(x,0,1) matrix(1,0,0,x,0,1,0,0,0,0,1,0) xshear(x,0) flipxy box\n",
    "{} move(rand(1)*3, gauss(2), noise(1,2,3)) uscale(0.1 + abs(sin(30))) cylinder \\ sphere\n",
    "#define HALF uscale(0.5)\n#define TWO HALF HALF\n{} TWO (sphere | HALF box) & TWO cone\n",
)

_BODIES = (
    "sphere",
    "box",
    "cone(0.5)",
    "A",
    "B",
    "{c=c-1} A",
    "{c=c-1} B",
    "empty",
    "tri1",
    "capsule(2)",
)


def make(rng: random.Random) -> str:
    """Return a grammar of two modules, mostly in order."""

    def number() -> str:
        what = rng.randrange(12)
        if what < 5:
            return f"{rng.uniform(-3, 3):.2f}"
        if what == 5:
            return rng.choice(NUMBERS)
        if what < 9:
            return rng.choice(["c", "a", "c-1", "SEED", "TIME", "pi"])
        name = rng.choice(list(FUNCTIONS))
        count = rng.choice([1, 1, 2, 3])
        return f"{name}({', '.join(number() for _ in range(count))})"

    def solid(depth: int) -> str:
        if depth == 0 or rng.random() < 0.2:
            return rng.choice(_BODIES)
        what = rng.randrange(5)
        if what < 2:
            sign = rng.choice("||||&\\")
            return f"({solid(depth - 1)} {sign} {solid(depth - 1)})"
        if what == 2:
            return f"{{a = {number()}; c = c-1}} {solid(depth - 1)}"
        if what == 3:
            kind = rng.choice(list(TRANSFORMS.values()))
            args = ", ".join(number() for _ in kind.parameters)
            return f"{kind.name}{f'({args})' if args else ''} {solid(depth - 1)}"
        return f"{rng.choice(['label', 'color'])}({number()}) {solid(depth - 1)}"

    return (
        f"{{c = {rng.choice(['2', '3', number()])}; a = {number()}}} A | B\n"
        f"A if({rng.choice(['c > 0', number()])}, 2, 1)\n1: A -> {rng.choice(_BODIES[:3])}\n"
        f"2: A -> {solid(3)}\nB if(c > {number()}, 2, 1)\n1: B -> box\n2: B -> {solid(2)}\n"
    )


def seeds() -> Sequence[str]:
    # Small ones are tried most: more of them is left in order, and a hundred take the time of one
    # that is whole.
    files = [p.read_text(encoding="utf-8") for p in sorted(GRAMMARS.glob("*.pcsg"))]
    return [*SMALL * 40, *files]


def mutate(rng: random.Random, text: str) -> str:
    if rng.random() < 0.3:
        text = make(rng)
        if rng.random() < 0.5:
            return text
    return spoil_text(rng, text, WORDS, most=rng.choice([1, 2, 6]))


def run(text: str, _folder: Path) -> None:
    graph, diagnostics = check_text(text)
    errors = [d for d in diagnostics if d.severity == "error"]
    assert (graph is None) == bool(errors)
    for d in diagnostics:
        assert d.render()
        if d.span:
            assert 0 <= d.span.start <= d.span.end <= len(d.span.source.text)
    if graph is None:
        return
    for engine in ("auto", "cyclic"):
        scene = Scene(graph, engine=engine, threads=1, max_memory=1 << 28)  # type: ignore[arg-type]
        if engine == "auto":
            scene.stats()
            for kind in SETTINGS:
                scene.setting_values(kind)
        lower, upper = scene.bounds
        # Of what is empty they are infinite.
        middle = lower / 2 + upper / 2 if np.isfinite([lower, upper]).all() else np.zeros(3)
        for target in (middle, [0.1, 0.2, 0.3]):
            target = [x if abs(x) < 1e30 else 0.0 for x in target]
            scene.intersect([[5.0, 6.0, 7.0], target], [[t - 5.5 for t in target], [0.2, 0.1, 1.0]])
            scene.occluded([[5.0, 6.0, 7.0]], [[-1.0, -1.1, -1.2]])
        scene.intersect_all([[5.0, 6.0, 7.0]], [[-1.0, -1.1, -1.2]])


def prepare() -> None:
    """Compile the kernels of all engines."""
    warmup.run(as_json=True)
    for text in SMALL:
        run(text, Path())


SUBJECT = Subject("grammars", seeds, mutate, run, prepare)
