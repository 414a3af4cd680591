"""Files of growing trees, spoilt: reading, growing, wood and leaves."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path

from driver import Subject
from models import look_at, warm_up
from mutations import NUMBERS, spoil_text

DATA = Path(__file__).parents[2] / "pcsg" / "growth" / "data"

HUGE = ("1" + "0" * 400, "9" * 5000, "[" * 3000, '{"a":' * 200)

WORDS = (*HUGE, "{", "}", "[", "]", ",", ":", '"', "null", "true", '"seed": 3,', *NUMBERS)


def seeds() -> Sequence[str]:
    found = []
    for path in sorted(DATA.glob("*.json")):
        text = path.read_text(encoding="utf-8")
        # Young trees mostly: what is wrong with an old one is wrong with them, too.
        found += [text, *[json.dumps({**json.loads(text), "ymax": 4, "trunk_scale": 3})] * 30]
    small = {"species": "x", "ymax": 3, "trunk_scale": 1.5, "order_max": 2}
    angles = {"angles": {"short": 70, "noise": 5}, "season": {"evergreen": 2, "fall": [0.7, 0.9]}}
    leaf = {"leaf": {"form": "needle", "length": 0.05}, "radius": {"rule": "pipe", "r_tip": 0.002}}
    curve = {"curves": {"G_h": {"type": "bspline", "points": [[0, 0.1], [0.4, 0.5], [1, 1]]}}}
    found += [json.dumps({**small, **more}) for more in (angles, leaf, curve) for _ in range(30)]
    return found


def mutate(rng: random.Random, text: str) -> str:
    return spoil_text(rng, text, WORDS, most=3)


def run(text: str, folder: Path) -> None:
    file = folder / "tree.json"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    look_at(file)


SUBJECT = Subject("species", seeds, mutate, run, warm_up)
