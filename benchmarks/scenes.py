"""The scenes that are measured: a new one is one line of `SCENES`.

What is imported at once is public, so that comparisons can load scenes with another version.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import pcsg
from benchmarks.views import Floats

if TYPE_CHECKING:
    from benchmarks.meshes import Triangles
    from pcsg.scene import Scene
    from pcsg.trace.tracer import Engine

HERE = Path(__file__).parent
GRAMMARS_HERE = HERE / "grammars"
GRAMMARS = HERE.parent / "grammars"


@dataclass(frozen=True)
class Subjected:
    """A scene to measure.

    Attributes
    ----------
    text
        Returns the grammar.
    values
        Of the axiom's parameters.
    triangles
        Returns the same as triangles, for the peers that have nothing else.
    block_memory
        Bytes for states that are made beforehand; None for the default.
    """

    text: Callable[[], str]
    values: Mapping[str, float] = field(default_factory=dict)
    triangles: Callable[[Scene], Triangles] | None = None
    block_memory: int | None = None

    def load(self, threads: int = 1, engine: Engine = "auto") -> Scene:
        """Return the scene."""
        return pcsg.loads(
            self.text(),
            parameters=self.values,
            threads=threads,
            engine=engine,
            block_memory=self.block_memory,
        )


def _solids(scene: Scene) -> Triangles:
    from benchmarks.meshes import solids

    return solids(scene)


def _terrain(scene: Scene) -> Triangles:
    from benchmarks.meshes import terrain

    return terrain(scene)


def _file(name: str) -> Callable[[], str]:
    folder = GRAMMARS_HERE if (GRAMMARS_HERE / f"{name}.pcsg").exists() else GRAMMARS
    return lambda: (folder / f"{name}.pcsg").read_text(encoding="utf-8")


def _limbs() -> str:
    """Fig 5a without its leaves."""
    text = _file("fig5a")()
    before, _, after = text.partition("segment = ")
    rest = after.partition("\n")[2]
    return f"{before}segment = scale(fxSG,fySG,dSG) cylinder\n{rest}"


def _bitten_ball() -> str:
    """A sphere without 1,000 small ones near its surface."""
    rng = np.random.default_rng(2)
    at = rng.normal(size=(1000, 3))
    at *= 0.98 / np.linalg.norm(at, axis=1)[:, None]
    bites = [f"move({x:.6f},{y:.6f},{z:.6f}) uscale({r:.6f}) sphere" for (x, y, z), r in zip(
        at, rng.uniform(0.03, 0.12, 1000), strict=True
    )]  # fmt: skip
    return f"sphere \\ ({' | '.join(bites)})\n"


def _crossed_boxes() -> str:
    """The intersection of two unions of 500 boxes."""
    rng = np.random.default_rng(3)

    def union() -> str:
        boxes = []
        for _ in range(500):
            x, y, z = rng.uniform(-1, 1, 3)
            a, b, c = rng.uniform(0.03, 0.2, 3)
            turns = " ".join(f"rot{axis}({rng.uniform(0, 360):.3f})" for axis in "xyz")
            boxes.append(
                f"move({x:.6f},{y:.6f},{z:.6f}) {turns} scale({a:.6f},{b:.6f},{c:.6f}) box"
            )
        return " | ".join(boxes)

    return f"{{}} ({union()}) & ({union()})\n"


def many_written(n: int) -> str:
    """Return a union of n boxes with colors, as scripts write them: a line each."""
    rng = np.random.default_rng(1)
    color, at = rng.uniform(0, 1, (n, 3)), rng.uniform(-50, 50, (n, 3))
    turn, size = rng.uniform(0, 360, n), rng.uniform(0.1, 1, (n, 2))
    rows = [
        f"color({r:.3f},{g:.3f},{b:.3f}) move({x:.4f},{y:.4f},{z:.4f}) rotz({a:.2f}) "
        f"scale({u:.3f},{v:.3f},1) box"
        for (r, g, b), (x, y, z), a, (u, v) in zip(color, at, turn, size, strict=True)
    ]
    return "{} (" + "\n | ".join(rows) + ")\n"


def rough_ball(n: int) -> tuple[Floats, NDArray[np.int32]]:
    """Return the corners and triangles of a closed ball with a rough surface, 4 n (n - 1)."""
    rng = np.random.default_rng(0)
    polar, around = np.pi * np.arange(1, n) / n, np.pi * np.arange(2 * n) / n
    b, a = (x.ravel() for x in np.meshgrid(polar, around, indexing="ij"))
    ring = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], axis=1)
    points = np.concatenate([[(0.0, 0.0, 1.0)], ring, [(0.0, 0.0, -1.0)]])
    waves = 0.1 * np.sin(9.0 * points[:, 0]) * np.sin(7.0 * points[:, 1])
    points *= (1.0 + waves + 0.2 / n * rng.normal(size=len(points)))[:, None]
    rows = 1 + 2 * n * np.arange(n - 1)[:, None] + np.arange(2 * n)
    ahead = np.roll(rows, -1, axis=1)
    last = np.full_like(rows[:1], len(points) - 1)
    parts = [
        (np.zeros_like(last), rows[:1], ahead[:1]),
        (rows[:-1], rows[1:], ahead[1:]),
        (rows[:-1], ahead[1:], ahead[:-1]),
        (last, ahead[-1:], rows[-1:]),
    ]
    faces = np.concatenate([np.stack(p, axis=-1).reshape(-1, 3) for p in parts])
    return points, faces.astype(np.int32)


SCENES: dict[str, Subjected] = {
    **{
        f"Sierpinski {n}": Subjected(
            _file("sierpinski"), {"c": float(n)}, _solids if n <= 10 else None
        )
        for n in (4, 6, 8, 10, 20, 30, 40)
    },
    "fig 5a limbs": Subjected(_limbs, triangles=_solids),
    "fig 5a": Subjected(_file("fig5a")),
    "tree": Subjected(_file("tree")),
    **{
        f"terrain {n}": Subjected(
            _file("terrain"), {"cnt": float(n)}, _terrain if n <= 10 else None
        )
        for n in (3, 8, 10, 14, 20)
    },
    **{f"Menger {n}": Subjected(_file("menger"), {"n": float(n)}) for n in range(1, 7)},
    "sphere minus 1,000": Subjected(_bitten_ball),
    "500 & 500 boxes": Subjected(_crossed_boxes),
    "plant 12": Subjected(_file("plant")),
}


@cache
def triangles_of(name: str) -> Triangles | None:
    """Return a scene as triangles, made once."""
    made = SCENES[name].triangles
    return None if made is None else made(SCENES[name].load())
