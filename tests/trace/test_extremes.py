"""Numbers far from one: both engines say the same of them, and nothing warns."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg import box, move, sphere, uscale
from pcsg.errors import GrammarError
from pcsg.graph.build import Prefix

PREFIXES = (
    "move(1e300,0,0)",
    "uscale(1e300)",
    "uscale(1e-300)",
    "scale(1e200,1e-200,1)",
    "scale(1e160,1e160,1e160)",
    "rotx(1e300)",
    "move(1e300,0,0) move(1.7e308,0,0)",
    "move(-1e308,0,0) uscale(1e308)",
    "color(1e300,-1e300,0)",
    "label(1e300)",
    "label(-1e300)",
)


@pytest.mark.parametrize("prefix", PREFIXES)
def test_numbers_far_from_one(prefix: str) -> None:
    for solid in ("sphere", "(box \\ sphere)", "cone(0.5)", "(sphere | move(0,0,3) box)"):
        text = f"{{}} {prefix} {solid}"
        try:
            scenes = [pcsg.loads(text, engine=engine) for engine in ("states", "cyclic")]  # type: ignore[arg-type]
        except GrammarError as error:
            assert "singular-matrix" in str(error)
            continue
        scenes[0].stats()
        found = [s.intersect([[5, 5.5, 6]], [[-1, -1, -1]]) for s in scenes]
        assert found[0].mask == found[1].mask
        assert found[0].label == found[1].label
        assert abs(int(found[0].label[0])) <= 2**53


@pytest.mark.parametrize(
    "prefix", [uscale(1e40), move(0, 1e300, 0), move(-1e300, 0, 1) * uscale(1e39)]
)
def test_boxes_beyond_single_precision_warn_of_nothing(prefix: Prefix) -> None:
    scene = pcsg.Scene(prefix * box() | sphere())
    assert scene.intersect([[0.0, 0.0, 5.0]], [[0.0, 0.0, -1.0]]).mask.all()
    image = pcsg.render(scene, size=(6, 4), samples=1, camera={"eye": (0, -5, 1)})
    assert np.isfinite(image.rgb).all()


def test_a_fault_tells_what_its_block_had_assigned_by_then() -> None:
    with pytest.raises(GrammarError, match="parameters: x = -1") as caught:
        pcsg.loads("{x = 0} {x = x-1; z = sqrt(x)} move(z,0,0) sphere")
    assert "sqrt" in str(caught.value)


@pytest.mark.parametrize(
    "setting",
    [
        "film { exposure = 1100 }",
        "sun { strength = 1e300 }",
        "sun { direction = (1e300,0,0) }",
        "light { radius = 1e300 }",
        "sky { zenith = (1e300,1,1) }",
        "camera { eye = (1e308,1e308,1e308) }",
        "camera { aperture = 1e300 }",
        "ground { z = -1e308 }",
        "film { exposure = 64 }",
        "sun { strength = 1e9; color = (1e6,1e6,1e6) }",
        "sun { direction = (1e30,0,1e-30) }",
        "sun { direction = (1e-320,0,0) }",
        "camera { up = (1e30,0,0) }",
        "camera { eye = (1e30,0,0) }",
        "camera { aperture = 1e30; focus = 1e30 }",
        "sky { strength = 1e9 }",
        "light { strength = 1e9; radius = 1e30 }",
        "ground { z = 1e30 }",
    ],
)
def test_settings_are_in_their_ranges_and_make_pictures_there(setting: str) -> None:
    beyond = "1100" in setting or "e300" in setting or "e308" in setting
    scene = pcsg.loads("{} sphere\n" + setting) if not beyond else None
    if scene is None:
        with pytest.raises(GrammarError, match="setting-range"):
            pcsg.render(pcsg.loads("{} sphere\n" + setting), size=(6, 4), samples=1)
        return
    image = pcsg.render(scene, size=(6, 4), samples=2)
    assert not np.isnan(image.rgb).any()


def test_a_ball_about_everything_is_left_without_a_look_at_everything() -> None:
    text = MENGER_IN_A_BALL
    rng = np.random.default_rng(4)
    o, d = np.full((64, 3), 0.01), rng.normal(size=(64, 3))
    states, cyclic = (pcsg.loads(text, engine=e) for e in ("states", "cyclic"))
    found, expected = states.intersect(o, d), cyclic.intersect(o, d)
    np.testing.assert_array_equal(found.t, expected.t)
    assert (found.leaf == expected.leaf).all()
    assert (found.t > 1e153).all()
    assert states.tracer.profile["blocks"] < 60


MENGER_IN_A_BALL = """
{n = 3} (S | uscale(1e154) sphere)
S if(n > 0, 2, 1)
1: S -> box
2: S -> {n = n-1} uscale(1/3) (move(0,0,2) R | move(0,0,-2) R | move(2,2,0) S | move(-2,2,0) S
  | move(2,-2,0) S | move(-2,-2,0) S)
1: R -> move(2,2,0) S | move(0,2,0) S | move(-2,2,0) S | move(-2,0,0) S | move(-2,-2,0) S
  | move(0,-2,0) S | move(2,-2,0) S | move(2,0,0) S
"""
