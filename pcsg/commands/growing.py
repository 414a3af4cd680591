"""The verbs of ``pcsg grow``, thin, as `pcsg.cli` has the others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pcsg.commands.arguments import Json, Quiet
from pcsg.commands.guard import guard

app = typer.Typer(
    name="grow",
    help="Trees of any age: counts, curves, pictures, films, skeletons.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Species = Annotated[
    str,
    typer.Argument(
        metavar="SPECIES",
        help="A file (.json), or a name: populus, spruce, birch.",
        show_default=False,
    ),
]
Out = Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT", show_default=False)]
At = Annotated[
    float | None,
    typer.Option("--t", metavar="YEARS", help="Age of the tree; a whole year is midwinter."),
]
Seed = Annotated[
    int | None, typer.Option("--seed", min=0, help="Random seed: another tree of the same species.")
]
Size = Annotated[str, typer.Option("--size", metavar="WxH", help="Width x height in pixels.")]
Samples = Annotated[int, typer.Option("--samples", help="Set the maximum samples per pixel.")]
Mode = Annotated[
    str | None, typer.Option("--mode", help="Follow light by preview, direct or path.")
]


@app.command()
@guard
def counts(
    species: Species,
    year: Annotated[int | None, typer.Option(help="Count this year only.")] = None,
    json: Json = False,
) -> None:
    """Count branches, shoots, internodes and leaves, year by year."""
    from pcsg.commands.grow import run_counts

    run_counts(species, year, json)


@app.command()
@guard
def plot(species: Species, output: Out = None, t: At = None, quiet: Quiet = False) -> None:
    """Draw the curves of a species, beside its tree where --t says when."""
    from pcsg.commands.grow import run_plot

    run_plot(species, t, output, quiet)


@app.command()
@guard
def view(
    species: Species,
    output: Out = None,
    t: At = None,
    once: Annotated[
        bool, typer.Option("--once", help="Draw once instead of waiting for changes.")
    ] = False,
) -> None:
    """Draw curves and tree again whenever the file is saved."""
    from pcsg.commands.grow import run_view

    run_view(species, t, output, once)


@app.command()
@guard
def frame(
    species: Species,
    t: Annotated[
        float,
        typer.Option("--t", metavar="YEARS", help="Age of the tree; a whole year is midwinter."),
    ],
    output: Out = None,
    size: Size = "600x720",
    samples: Samples = 16,
    mode: Mode = None,
    seed: Seed = None,
    camera: Annotated[str, typer.Option(metavar="KEYS", help="As for `pcsg render`.")] = "",
    denoise: Annotated[bool, typer.Option("--denoise", help="As for `pcsg render`.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a stopped run from its checkpoint.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Make a picture of a tree at a time."""
    from pcsg.commands.grow import Look, run_frame

    look = Look(size, samples, mode, seed, quiet)
    run_frame(species, t, output, look, camera, denoise=denoise, resume=resume)


@app.command()
@guard
def animate(
    film: Annotated[
        str, typer.Argument(metavar="FILM", help="populus, shoot, bbridge, or a species.")
    ],
    output: Out = None,
    first: Annotated[float | None, typer.Option("--from", metavar="YEARS")] = None,
    last: Annotated[float | None, typer.Option("--to", metavar="YEARS")] = None,
    frames_per_year: Annotated[
        float | None, typer.Option(help="Render this many frames per year; 24 for a whole tree.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Play this many frames per second.")] = 24.0,
    orbit: Annotated[
        float,
        typer.Option(metavar="DEGREES", help="Move the camera around the tree by this angle."),
    ] = 0.0,
    size: Size = "400x480",
    samples: Samples = 8,
    mode: Mode = None,
    seed: Seed = None,
    jobs: Annotated[int | None, typer.Option(help="Render this many frames at once.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the frames that exist already.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Make a film: a tree's life, a shoot in one year, a junction in ten."""
    from pcsg.commands.grow import Film, Look, run_animate

    what = Film(first, last, frames_per_year, fps, orbit, jobs, resume)
    run_animate(film, output, what, Look(size, samples, mode, seed, quiet))


@app.command()
@guard
def export(
    species: Species,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT", help="Skeleton (.json .swc).")
    ],
    t: At = None,
    seed: Seed = None,
    quiet: Quiet = False,
) -> None:
    """Write the skeleton at a time; without --t, the species' file, to be changed."""
    from pcsg.commands.grow import run_export

    run_export(species, output, t, seed, quiet)
