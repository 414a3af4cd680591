import json
import math
from threading import Event

import numpy as np
import pytest
from PIL import Image as Pillow
from spheres import Spheres

from pcsg.errors import EnvironmentFault, EvaluationFault, UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.render.job import Job, render
from pcsg.render.options import Options

SMALL = Options(size=(90, 60), samples=16)
GROUND = {"z": None, "material": None}


def picture(**options):
    job = Job(Spheres(ground=[GROUND]), Options(**{"size": (90, 60), **options}))
    job.run()
    return job


def test_threads_do_not_change_a_bit():
    one, three = picture(threads=1), picture(threads=3)
    assert one.progress.rays == three.progress.rays
    for a, b in zip(one.image().__dict__.values(), three.image().__dict__.values(), strict=True):
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


def test_a_seed_changes_the_sampling_but_not_the_layers():
    one, two = picture(seed=1).image(), picture(seed=2).image()
    assert not np.array_equal(one.rgb, two.rgb)
    assert np.array_equal(one.depth, two.depth)
    assert np.array_equal(one.label, two.label)
    assert np.abs(one.rgb - two.rgb).mean() < 0.01


def test_samples_go_where_neighbours_differ():
    job = picture(samples=16)
    count = job.film.count
    assert set(np.unique(count)) == {1, 4, 16}
    leaf = job.film.leaf
    edges = np.zeros(leaf.shape, dtype=bool)
    edges[:, 1:] |= leaf[:, 1:] != leaf[:, :-1]
    assert (count[edges] >= 4).all()
    assert count[0].max() == 1
    assert count.mean() < 12
    assert job.progress.samples == count.sum()


def test_adaptive_pictures_agree_with_full_ones():
    adaptive = picture(samples=64).image().rgb
    full = Job(Spheres(ground=[GROUND]), Options(size=(90, 60), samples=64))
    full.film.unfinished = lambda taken: np.ones((60, 90), dtype=bool)
    full.run()
    assert (full.film.count == 64).all()
    error = np.abs(adaptive - full.image().rgb)
    assert error.mean() < 2e-3
    assert np.quantile(error, 0.99) < 0.03


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 17])
def test_any_number_of_samples(samples):
    job = picture(samples=samples)
    assert job.film.count.max() == samples
    assert np.isfinite(job.image().rgb).all()


def test_one_pixel():
    job = picture(size=(1, 1), samples=4)
    assert job.image().rgb.shape == (1, 1, 3)


def test_layers_say_what_pixels_show():
    scene = Spheres(centers=[(0, 0, 0)], radii=[1.0])
    camera = {"eye": (0.0, -5.0, 0.0), "target": (0.0, 0.0, 0.0)}
    image = render(scene, (33, 33), samples=4, camera=camera)
    assert image.depth[16, 16] == pytest.approx(4.0)
    assert np.isinf(image.depth[0, 0])
    np.testing.assert_allclose(image.normal[16, 16], (0, -1, 0), atol=1e-6)
    assert (image.normal[0, 0] == 0).all()
    assert image.label[16, 16] == 10
    assert image.label[0, 0] == -1
    assert image.finished.all()


def test_shadows_lie_away_from_the_sun():
    scene = Spheres(centers=[(0, 0, 1)], radii=[1.0], ground=[{"z": 0.0, "material": None}])
    top = {"eye": (0.0, 0.0, 20.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0)}
    image = render(scene, (64, 64), samples=1, camera=top, sun={"direction": (1.0, 0.0, 1.0)})
    brightness = image.rgb.mean(axis=2)
    left, right = brightness[32, :32].min(), brightness[32, 42:].min()
    assert left < 0.6 * right


def test_no_surface_shadows_itself_at_any_scale():
    for size in (1e-6, 1.0, 1e6):
        for away in (0.0, 1e3 * size):
            scene = Spheres(centers=[(away, away, 0)], radii=[size], color=(0.5, 0.5, 0.5))
            # The sun behind the eye: every visible point is lit, only grazing ones less so.
            sun = {"direction": (-0.47, -0.88, 0.3), "angle": 0.0}
            image = render(scene, (48, 48), samples=1, sun=sun, sky={"kind": "none"})
            hit = np.isfinite(image.depth)
            inner = (
                hit[1:-1, 1:-1] & hit[:-2, 1:-1] & hit[2:, 1:-1] & hit[1:-1, :-2] & hit[1:-1, 2:]
            )
            assert inner.sum() > 300
            assert (image.rgb[1:-1, 1:-1][inner].min(axis=1) > 0).all()


