import math

import pytest

from pcsg.errors import UsageError
from pcsg.view.wants import Want, read_question, read_want


def test_an_empty_message_asks_for_the_grammars_own_picture():
    assert read_want({"size": [640, 480]}) == Want()


def test_everything_is_read():
    camera = {"eye": [1, 2, 3], "target": [0, 0, 0.5], "up": [0, 0, 1], "fov": 20}
    want = read_want(
        {
            "values": {"n": 3, "SEED": 7.0},
            "camera": camera,
            "size": [320, 200],
            "moving": True,
            "mode": "path",
            "layer": "depth",
            "samples": 64,
            "number": 5,
        }
    )
    assert want.values == {"n": 3.0, "SEED": 7.0}
    assert want.camera == {"eye": (1, 2, 3), "target": (0, 0, 0.5), "up": (0, 0, 1), "fov": 20}
    assert (want.size, want.moving, want.mode, want.layer) == ((320, 200), True, "path", "depth")
    assert (want.samples, want.number) == (64, 5)


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": [0, 10]},
        {"size": [10, 10**9]},
        {"size": None},
        {"size": [math.nan, 10]},
        {"size": "10"},
        {"values": {"n": "3"}},
        {"values": {"n": math.inf}},
        {"values": {"n": True}},
        {"values": {"1n": 3}},
        {"values": [1]},
        {"values": {f"n{k}": 1 for k in range(2000)}},
        {"camera": {"eye": [1, 2]}},
        {"camera": {"aperture": 1}},
        {"camera": {"fov": 0}},
        {"camera": {"eye": [1e40, 0, 0]}},
        {"camera": 3},
        {"mode": "fast"},
        {"layer": "heat"},
        {"samples": 0},
        {"samples": 10**9},
        {"number": -1},
    ],
)
def test_what_cannot_be_shown_is_refused(wrong):
    with pytest.raises(UsageError):
        read_want({"size": [640, 480], **wrong})


def test_a_click_lies_in_the_picture():
    assert read_question({"size": [4, 3], "x": 0.5, "y": 1}).place == (0.5, 1.0)
    for x in (-0.1, 1.1, math.nan, None, "0"):
        with pytest.raises(UsageError):
            read_question({"size": [4, 3], "x": x, "y": 0.5})
