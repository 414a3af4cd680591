"""Wavefront OBJ files, spoilt."""

from __future__ import annotations

import random
from collections.abc import Sequence

from driver import Data
from mutations import spoil_text
from spoiltmeshes import CUBE, LARGE, QUADS, TESTS, cases_of, subject_of
from writers import obj_text

WORDS = (
    "v ",
    "f ",
    "vt ",
    "vn ",
    "f 1 2 3\n",
    "f -1 -2 -3 -4\n",
    "v 0 0 0\n",
    "1/1/1",
    "2//2",
    "/",
    "#",
    "\\\n",
    "usemtl x\n",
    "g\n",
    "l 1 2\n",
    "v 1 2 3 255 0 0\n",
    "\ufeff",
    "\t",
    "\r",
)
FULL = "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 4/3/1 3\nf 1//1 3//1 7//1\n"


def seeds() -> Sequence[str]:
    bird = (TESTS.parent / "grammars" / "bird.obj").read_text(encoding="utf-8")
    cube = obj_text(CUBE, QUADS)
    texts = [data.decode("utf-8", "replace") for data in cases_of("obj")]
    return [*texts, cube, cube + FULL, bird[:6000]]


def mutate(rng: random.Random, text: Data) -> str:
    assert isinstance(text, str)
    if rng.random() < LARGE:
        return large(rng)
    return spoil_text(rng, text, WORDS)


def large(rng: random.Random) -> str:
    """Return a text that takes long if something goes wrong."""
    n = 10 ** rng.randint(4, 6)
    points = "".join(f"v {rng.random()} {rng.random()} {k % 2}\n" for k in range(min(n, 10**5)))
    return rng.choice(
        (
            points + "f " + " ".join(str(k % n + 1) for k in range(n)),
            points + "f " + " ".join(str(rng.randint(1, min(n, 10**5))) for _ in range(n)),
            points + "f 1 2 \\\n" * n + "3",
            "#" * 10 * n,
            "v " + "1" * 10 * n + " 0 0\n",
            points + "f 1 2 3\n" * n,
            points + "".join(f"f {k} {k + 1} {k + 2} 1 2\n" for k in range(1, min(n, 10**5) - 2)),
            " " * 10 * n + "f 1 2 3",
            "\n" * 10 * n,
        )
    )


SUBJECT = subject_of("obj", seeds, mutate)
