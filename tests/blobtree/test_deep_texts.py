"""Deep texts are told or work; they never end in a traceback."""

from __future__ import annotations

import pytest

import pcsg
from pcsg.errors import GrammarError


@pytest.mark.parametrize(
    "text",
    [
        "blob { " + "(" * 3_000 + "point(1)" + ")" * 3_000 + " }",
        "blob { " + "move(0,0,1) " * 3_000 + "point(1) }",
        "blob { " + "(point(1) | point(1) + " * 1_500 + "point(1)" + ")" * 1_500 + " }",
        "blob { " + "pcm { point(1), " * 1_500 + "point(1)" + " }" * 1_500 + " }",
        "blob { D0 }\n"
        + "\n".join(f"D{k} = point(1) | move(0,0,0.001) D{k + 1}" for k in range(1_500))
        + "\nD1500 = point(1)",
    ],
    ids=["parentheses", "moves", "alternating", "contacts", "definitions"],
)
def test_deep_blobs_are_read(text: str) -> None:
    assert pcsg.loads(text).contains([[0.0, 0.0, -0.5]]).shape == (1,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{n = 3000} blob { R }\nR if(n > 0, 2, 1)\n1: R -> point(1)\n"
         "2: R -> point(1) | move(0,0,0.001) {n = n-1} R + point(0.5)", "recurses more than"),
        ("blob { " + "twist(30) " * 900 + "point(1) }", "no known bounds"),
    ],
)  # fmt: skip
def test_what_is_too_deep_is_told(text: str, message: str) -> None:
    with pytest.raises(GrammarError, match=message):
        pcsg.loads(text)
