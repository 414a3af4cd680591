"""``pcsg gallery``: the grammars that come with pcsg, and their pictures. ``pcsg new``: a start."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

import typer

from pcsg.commands.guard import INTERRUPTED, say, show
from pcsg.commands.parent import start_tied
from pcsg.errors import EnvironmentFault, UsageError, suggest
from pcsg.inputs import read_text
from pcsg.outputs import sweep, write_whole


@dataclass(frozen=True)
class Picture:
    """A picture of the gallery.

    Attributes
    ----------
    name
        Of the picture.
    title
        What it shows.
    samples
        Most samples per pixel.
    file
        Where the grammar is, if not in ``name.pcsg``.
    """

    name: str
    title: str
    samples: int = 16
    file: str = ""

    @property
    def grammar(self) -> str:
        """The grammar's file in the folder of grammars."""
        return self.file or f"{self.name}.pcsg"


PICTURES = (
    Picture("tree", "A tree in the afternoon"),
    Picture("sierpinski", "The Sierpinski tetrahedron (picture 1)"),
    Picture("relief", "Landsberg's relief (picture 2)"),
    Picture("leaf", "Leaves of hollow balls (picture 3)"),
    Picture("palm", "A palm (picture 4)"),
    Picture("flower", "A flower (picture 5)"),
    Picture("conifer", "A conifer (picture 6)"),
    Picture("fig5a", "The tree of fig 5a (picture 7)"),
    Picture("plant", "A stochastic plant (picture 8)"),
    Picture("sea", "Terrain and a sea (picture 9)"),
    Picture("terrain", "An island"),
    Picture("menger", "The Menger sponge"),
    Picture("sponge", "Inside a Menger sponge of order 20", 32),
    Picture("dawn", "A forest on an island at dawn"),
    Picture("zoom", "Near the corner of a Sierpinski tetrahedron of order 40"),
    Picture("meadow", "A meadow"),
    Picture("sunflower", "Ten thousand tiles in the order of a sunflower"),
    Picture("limbs", "Patterns that follow limbs"),
    Picture("hamlet", "A hamlet at dusk, in fog", 32),
    Picture("mushrooms", "Mushrooms that glow", 144),
    Picture("dew", "Dew on blades of grass", 64),
    Picture("flock", "A flock of birds"),
    Picture("wind", "An autumn tree in the wind"),
    Picture("ages", "A poplar at six ages"),
    Picture("junctions", "Junctions of implicit branches", file="blobtree/junctions.pcsg"),
    Picture("wounds", "Wounds of implicit branches", file="blobtree/wounds.pcsg"),
    Picture("bulge", "Where implicit branches bulge", file="blobtree/bulge.pcsg"),
    Picture("plates", "Bark that blends at forks", file="blobtree/plates.pcsg"),
    Picture("poplar", "A poplar in winter, an implicit tree", file="poplar.lsys"),
    Picture("oak", "An oak, an implicit tree", file="lsystems/oak.lsys"),
    Picture("grove", "A grove of implicit trees"),
    Picture("bush", "A bush by the rules of an L-system", file="lsystems/bush.lsys"),
    Picture("fern", "A fern that unrolls", file="lsystems/fern.lsys"),
)
"""What `docs/gallery.md` shows, in its order."""


def folder() -> Path:
    """Return where the grammars are: beside the package, or in it once it is installed."""
    package = Path(__file__).resolve().parents[1]
    for place in (package / "grammars", package.parent / "grammars"):
        if (place / "tree.pcsg").exists():
            return place
    raise EnvironmentFault("the grammars of the gallery are not installed with this pcsg")


LARGEST = 400_000
"""Bytes above which a picture is left with 256 colours: fine patterns do not pack."""

PROGRESS = ".gallery.progress"
"""File beside the pictures with the names of those that are done, until all are."""