def test_a_furnace_of_sky_gives_the_albedo():
    scene = Spheres(centers=[(0, 0, 0)], radii=[1.0], material=0, color=(0.5,) * 3)
    white = {"zenith": (1.0,) * 3, "horizon": (1.0,) * 3}
    scene.settings["material"] = [
        {
            **{key: k.default for key, k in SETTINGS["material"].keys.items()},
            "name": "matt",
            "color": (0.5,) * 3,
            "roughness": 1.0,
            "specular": 0.0,
        }
    ]
    job = Job(
        scene, Options(size=(20, 20), samples=1, overrides={"sky": white, "sun": {"strength": 0.0}})
    )
    sky = job.stage.sky
    object.__setattr__(job.stage, "sky", type(sky)(sky.zenith, sky.horizon, sky.horizon))
    job.run()
    image = job.image()
    np.testing.assert_allclose(image.rgb[np.isfinite(image.depth)], 0.5, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        ({"size": (0, 10)}, UsageError, "size"),
        ({"size": (10, -3)}, UsageError, "size"),
        ({"size": (10**9, 10**9)}, EnvironmentFault, "memory"),
        ({"size": (10**7, 1)}, UsageError, "at most"),
        ({"size": (1000, 1000), "max_memory": 1000}, EnvironmentFault, "memory"),
        ({"samples": 0}, UsageError, "samples"),
        ({"samples": 10**9}, UsageError, "samples"),
        ({"threads": 0}, UsageError, "threads"),
    ],
)
def test_impossible_pictures_are_refused_at_once(options, error, word):
    with pytest.raises(error, match=word):
        render(Spheres(), **options)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"camra": {}}, "camra"),
        ({"camera": {"eie": 1}}, "did you mean `eye`"),
        ({"ground": {"material": "gras"}}, "gras"),
    ],
)
def test_unknown_settings_are_refused(settings, word):
    with pytest.raises(UsageError, match=word):
        render(Spheres(), **settings)


def test_a_fault_keeps_the_picture_so_far():
    scene = Spheres()
    job = Job(scene, Options(size=(300, 200), samples=16, threads=1))
    scene.fault_after = scene.batches + 4
    with pytest.raises(EvaluationFault):
        job.run()
    image = job.image()
    assert image.finished.all()
    assert image.rgb.max() > 0


def test_an_interrupt_stops_within_a_batch():
    scene = Spheres()
    job = Job(scene, Options(size=(600, 400), samples=16, threads=2))
    seen = Event()

    def interrupt(progress):
        seen.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        job.run(interrupt)
    assert seen.is_set()
    finished = job.image().finished
    assert 0 < finished.mean() < 1
    assert scene.batches <= 5


def test_progress_is_told():
    told = []
    job = Job(Spheres(), Options(size=(200, 150), samples=16))
    job.run(lambda p: told.append((p.pass_number, p.samples, p.expected, p.rays)))
    assert [t[0] for t in told] == sorted(t[0] for t in told)
    assert all(samples <= expected for _, samples, expected, _ in told)
    assert told[-1][1] == told[-1][2] == job.film.count.sum()
    assert told[-1][3] > told[-1][1]


def test_a_file_says_how_it_was_made(tmp_path):
    job = Job(Spheres(), SMALL, {"pcsg:command": "pcsg render väldigt.pcsg"})
    job.run()
    written = job.image().save(tmp_path / "a.png", ["depth", "label"])
    assert [p.name for p in written] == ["a.png", "a.depth.npy", "a.label.npy"]
    with Pillow.open(tmp_path / "a.png") as file:
        assert file.size == (90, 60)
        assert file.mode == "RGB"
        text = file.text
    assert text["pcsg:grammar"] == "0123abcd"
    assert json.loads(text["pcsg:parameters"]) == {"cnt": 3.0}
    assert (text["pcsg:size"], text["pcsg:samples"], text["pcsg:seed"]) == ("90x60", "16", "1")
    assert text["Software"].startswith("pcsg ")
    assert text["pcsg:command"] == "pcsg render väldigt.pcsg"
    assert np.array_equal(np.load(tmp_path / "a.depth.npy"), job.film.depth)
    assert job.image()._repr_png_().startswith(b"\x89PNG")


def test_unfinished_pixels_are_transparent(tmp_path):
    job = Job(Spheres(), SMALL)
    assert job.image().to_bytes().shape == (60, 90, 4)
    assert job.image().to_bytes()[..., 3].max() == 0
    job.run()
    assert job.image().to_bytes().shape == (60, 90, 3)


def test_the_ground_fades_into_the_sky():
    scene = Spheres(ground=[GROUND])
    camera = {"eye": (0.0, -10.0, 2.0), "target": (0.0, 0.0, 1.9), "fov": 40.0}
    image = render(scene, (40, 200), samples=1, camera=camera)
    column = image.rgb[:, 0].mean(axis=1)
    horizon = np.flatnonzero(np.isfinite(image.depth[:, 0]))[0]
    assert 0 < horizon < 199
    assert abs(column[horizon] - column[horizon - 1]) < 0.02
    assert math.isfinite(column.sum())
