"""Wrong arguments of the Python interface are told in a sentence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.errors import GrammarError, UsageError

BALL = "{c = 1} sphere"


@pytest.mark.parametrize(
    ("keyword", "value", "told"),
    [
        ("threads", -1, "threads is a whole number at least 1, not -1"),
        ("threads", "2", "threads is a whole number, not '2'"),
        ("threads", 1.0, "threads is a whole number, not 1.0"),
        ("max_memory", -1, "max_memory is a whole number at least 0, not -1"),
        ("block_memory", math.inf, "block_memory is a whole number, not inf"),
        ("engine", "fast", "unknown engine 'fast'; one of auto, cyclic, states"),
        ("engine", np.zeros(2), "unknown engine array"),
        ("SEED", math.nan, "`SEED` is a finite number, not nan"),
        ("c", "1", "`c` is a number, not '1'"),
        ("c", 10**400, "`c` is a number"),
        ("parameters", [1], "parameters is a dictionary of names and numbers"),
        ("parameters", {1: 2}, "a name in parameters is a text, not 1"),
    ],
)
def test_scenes(keyword: str, value: Any, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        pcsg.loads(BALL, **{keyword: value})
    assert told in str(caught.value)


def test_texts_and_files() -> None:
    with pytest.raises(UsageError, match="text is a text, not None"):
        pcsg.loads(None)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="path is the name of a file, not 3"):
        pcsg.load(3)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="include is a list of folders, not 'here'"):
        pcsg.load("a.pcsg", include="here")


@pytest.mark.parametrize(
    "points",
    ["abc", [[1, 2], [3]], [[1, 2, 3j]], [["1", "2", "3"]], [[None, 1, 2]], {}, {1: 2}, object()],
)
def test_rays_are_real_numbers_in_rows(points: Any) -> None:
    scene = pcsg.loads(BALL)
    told = "are real numbers in rows of equal length"
    for ask in (scene.intersect, scene.occluded, scene.spans):
        with pytest.raises(UsageError, match=f"origins {told}"):
            ask(points, [0, 0, 1])
        with pytest.raises(UsageError, match=f"directions {told}"):
            ask([0, 0, 1], points)
    with pytest.raises(UsageError, match=f"points {told}"):
        scene.contains(points)
    with pytest.raises(UsageError, match=f"t_min {told}"):
        scene.intersect([0, 0, 1], [0, 0, 1], points)


@pytest.mark.parametrize(
    ("keyword", "value", "told"),
    [
        ("size", (10.5, 10), "a side of the size is a whole number, not 10.5"),
        ("size", 10, "the size is a pair of whole numbers, not 10"),
        ("samples", 0, "samples is a whole number from 1 to"),
        ("seed", 0.5, "seed is a whole number, not 0.5"),
        ("threads", -1, "threads is a whole number at least 1, not -1"),
        ("detail", "1", "detail is a number, not '1'"),
        ("progress", 3, "progress is a function, not 3"),
        ("film", {"mode": "raytrace"}, "`mode` of `film` is one of preview, direct, path, not"),
        ("film", {"exposure": 1100}, "`exposure` of `film` is a number from -64 to 64, not 1100"),
        ("film", {"exposure": math.nan}, "`exposure` of `film` is a number from -64 to 64"),
        ("film", 5, "`film` takes a dictionary of keys and values, not 5"),
        ("camera", {"eye": 5}, "`eye` of `camera` is three numbers (x, y, z), not 5"),
        ("camera", {"fov": "wide"}, "`fov` of `camera` is a number, not 'wide'"),
        ("camera", {"foo": 1}, "`camera` has no key `foo`; did you mean `fov`?"),
        ("ground", {"material": 3}, "`material` of `ground` is a name, not 3"),
        ("sky", {"file": 3}, "`file` of `sky` is the name of a file in quotes, not 3"),
    ],
)
def test_pictures(keyword: str, value: Any, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        pcsg.render(pcsg.loads(BALL), **{"size": (4, 3), "samples": 1, keyword: value})
    assert told in str(caught.value)


def test_solids() -> None:
    for wrong in (
        lambda: pcsg.move(1, 2, "3"),
        lambda: pcsg.uscale(1j),
        lambda: pcsg.C(a=None),
        lambda: pcsg.call("sine", 1),
        lambda: pcsg.call([], 1),
        lambda: pcsg.S(5),  # type: ignore[arg-type]
        lambda: pcsg.define(5, pcsg.box),
        lambda: pcsg.mesh([["a"]], [[0, 1, 2]]),
        lambda: pcsg.mesh([[0, 0, 0]], 3),
        lambda: pcsg.Graph(5),  # type: ignore[arg-type]
        lambda: pcsg.Graph(pcsg.S("A"), -1),  # type: ignore[arg-type]
        lambda: pcsg.Graph(pcsg.S("A"), [5]),  # type: ignore[list-item]
        lambda: pcsg.render(5),  # type: ignore[arg-type]
    ):
        with pytest.raises(UsageError):
            wrong()


def test_numbers_of_numpy_are_numbers() -> None:
    scene = pcsg.loads(BALL, threads=np.int64(1), c=np.float32(0.5))
    assert scene.intersect(np.array([[0, 0, 5]], object), np.array([0, 0, -1], np.int8)).t == [4.0]
    assert pcsg.render(scene, size=(np.int32(4), np.int32(3)), samples=1).rgb.shape == (3, 4, 3)


def test_a_module_without_rules_is_told() -> None:
    with pytest.raises(GrammarError, match="module `A` has no rules"):
        pcsg.Scene(pcsg.S("A"))
