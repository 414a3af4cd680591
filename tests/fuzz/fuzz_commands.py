"""Commands with spoilt words and files: whatever is asked, no fault of pcsg itself comes of it.

`pcsg.commands.guard` tells every error. What it can only call a mistake in pcsg itself is let out
here, with all that led to it, and so are warnings, which would stand on a user's screen.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import fuzz_grammars
import fuzz_lsystems
import fuzz_obj
import fuzz_ply
import fuzz_skeletons
import fuzz_species
import typer
from driver import Subject
from mutations import NUMBERS, spoil_bytes, spoil_text
from spoiltmeshes import CUBE, QUADS
from writers import obj_text, ply_bytes

from pcsg.cli import app
from pcsg.commands import guard, warmup
from pcsg.lidar.echoes import pieces_of

MISTAKE = "this is a mistake in pcsg itself"

GRAMMAR = """{c = 2} color(0.2, c/3, 0.5) S
S if(c > 0, 2, 1)
1: S -> label(7) sphere
2: S -> {c = c-1} (move(0, 0, 1.5 + TIME/9) uscale(0.7) S | material(red) box)
material red { roughness = 0.5 }
camera { eye = (3, -8, 3); target = (0, 0, 1) }
sun { direction = (1, -1, 2) }
"""
TWIG = """{n = 2} T
T if(n > 0, 2, 1)
1: T -> scale(0.1, 0.1, 1) cone(0.7)
2: T -> scale(0.1, 0.1, 1) cone(0.7) | {n = n-1} move(0,0,1) uscale(0.7) (rotx(-40) T | rotx(30) T)
"""

FILES = {
    "a.pcsg": GRAMMAR,
    "twig.pcsg": TWIG,
    "a.lsys": fuzz_lsystems.SMALL[0],
    "tree.swc": fuzz_skeletons.SWC,
    "tree.json": json.dumps({"nodes": fuzz_skeletons.NODES, "edges": fuzz_skeletons.EDGES}),
    "young.json": json.dumps({"species": "x", "ymax": 3, "trunk_scale": 1.5, "order_max": 2}),
    "cube.obj": obj_text(CUBE, QUADS),
    "cube.ply": ply_bytes(CUBE, QUADS, "ascii").decode("latin-1"),
    "sky.pcsg": '{} sphere\nsky { kind = image; file = "sky.hdr" }\n',
    "sky.hdr": "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + "\x10" * 32,
    "mesh.pcsg": '{} mesh("cube.obj")\ncamera { eye = (3, -8, 3) }\n',
    "a.png.checkpoint": "PK\x03\x04",
}
"""By their names; a character stands for a byte."""

SMALL = ("--size", "6x4", "--samples", "2")

SEEDS: tuple[tuple[str, ...], ...] = (
    ("render", "a.pcsg", *SMALL),
    ("render", "a.pcsg", *SMALL, "--mode", "path", "--aov", "depth,normal,albedo,label,leaf"),
    ("render", "a.pcsg", *SMALL, "-D", "c=1", "--seed", "3", "--time", "2", "-o", "b.exr"),
    ("render", "a.pcsg", *SMALL, "--camera", "eye=1,-5,2 target=0,0,1 fov=30", "--json"),
    ("render", "a.pcsg", *SMALL, "--sun", "direction=1,0,1 strength=2", "--ground", "z=auto"),
    ("render", "a.pcsg", *SMALL, "--tile", "1/1", "--bits", "16", "--profile", "-v"),
    ("render", "a.pcsg", *SMALL, "--engine", "cyclic", "--max-memory", "100M", "--threads", "1"),
    ("render", "a.pcsg", *SMALL, "--resume"),
    ("render", "sky.pcsg", *SMALL, "--sky", "strength=0.5"),
    ("render", "mesh.pcsg", *SMALL),
    ("render", "a.lsys", *SMALL),
    ("check", "a.pcsg"),
    ("check", "sky.pcsg", "--json", "--include", "."),
    ("stats", "a.pcsg", "-D", "c=3", "--json"),
    ("stats", "a.lsys"),
    ("graph", "a.pcsg", "-o", "a.svg"),
    ("graph", "a.pcsg", "-o", "a.png"),
    ("animate", "a.pcsg", *SMALL, "--frames", "0..1", "-D", "c=1..2", "--orbit", "90"),
    ("animate", "a.pcsg", *SMALL, "--frames", "3..4", "--time", "0..1", "-o", "f_##.png"),
    ("scan", "a.pcsg", "--at", "0,-6,1", "--figure", "step=20", "-o", "c.csv", "--class", "7=5"),
    ("scan", "a.pcsg", "--scanner", "vlp16", "--at", "0,-6,1..0,6,1", "-o", "c.npz", "--resume"),
    ("scan", "twig.pcsg", "--at", "0,0,9", "--figure", "zenith=90,180", "-o", "c.ply", "-q"),
    ("new", "b"),
    ("gallery",),
    ("gallery", "sea", "--copy", "-o", "."),
    ("mesh", "twig.pcsg", "-o", "t.obj", "--levels", "1"),
    ("mesh", "tree.swc", "-o", "t.ply", "--report", "r.json", "--foot", "--levels", "1"),
    ("mesh", "a.pcsg", "--method", "contour", "--resolution", "8", "--json"),
    ("skeleton", "tree.json", "-o", "s.swc", "--min-radius", "0.1", "--max-order", "1"),
    ("skeleton", "cube.obj", "--largest-only", "--reach", "0.5"),
    ("skeleton", "cube.ply", "-o", "s.json"),
    ("compose", "tree.swc", "--with", "tree.json", "-n", "1", "--seed", "2"),
    ("grow", "counts", "young.json", "--year", "2"),
    ("grow", "plot", "young.json", "--t", "1.5"),
    ("grow", "view", "young.json"),
    ("grow", "frame", "young.json", "--t", "2.6", *SMALL),
    ("grow", "animate", "young.json", *SMALL, "--from", "2", "--to", "2.1", "--orbit", "9"),
    ("grow", "export", "young.json", "-o", "y.swc", "--t", "2"),
    ("grow", "export", "populus", "-o", "p.json"),
)

WORDS = (
    *NUMBERS,
    *("", " ", "-", "--", "=", ".", "..", "/", "a.", "nothing/a.png", "a" * 300),
    *("\udcff", "caf\u00e9", "\u2028", "[bold]x[/bold]", "sea", "sierpinski", "shoot"),
    *(f"a{end}" for end in (".png", ".exr", ".gif", ".webp", ".mp4", ".obj", ".ply", ".glb")),
    *(f"b{end}" for end in (".usd", ".usda", ".swc", ".json", ".svg", ".dot", "_###.png", ".lsys")),
    *FILES,
)
"""That may stand anywhere."""

CAMERAS = ("eye=0,0,0 target=0,0,0", "eye=1,2,3 fov=179", "eye=1e300,0,0", "up=0,0,0 fov=1e-9")
SETTINGS = ("direction=0,0,0", "strength=1e300", "color=-1,1e300,0", "angle=1e9", "nothing=1")

FITTING: dict[str, tuple[str, ...]] = {
    "--size": ("6x4", "1x1", "7x1", "0x0", "-1x5", "99999999x99999999", "6\u00d74"),
    "--frames": ("0..0", "3..1", "0..9999999", "9999998..9999999", "-1..1", "0..2"),
    "--tile": ("1/2", "2/2", "0/0", "3/2", "999999999/999999999"),
    "--max-memory": ("0", "1K", "50M", "1.5GB", "999999999999999999T", "-5M"),
    "--block-memory": ("0", "1K", "16M", "999999999999999999T"),
    "--set": ("c=1", "c=1e3", "c=-1e300", "c=-3..1e300", "q=1", "=", "SEED=1e300", "t=2", "c=0.5"),
    "--camera": CAMERAS,
    "--sun": (*SETTINGS, "strength=0 direction=1,1,1"),
    "--sky": (*SETTINGS, "kind=image file=cube.obj", 'kind=image file="sky.hdr"', "kind=daylight"),
    "--ground": ("z=auto", "z=auto material=red", "z=1e300", "z=-0", "material=nothing"),
    "--aov": ("depth", "depth,,depth", "depth,normal,albedo,label,leaf", "rgb", ","),
    "--engine": ("auto", "cyclic", "states", "Cyclic"),
    "--mode": ("preview", "direct", "path", "x"),
    "--view": ("standard", "filmic", "x"),
    "--figure": (
        "step=30",
        "step=1e-300",
        "zenith=0,1e300",
        "lines=1,2",
        "pattern=mirror",
        "=",
        "pulse=0",
    ),
    "--at": ("0,0,0", "1e300,0,0", "0,0,3..5,5,3", "0,0", "nan,0,0", ".."),
    "--periodic": ("-1,-1,1,1", "0,0,0,0", "0,0,1e-300,1", "1e300,0,2e300,1"),
    "--class": ("7=5", "7=256", "=", "-1=2"),
    "--returns": ("first", "last", "strongest", "x"),
    "--method": ("quads", "contour"),
    "--kernel": ("cauchy", "quartic"),
    "--locality": ("graph", "all"),
    "--time": ("0..1", "-1..1", "1e300", "1e300..-1e300", "3"),
}
"""What an option takes, by its long name."""

COUNTS = ("0", "1", "2", "3", "-1", "16", "2147483648", "-4294967297", "18446744073709551617")
COUNTS += ("1" + "0" * 400,)
AMOUNTS = ("0", "1", "-1", "0.5", "2.25", "1e-320", "1e9", "1e300", "-1e308", "nan", "inf")

UNTRIED = ("--render", "--help", "-h")
"""Options that other commands do the work of, or none."""


@cache
def _command() -> Any:
    """Return what the command line is made of, which takes longer than many a command."""
    return typer.main.get_command(app)


@cache
def _options() -> dict[tuple[str, ...], list[tuple[str, Sequence[str]]]]:
    """Return the options of every verb, and what they may take; nothing for switches."""
    found = {}
    todo: list[tuple[tuple[str, ...], Any]] = [((), _command())]
    while todo:
        words, command = todo.pop()
        todo += [((*words, n), c) for n, c in getattr(command, "commands", {}).items()]
        found[words] = [
            (name, () if param.is_flag else _fitting(param))
            for param in command.params
            for name in (*param.opts, *param.secondary_opts)
            if name.startswith("-") and name not in UNTRIED
        ]
    return found


def _fitting(param: Any) -> Sequence[str]:
    for name in param.opts:
        if name in FITTING:
            return FITTING[name]
    told = getattr(param, "type_descriptor", None)  # of newer versions of typer
    kind = str(told.annotation if told else param.type).lower()
    return COUNTS if "int" in kind else AMOUNTS if "float" in kind else WORDS


def _verb(words: Sequence[str]) -> tuple[str, ...]:
    return tuple(words[: 2 if words[:1] == ["grow"] else 1])


def seeds() -> Sequence[str]:
    return [_packed(list(words), {n: FILES[n] for n in FILES if n in words}) for words in SEEDS]


def _packed(words: list[str], files: dict[str, str]) -> str:
    """Return an input: a command, and the files that are there."""
    # What a grammar names is there, too, and what a command goes on from.
    files |= {n: FILES[n] for n in FILES if n.endswith(".checkpoint") and "--resume" in words}
    files |= {n: FILES[n] for n in FILES for text in [*files.values()] if f'"{n}"' in text}
    return json.dumps({"words": words, "files": files})


_SPOILERS: dict[str, Callable[[random.Random, Any], Any]] = {
    ".pcsg": lambda rng, text: spoil_text(rng, text, fuzz_grammars.WORDS, 3),
    ".lsys": fuzz_lsystems.mutate,
    ".swc": fuzz_skeletons.mutate,
    ".json": fuzz_species.mutate,
    ".obj": lambda rng, text: spoil_text(rng, text, fuzz_obj.WORDS),
    ".ply": lambda rng, text: spoil_text(rng, text, fuzz_ply.WORDS),
}


def mutate(rng: random.Random, text: str) -> str:
    given = json.loads(text)
    words, files = given["words"], given["files"]
    for _ in range(rng.choice([1, 1, 2, 3])):
        what = rng.randrange(6)
        at = rng.randrange(len(words))
        if what == 0 and files:  # a file
            name = rng.choice(sorted(files))
            spoil = _SPOILERS.get(Path(name).suffix)
            if spoil and rng.random() < 0.8:
                spoilt = str(spoil(rng, files[name])).encode("utf-8", "surrogatepass")
            else:
                spoilt = spoil_bytes(rng, files[name].encode("latin-1", "replace"))
            files[name] = spoilt.decode("latin-1")
        elif what == 1 and at:
            words[at] = rng.choice(WORDS)
        elif what == 2 and at and rng.random() < 0.3:
            del words[at]
        elif what == 3 and at:
            words[at] = spoil_text(rng, words[at], ("=", ",", "..", "x", "-", *NUMBERS), 2)
        else:
            options = _options().get(_verb(words)) or [("-o", WORDS)]
            name, values = rng.choice(options)
            words += (
                [name, rng.choice(values if rng.random() < 0.9 else WORDS)] if values else [name]
            )
    return _packed(words, files)


def _first_pieces(*args: Any) -> Any:
    """Return two parts of a scan: the others are alike."""
    return [piece._replace(beams=min(piece.beams, 50)) for piece in pieces_of(*args)[:2]]


class _Here:
    """Takes the place of a pool of processes: works at once, in this one."""

    def __init__(self, *_args: object, **_kwargs: object) -> None:
        self.left = 2

    def __enter__(self) -> _Here:
        return self

    def __exit__(self, *_args: object) -> None:
        pass

    def submit(self, work: Callable[[Any], None], given: Any) -> Future[None]:
        done: Future[None] = Future()
        if self.left:  # the others are alike
            self.left -= 1
            work(given)
        done.set_result(None)
        return done

    def shutdown(self, **_kwargs: object) -> None:
        pass


@contextlib.contextmanager
def _within(folder: Path) -> Iterator[None]:
    """Be in a folder for a while."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run(text: str, folder: Path) -> None:
    given = json.loads(text)
    for name, content in given["files"].items():
        (folder / name).write_bytes(content.encode("latin-1", "replace"))
    words = [word.replace("\0", "") for word in given["words"]]
    if words[:2] == ["grow", "view"]:
        words.append("--once")
    with _within(folder):
        call(words)


def call(words: Sequence[str]) -> tuple[int, str]:
    """Run a command; return its exit status and what it has told, or raise what is a mistake."""
    told = io.StringIO()
    tell = guard._tell

    def tell_or_raise(error: BaseException) -> int:
        status = tell(error)
        if MISTAKE in told.getvalue():
            raise error
        return status

    with (
        patch.object(guard, "_tell", tell_or_raise),
        patch("pcsg.lidar.echoes.pieces_of", _first_pieces),
        patch("pcsg.commands.animate.ProcessPoolExecutor", _Here),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(told),
    ):
        try:
            _command()(words, prog_name="pcsg")
        except SystemExit as end:
            return int(end.code or 0), told.getvalue()
    raise AssertionError("a command ends with a status")


def prepare() -> None:
    """Compile the kernels."""
    with contextlib.redirect_stdout(io.StringIO()):
        warmup.run(as_json=True)


SUBJECT = Subject("commands", seeds, mutate, run, prepare)
