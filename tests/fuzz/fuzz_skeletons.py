"""Skeletons (.swc, .json), spoilt: as trees of grammars, and as what meshes are made of."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from models import look_at, warm_up
from mutations import NUMBERS, spoil_text

from pcsg.blobtree.lines import read_skeleton
from pcsg.commands.mesh import Input, open_skeleton
from pcsg.errors import PcsgError
from pcsg.treemesh import Skeleton, tree_surface
from pcsg.treemesh.composition import compose
from pcsg.treemesh.estimate import check_memory
from pcsg.treemesh.library import Library

SWC = """# id type x y z r parent
1 0 0 0 0 0.50 -1
2 0 0 0 2 0.45 1
3 0 0.5 0 4 0.40 2
4 0 1.8 0 3.2 0.15 2
5 0 2.7 0 4 0.10 4
6 1 1.0 1 5.0 0.20 3
7 1 -1.0 0.5 4.8 0.20 3
"""
NODES = [[0, 0, 0, 0.5], [0, 0, 2, 0.45], [0.5, 0, 4, 0.4], [1.8, 0, 3.2, 0.15], [2.7, 0, 4, 0.1]]
EDGES = [[0, 1], [1, 2], [1, 3], [3, 4]]
LOOP = [[0, 1], [1, 2], [1, 3], [3, 4], [4, 2]]

HUGE = ("1" + "0" * 400, "9" * 5000, "[" * 3000, '{"a":' * 3000)

WORDS = (
    *HUGE,
    "\n",
    " ",
    "#",
    "-1 ",
    "0 ",
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    '"',
    "null",
    "true",
    *NUMBERS,
)


def seeds() -> Sequence[str]:
    skeleton = {"nodes": NODES, "edges": EDGES, "root": 0}
    tagged = {**skeleton, "tags": {"branch": [0, 0, 1, 1], "label": [1, 2, 3, 4]}}
    loop = {**skeleton, "edges": LOOP}
    return [SWC, SWC, *map(json.dumps, (skeleton, tagged, loop))]


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS, most=4)


def run(text: str, folder: Path) -> None:
    file = folder / ("tree.json" if text.lstrip().startswith("{") else "tree.swc")
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    told = 0
    for use in (look_at, read_skeleton, _mesh, _compose):
        try:
            use(file)
        except PcsgError as error:
            assert str(error)
            told += 1
    assert told <= 4


def _mesh(file: Path) -> None:
    skeleton, _ = open_skeleton(Input(file))
    check_memory(skeleton, None, 2**28)
    tree_surface(skeleton)


def _compose(file: Path) -> None:
    skeleton, _ = open_skeleton(Input(file, resample=False))
    library = Library()
    library.add(skeleton, "tree")
    compose(skeleton, library, 1)


def prepare() -> None:
    """Load or compile the kernels."""
    warm_up()
    tree_surface(Skeleton.make([[0, 0, 0], [0, 0, 1]], [0.1, 0.1], [[0, 1]]))


SUBJECT = Subject("skeletons", seeds, mutate, run, prepare)
