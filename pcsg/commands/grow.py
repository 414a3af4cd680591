"""``pcsg grow``: counts, curves, pictures and files of growing trees."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcsg.arguments import real
from pcsg.commands.guard import say, show
from pcsg.commands.options import parse_size
from pcsg.errors import PcsgError, UsageError

if TYPE_CHECKING:
    from pcsg.growth.model import GrowthModel
    from pcsg.growth.pictures import Camera

FILMS = ("populus", "shoot", "bbridge")


@dataclass(frozen=True)
class Look:
    """How pictures of trees are made: as for ``pcsg render``."""

    size: str
    samples: int
    mode: str | None
    seed: int | None
    quiet: bool

    @property
    def aspect(self) -> float:
        """Width over height."""
        width, height = parse_size(self.size)
        if width < 1 or height < 1:
            raise UsageError(f"--size takes at least 1x1 pixels, not {self.size}")
        return width / height


def open_model(name: str, seed: int | None = None) -> GrowthModel:
    """Return the model of a species' file, or of a shipped one."""
    from pcsg.growth.model import GrowthModel

    return GrowthModel.load(name, seed)


def species_file(name: str) -> Path:
    """Return the file of a species, or of a shipped one by its name."""
    from pcsg.growth.species import shipped

    if name in shipped():
        return Path(str(resources.files("pcsg.growth") / "data" / f"{name}.json"))
    return Path(name)


def run_counts(name: str, year: int | None, as_json: bool) -> None:
    """Print what a tree has at the ends of years."""
    model = open_model(name)
    years = range(1, model.species.ymax + 1) if year is None else [year]
    counts = [model.counts(y) for y in years]
    if as_json:
        show(json.dumps([vars(c) for c in counts]))
        return
    head = ("year", "operators", "primitives", "shoots", "internodes", "leaves", "by order")
    show("".join(f"{text:>12}" for text in head[:-1]) + "  branches by order")
    for c in counts:
        row = (c.year, c.operators, c.primitives, c.shoots, c.internodes, c.leaves)
        orders = " ".join(str(n) for n in c.branches if n)
        show("".join(f"{n:>12,}" for n in row) + f"  {orders}")


def run_plot(name: str, t: float | None, output: Path | None, quiet: bool) -> None:
    """Write a picture of the curves of a species."""
    from pcsg.growth.plot import plot_species
    from pcsg.outputs import check_output, write_whole

    file = output or Path(f"{Path(name).stem}-curves.png")
    check_output(file, (".png",))
    picture = plot_species(open_model(name), t)
    write_whole(file, lambda out: picture.save(out, "PNG"))
    if not quiet:
        say(str(file))


def run_view(name: str, t: float | None, output: Path | None, once: bool) -> None:
    """Plot a species again whenever its file is saved."""
    file = species_file(name)
    picture = output or Path(f"{file.stem}-view.png")
    seen: int | None = None
    while True:
        stamp = file.stat().st_mtime_ns if file.exists() else 0
        if stamp != seen:
            seen = stamp
            _plot_again(name, t, picture)
        if once:
            return
        time.sleep(0.2)


def _plot_again(name: str, t: float | None, picture: Path) -> None:
    """Write the picture of a species, or say what is wrong with its file."""
    begin = time.perf_counter()
    try:
        model = open_model(name)
        run_plot(name, min(t or 15.0, float(model.species.ymax)), picture, quiet=True)
    except PcsgError as error:
        say(str(error))
        return
    say(f"{picture}: {time.perf_counter() - begin:.1f} s; again when {Path(name).name} is saved")


def run_frame(
    name: str,
    t: float,
    output: Path | None,
    look: Look,
    camera: str = "",
    *,
    denoise: bool = False,
    resume: bool = False,
) -> None:
    """Render a tree at a time."""
    from pcsg.commands.render import RenderArguments, run

    keys = camera or _tree_camera(name, t, look).keys
    run(
        RenderArguments(
            file=species_file(name),
            output=output or Path(f"{Path(name).stem}.png"),
            size=look.size,
            samples=look.samples,
            assignments=_assigned(t=t, seed=look.seed),
            settings={"camera": keys, "film": f"mode={look.mode}" if look.mode else ""},
            denoise=denoise,
            resume=resume,
            quiet=look.quiet,
        )
    )