def run(
    names: Sequence[str], render: bool, copy: bool, output: Path, size: str, samples: int | None
) -> None:
    """List the gallery, copy its grammars, or make its pictures, each in a process of its own.

    What was interrupted goes on where it stopped, if it is asked for in the same way.

    Parameters
    ----------
    names
        Which pictures; all if empty.
    size, samples
        Of the pictures, None for as many samples as each needs.
    """
    known = {picture.name: picture for picture in PICTURES}
    for name in names:
        if name not in known:
            hint = suggest(name, known)
            raise UsageError(f"the gallery has no picture `{name}`" + (f"; {hint}" if hint else ""))
    chosen = [known[name] for name in names] or list(PICTURES)
    place = folder()
    if copy and render:
        raise UsageError("--copy and --render are two commands")
    if copy:
        copy_grammars(chosen if names else (), output)
        return
    if not render:
        width = max(len(picture.name) for picture in chosen)
        for picture in chosen:
            show(f"{picture.name:{width}}  {picture.title}")
        show(f"\nThe grammars are in {place}.")
        show("`pcsg gallery tree --copy` copies one, `--render` makes its picture.")
        return
    if not output.is_dir():
        raise UsageError(f"there is no folder {output}")
    sweep(output)
    progress = _Progress(output / PROGRESS, f"pictures of {size}, samples {samples or 'as needed'}")
    began, most = time.perf_counter(), 0
    for picture in chosen:
        path = output / f"{picture.name}.png"
        if picture.name in progress.done and path.exists():
            say(f"{path} is made already")
            continue
        most = max(most, _make(picture, place, path, size, samples))
        progress.add(picture.name)
    progress.end()
    if most:
        minutes = (time.perf_counter() - began) / 60
        say(f"the gallery is made: {minutes:.1f} minutes, at most {most / 1e6:.0f} MB")


def find(name: str) -> Picture | None:
    """Return the picture of the gallery that is named like a file, None if there is none."""
    known = {picture.name: picture for picture in PICTURES}
    return known.get(Path(name).stem)


def copy_grammars(chosen: Sequence[Picture], output: Path) -> None:
    """Copy grammars of the gallery with the files that they read, each as it is there.

    Raises
    ------
    UsageError
        No picture is named, there is no such folder, or a file is there already.
    """
    if not chosen:
        raise UsageError("--copy takes the names of pictures: pcsg gallery tree --copy")
    if not output.is_dir():
        raise UsageError(f"there is no folder {output}")
    place = folder()
    files: dict[Path, bytes] = {}
    for picture in chosen:
        source = place / picture.grammar
        for file in (source, *_read_by(source)):
            # Beside the grammar, as it names them.
            target = output / file.relative_to(source.parent)
            files[target] = file.read_bytes()
    for target, content in files.items():
        if target.exists() and target.read_bytes() != content:
            raise UsageError(f"{target} is there already, and differs; it is left as it is")
    for target, content in files.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, partial(_write, content))
    heads = [str(output / Path(picture.grammar).name) for picture in chosen]
    say(f"{', '.join(map(str, files))} copied; `pcsg render {heads[0]}` makes its picture")


def _write(content: bytes, file: IO[bytes]) -> None:
    file.write(content)


def _read_by(grammar: Path) -> list[Path]:
    """Return the files beside a grammar that it names in quotes, and those that these name."""
    found: list[Path] = []
    todo = [grammar]
    while todo:
        reader = todo.pop()
        for name in re.findall(r'"([^"\n]+)"', reader.read_text(encoding="utf-8")):
            file = reader.parent / name
            if file.is_file() and file not in found:
                found.append(file)
                if file.suffix in (".pcsg", ".lsys"):
                    todo.append(file)
    return found


class _Progress:
    """Which pictures an interrupted run has made.

    Parameters
    ----------
    path
        The file that keeps it.
    kind
        How the pictures are made: others count for nothing.
    """

    def __init__(self, path: Path, kind: str) -> None:
        self._path = path
        lines = read_text(path, "list of pictures").splitlines() if path.exists() else []
        self.done = lines[1:] if lines[:1] == [kind] else []
        self._kind = kind

    def add(self, name: str) -> None:
        self.done.append(name)
        text = "\n".join([self._kind, *self.done])
        write_whole(self._path, lambda file: file.write(text.encode()))

    def end(self) -> None:
        self._path.unlink(missing_ok=True)


