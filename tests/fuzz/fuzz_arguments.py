"""Public functions of Python with nonsense of every type: told in a sentence, by `PcsgError`."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from driver import Subject

import pcsg

NONSENSE: tuple[str, ...] = (
    "None",
    "True",
    "0",
    "-1",
    "1",
    "3",
    "2**64",
    "10**400",
    "0.5",
    "-2.5",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "1j",
    "''",
    "'a'",
    "'sphere'",
    "'caf\\u00e9'",
    "'\\x00'",
    "'../..'",
    "b'ab'",
    "()",
    "[]",
    "[1]",
    "[1, 2, 3]",
    "[[1, 2, 3]]",
    "[[1, 2], [3]]",
    "[[1, 2, 3], [4, 5, 6]]",
    "[[1, 2, 'x']]",
    "[[1, 2, 3j]]",
    "[[nan, 0, 1]]",
    "[[inf, 0, 1]]",
    "[[0, 0, 0]]",
    "[[None, 1, 2]]",
    "{}",
    "{'c': 1}",
    "{'c': 'x'}",
    "{'c': nan}",
    "{'SEED': nan}",
    "{1: 2}",
    "{'mode': 'raytrace'}",
    "{'eye': 5}",
    "{'fov': '35'}",
    "(10.5, 10)",
    "(4, 3)",
    "(0, 3)",
    "(4, 3, 2)",
    "('4', 3)",
    "object()",
    "(lambda *_: None)",
    "np.zeros((2, 3))",
    "np.ones((2, 3), np.float32)",
    "np.ones((3, 2))",
    "np.ones((0, 3))",
    "np.ones((2, 3), complex)",
    "np.array(['a', 'b'])",
    "np.array([[1, 2, 3]], object)",
    "np.float32(2)",
    "np.int8(2)",
    "np.array(3)",
    "Path('nothing.pcsg')",
    "Path('.')",
    "pcsg.P.c",
    "pcsg.sphere",
    "pcsg.move(1, 2, 3)",
    "pcsg.S('A')",
    "scene",
    "image",
    "iter([1, 2, 3])",
    "range(3)",
    "{1, 2}",
)
"""Written down, so that an input can be read."""

KEYWORDS: dict[str, tuple[str, ...]] = {
    "pcsg.load": ("include", "parameters", "engine", "threads", "max_memory", "block_memory", "c"),
    "pcsg.loads": ("name", "parameters", "engine", "threads", "max_memory", "block_memory", "c"),
    "pcsg.Scene": ("parameters", "engine", "threads", "max_memory", "block_memory"),
    "scene.intersect": ("t_min", "t_max"),
    "scene.occluded": ("t_min", "t_max"),
    "scene.contains": (),
    "scene.spans": (),
    "scene.limbs": ("limit",),
    "scene.setting_values": (),
    "scene.setting_numbers": (),
    "pcsg.render": (
        "size",
        "samples",
        "seed",
        "threads",
        "max_memory",
        "detail",
        "progress",
        "camera",
        "sun",
        "sky",
        "ground",
        "film",
    ),
    "image.save": ("aovs", "bits"),
    "pcsg.Graph": ("settings",),
    "pcsg.S": ("select",),
    "pcsg.C": ("a", "b"),
    "pcsg.define": (),
    "pcsg.call": ("seeds",),
    "pcsg.if_": (),
    "pcsg.and_": (),
    "pcsg.or_": (),
    "pcsg.not_": (),
    "pcsg.S('A').rule": (),
    "pcsg.P.c.__add__": (),
    "pcsg.P.c.__eq__": (),
    "pcsg.sphere.__or__": (),
    "pcsg.box.__sub__": (),
    "pcsg.move(1, 2, 3).__mul__": (),
    "pcsg.move": (),
    "pcsg.uscale": (),
    "pcsg.matrix": (),
    "pcsg.color": (),
    "pcsg.label": (),
    "pcsg.material": (),
    "pcsg.texture": (),
    "pcsg.cone": (),
    "pcsg.capsule": (),
    "pcsg.infcone": (),
    "pcsg.superellipsoid": (),
    "pcsg.torus": (),
    "pcsg.sphere": (),
    "pcsg.mesh": (),
    "pcsg.blob": (),
    "pcsg.tree": (),
    "pcsg.tree_wood": (),
    "pcsg.tree_leaves": (),
}
"""The functions, and their keywords."""


@cache
def _names() -> dict[str, Any]:
    scene = pcsg.loads("{c = 2} S\nS if(c>0,2,1)\n1: S -> sphere\n2: S -> {c=c-1} (S | box)")
    image = pcsg.render(scene, (4, 3), 1)
    return {
        "np": np,
        "pcsg": pcsg,
        "Path": Path,
        "scene": scene,
        "image": image,
        "nan": float("nan"),
        "inf": float("inf"),
    }


def _good(name: str) -> str:
    return {
        "pcsg.load": "Path('grammars/menger.pcsg')",
        "pcsg.loads": "'{c = 2} sphere'",
        "pcsg.Scene": "pcsg.C(c=1) * pcsg.sphere",
        "pcsg.render": "scene, (4, 3), 1",
        "image.save": "'a.png'",
        "pcsg.Graph": "pcsg.sphere()",
        "scene.intersect": "[[5, 5, 5]], [[-1, -1, -1]]",
        "scene.occluded": "[[5, 5, 5]], [[-1, -1, -1]]",
        "scene.spans": "[[5, 5, 5]], [[-1, -1, -1]]",
        "pcsg.S": "'A'",
        "pcsg.call": "'rand', 1",
        "pcsg.mesh": "[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]",
        "pcsg.tree_wood": "'populus', 2",
        "scene.setting_values": "'sun'",
        "scene.setting_numbers": "'material'",
    }.get(name, "1")


def seeds() -> Sequence[str]:
    return [f"{name}({_good(name)})" for name in KEYWORDS if _good(name) != "1"]


def mutate(rng: random.Random, _good_call: str) -> str:
    name = rng.choice(list(KEYWORDS))
    keywords = KEYWORDS[name]
    if keywords and rng.random() < 0.6:
        args = [_good(name)]
        taken = 3 if name == "pcsg.render" else 0
        args += [
            f"{key}={rng.choice(NONSENSE)}"
            for key in rng.sample(keywords[taken:], rng.choice([1, 1, 1, 2]) % len(keywords))
        ]
    else:
        args = [rng.choice(NONSENSE) for _ in range(rng.choice([0, 1, 1, 2, 2, 3, 4]))]
    return f"{name}({', '.join(args)})"


def run(call: str, folder: Path) -> None:
    names = _names()
    call = call.replace("'a.png'", repr(str(folder / "a.png")))
    try:
        made = eval(call, dict(names))
    except TypeError as error:
        # Python itself tells of arguments that are missing, too many, or unknown.
        if not any(word in str(error) for word in ("missing", "positional", "keyword argument")):
            raise
        return
    if isinstance(made, pcsg.Scene):
        made.intersect([[5, 5, 5]], [[-1, -1, -1]])


SUBJECT = Subject("arguments", seeds, mutate, run)