def _tree_camera(name: str, t: float, look: Look) -> Camera:
    from pcsg.growth.leaf import leafless, read_growth
    from pcsg.growth.pictures import frame_tree
    from pcsg.growth.species import load_species

    file = species_file(name)
    if not file.is_file():
        load_species(name)  # tells what there is
    # The same object as the grammar's, so that the tree is computed once.
    growth = read_growth(file.name, file.parent)
    state = growth.state((t, float(look.seed or 0), 0.0))
    if not look.quiet and (note := leafless(state)):
        say(note)
    return frame_tree(state, look.aspect)


def _assigned(**values: Any) -> list[str]:
    return [f"{name}={value}" for name, value in values.items() if value is not None]


@dataclass(frozen=True)
class Film:
    """Which part of a tree's life is shown.

    Attributes
    ----------
    first, last
        Times, in years; None for what the film shows by default.
    per_year
        Frames; None for the film's default.
    orbit
        Degrees by which the camera goes round.
    """

    first: float | None
    last: float | None
    per_year: float | None
    fps: float
    orbit: float
    jobs: int | None
    resume: bool


def run_animate(name: str, output: Path | None, film: Film, look: Look) -> None:
    """Make a film of a growing tree: ``populus``, ``shoot``, ``bbridge``, or any species."""
    from pcsg.commands.animate import AnimateArguments, run

    species = "populus" if name in FILMS else name
    model = open_model(species, look.seed)
    camera, first, last, per_year = _script(name, model, film, look.aspect)
    count = max(1, round((last - first) * per_year))
    run(
        AnimateArguments(
            file=species_file(species),
            output=output or Path(f"{Path(name).stem}.webp"),
            frames=f"0..{count - 1}",
            fps=film.fps,
            time=None,
            orbit=film.orbit,
            size=look.size,
            samples=look.samples,
            # The first frame shows the tree a step after the beginning: at 0 there is none.
            assignments=[
                f"t={first + (last - first) / count!r}..{last!r}",
                *_assigned(seed=look.seed),
            ],
            seed=None,
            settings={"camera": camera.keys, "film": f"mode={look.mode}" if look.mode else ""},
            jobs=film.jobs,
            include=[],
            max_memory=None,
            engine="auto",
            resume=film.resume,
            quiet=look.quiet,
        )
    )


def _script(
    name: str, model: GrowthModel, film: Film, aspect: float
) -> tuple[Camera, float, float, float]:
    """Return camera, first and last time, and frames in a year."""
    from pcsg.growth.pictures import frame_junction, frame_tree

    ymax = float(model.species.ymax)
    if name == "bbridge":
        camera, birth = frame_junction(model)
        first, last, per_year = birth + 0.4, birth + 10.0, 12.5
    else:
        camera = None
        first, last, per_year = (0.2, 1.0, 150.0) if name == "shoot" else (0.0, ymax, 24.0)
    first = film.first if film.first is not None else first
    last = film.last if film.last is not None else last
    if not 0.0 <= first < last <= ymax:
        raise UsageError(f"times go from 0 to {ymax:g} years, the first before the last")
    if camera is None:
        # The tree at the end fits, with the leaves of its last summer.
        summer = math.floor(last) - 1.0 + model.species.season.leaf_end
        camera = frame_tree(model.at(summer if first < summer else last), aspect)
    if film.per_year is not None:
        per_year = real(film.per_year, "--frames-per-year", 0.0, 1e6)
    return camera, first, last, per_year


def run_export(name: str, output: Path, t: float | None, seed: int | None, quiet: bool) -> None:
    """Write the skeleton of a tree at a time, or the species itself."""
    from pcsg.growth.species import species_text
    from pcsg.outputs import check_output, write_whole
    from pcsg.skeletonfile import SKELETON_ENDINGS
    from pcsg.treemesh.files import save_skeleton

    if t is None:
        check_output(output, (".json",))
        _, text = species_text(name)
        write_whole(output, lambda out: out.write(text.encode()))
        said = f"{output}: the species, to be changed"
    else:
        check_output(output, SKELETON_ENDINGS)
        skeleton = open_model(name, seed).at(t).skeleton()
        save_skeleton(skeleton, output)
        said = f"{output}: {skeleton.n_edges:,} segments at t = {t:g}"
    if not quiet:
        say(said)