def _make(picture: Picture, place: Path, path: Path, size: str, samples: int | None) -> int:
    """Make a picture; return how many bytes that took."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "pcsg", "render", str(place / picture.grammar)]
    command += ["-o", str(path), "--size", size, "--samples", str(samples or picture.samples)]
    if path.with_name(path.name + ".checkpoint").exists():
        command.append("--resume")
    with start_tied([*command, "--json", "-q"], stdout=subprocess.PIPE) as process:
        assert process.stdin and process.stdout
        try:
            # Its standard input stays open until it has ended.
            output = process.stdout.read()
            process.wait()
            stopped = process.returncode == INTERRUPTED
        except KeyboardInterrupt:
            # The terminal has told the process, too; it keeps a checkpoint.
            process.wait()
            stopped = True
    if stopped:
        say("stopped; the same command goes on")
        raise typer.Exit(INTERRUPTED)
    if process.returncode != 0:
        raise EnvironmentFault(f"{picture.name} was not made: status {process.returncode}")
    _shrink(path)
    told = json.loads(output)
    memory = told["memory"] or 0
    say(
        f"{path}: {time.perf_counter() - began:.0f} s, {told['rays'] / 1e6:.3g} million rays,"
        f" {told['rays_per_second'] / 1e6:.2g} million/s, {memory / 1e6:.0f} MB"
    )
    return int(memory)


def _shrink(path: Path) -> None:
    """Leave a picture that is large with 256 colours, and with its texts."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    if path.stat().st_size <= LARGEST:
        return
    with Image.open(path) as picture:
        texts = PngInfo()
        for keyword, text in picture.info.items():
            if isinstance(keyword, str) and isinstance(text, str):
                texts.add_text(keyword, text)
        few = picture.convert("RGB").quantize(256, dither=Image.Dither.FLOYDSTEINBERG)
    write_whole(path, lambda file: few.save(file, format="PNG", optimize=True, pnginfo=texts))


STARTER = """\
// NAME.pcsg. Make a picture:   pcsg render NAME.pcsg
// Other values, by chance, growing:   -D n=5   --seed 3   pcsg animate NAME.pcsg -D n=1..8

// The axiom: parameters in braces, then what is drawn.
{   n = 8;               // how often a limb forks
    angle = 32;          // how far its two parts bend to the sides, in degrees
} LIMB

// A module: its selection function says by number which rule is taken.
LIMB if(n > 0, 2, 1)
1: LIMB -> leaf
2: LIMB -> twig | move(0, 0, 1) {n = n-1} rotz(80 + 40*rand(n, SEED)) (
       rotx(angle) uscale(0.78) LIMB             // | is union, & intersection, \\ difference
     | rotx(-0.8*angle) uscale(0.82) LIMB )

// Names for solids. Transformations act on what stands behind them.
twig = material(bark) (scale(0.1, 0.1, 1) cone(0.8) | move(0, 0, 1) uscale(0.08) sphere)
leaf = material(green) color(0.25 + 0.2*rand(n), 0.5, 0.05)
       move(0, 0, 0.4) scale(0.25, 0.06, 0.5) sphere

// All from here is optional: without it there are an automatic camera and light.
material bark { color = (0.22, 0.15, 0.10); roughness = 1 }
material green { roughness = 0.5; translucency = 0.4 }
material grass { color = (0.20, 0.25, 0.08); roughness = 1; specular = 0 }
ground { z = 0; material = grass }
sun { direction = (-0.8, -0.4, 0.7); color = (1, 0.9, 0.75); strength = 4 }
"""
"""A grammar to begin with."""


def start(name: str) -> None:
    """Write a commented grammar to begin with.

    Raises
    ------
    UsageError
        The name is none for a file, or the file is there.
    """
    path = Path(name if name.endswith(".pcsg") else name + ".pcsg")
    if path.exists():
        raise UsageError(f"{path} is there already; it is left as it is")
    from pcsg.outputs import check_output

    check_output(path, (".pcsg",))
    text = STARTER.replace("NAME", path.stem).replace("\\\\\\\\", "\\\\")
    write_whole(path, lambda file: file.write(text.encode()))
    say(f"{path} is written; `pcsg render {path}` makes its picture")
