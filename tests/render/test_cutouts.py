"""Cut-outs: surfaces that are there in part."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import pcsg
from pcsg.errors import GrammarError
from pcsg.render.cutouts import CutTracer
from pcsg.render.stage import build_stage
from pcsg.render.tracer import GROUND, DetailedTracer

MODES = ("preview", "direct", "path")
ABOVE = {"projection": "orthographic", "eye": (0, 0, 9), "target": (0, 0, 0), "height": 4.0}


def square(keys: str, more: str = "") -> pcsg.Scene:
    return pcsg.loads(
        f"material(card) rectangle\nmaterial card {{ {keys} }}\n{more}\nground {{ z = -1 }}\n"
        "texture grid { kind = checker; along = uv; scale = 0.25 }"
    )


def hits_from_above(scene: pcsg.Scene, n: int = 60):
    tracer = build_stage(scene, (8, 8), {}).tracer
    x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(-0.99, 0.99, n)] * 2))
    origins = np.stack([x, y, np.full(n * n, 5.0)], axis=1)
    down = np.tile([0.0, 0.0, -1.0], (n * n, 1))
    return tracer, origins, down, tracer.intersect(origins, down, 0.0, np.inf)


def test_rays_go_through_the_second_colour_of_a_pattern() -> None:
    scene = square("cutout = grid")
    tracer, origins, down, hits = hits_from_above(scene)
    plain = scene.intersect(origins, down)
    cells = np.floor(plain.uv / 0.25).sum(axis=1) % 2
    np.testing.assert_array_equal(hits.leaf == GROUND, cells == 1)
    np.testing.assert_array_equal(tracer.inner.occluded(origins, down, 0.0, 9.0), cells == 0)
    # Nothing else changes: the scene itself is a set of points.
    assert np.isfinite(plain.t).all()


@pytest.mark.parametrize("part", [0.0, 0.25, 0.8, 1.0])
def test_opacity_is_the_part_of_rays_that_stop(part) -> None:
    *_, hits = hits_from_above(square(f"opacity = {part}"))
    assert (hits.leaf != GROUND).mean() == pytest.approx(part, abs=0.03)


def test_layers_stop_one_after_the_other() -> None:
    scene = pcsg.loads(
        "material(card) (rectangle | move(0,0,-1) rectangle | move(0,0,-2) rectangle)\n"
        "material card { opacity = 0.5 }"
    )
    *_, hits = hits_from_above(scene)
    shares = [(np.abs(hits.t - t) < 0.1).mean() for t in (5, 6, 7)]
    np.testing.assert_allclose(shares, [0.5, 0.25, 0.125], atol=0.03)


@pytest.mark.parametrize("mode", ["RGBA", "P", "L"])
def test_a_picture_says_where_a_card_is(tmp_path, monkeypatch, mode) -> None:
    monkeypatch.chdir(tmp_path)
    there = np.zeros((8, 8), np.uint8)
    there[:, :4] = 255
    if mode == "L":
        Image.fromarray(there).save("leaf.png")
    else:
        color = np.dstack([np.full((8, 8, 3), 90, np.uint8), there])
        picture = Image.fromarray(color, "RGBA")
        (picture if mode == "RGBA" else picture.quantize(4)).save("leaf.png")
    scene = pcsg.loads(
        "material(card) rectangle\nmaterial card { cutout = leaf }\n"
        'texture leaf { kind = image; file = "leaf.png" }\nground { z = -1 }'
    )
    _, origins, down, hits = hits_from_above(scene)
    u = scene.intersect(origins, down).uv[:, 0] % 1.0
    clear = np.minimum(np.abs(u - 0.5), np.minimum(u, 1 - u)) > 0.1
    np.testing.assert_array_equal((hits.leaf != GROUND)[clear], (u < 0.5)[clear])


@pytest.mark.parametrize("mode", MODES)
def test_light_falls_through_holes_in_every_mode(mode) -> None:
    settings = "sky { kind = none }\nsun { direction = (0,0,1); angle = 0 }"
    camera = {**ABOVE, "eye": (3, 0, 9), "target": (0, 0, -1), "up": (0, 1, 0)}
    lit = {}
    for name, keys in {
        "all": "opacity = 1",
        "none": "opacity = 0",
        "half": "opacity = 0.5",
    }.items():
        scene = square(keys, settings)
        image = pcsg.render(scene, (48, 48), 16, camera=camera, film={"mode": mode})
        on_ground = image.rgb[..., 1] * (image.leaf == GROUND)
        lit[name] = on_ground.sum()
    assert lit["all"] < lit["half"] < lit["none"]


def test_scenes_without_cutouts_have_no_other_tracer() -> None:
    assert not isinstance(build_stage(square("opacity = 1"), (8, 8), {}).things, CutTracer)
    stage = build_stage(square("opacity = 0.5"), (8, 8), {}, detail=0.5)
    assert isinstance(stage.things, DetailedTracer)
    assert isinstance(stage.things.inner, CutTracer)


def test_pictures_do_not_depend_on_threads_and_survive_their_text() -> None:
    scene = square("opacity = 0.5; cutout = grid")
    one, two = (pcsg.render(scene, (60, 40), 4, threads=n) for n in (1, 2))
    assert (one.rgb == two.rgb).all()
    again = pcsg.render(pcsg.loads(scene.to_pcsg()), (60, 40), 4)
    assert (again.rgb == one.rgb).all()


def test_an_unknown_cutout_is_told_with_what_may_be_meant() -> None:
    with pytest.raises(GrammarError, match="did you mean `grid`"):
        square("cutout = grit")
