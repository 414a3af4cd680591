"""The command line: one thin function per verb.

Nothing heavy is imported before a verb runs, so that ``pcsg --help`` is instant; what a verb does
stands in `pcsg.commands`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pcsg
from pcsg.commands.arguments import (
    Assignments,
    BlockMemory,
    EngineName,
    File,
    Include,
    Json,
    MaxMemory,
    Quiet,
    Seed,
    Time,
)
from pcsg.commands.growing import app as grow
from pcsg.commands.guard import guard, prepare_standard_files
from pcsg.commands.interrupts import heard_interrupts
from pcsg.commands.limbs import app as limbs
from pcsg.commands.parent import follow_if_tied

app = typer.Typer(
    name="pcsg",
    help="Pictures of natural scenes of any complexity, from grammars over solids.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.add_typer(grow)
app.add_typer(limbs)  # without a name: its verbs are verbs


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pcsg {pcsg.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    pass


@app.command()
@guard
def render(
    file: File,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="OUT", help="Write the picture to this .png or .exr."
        ),
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Width x height in pixels.")] = "800x600",
    samples: Annotated[int, typer.Option(help="Set the maximum samples per pixel.")] = 16,
    mode: Annotated[
        str | None,
        typer.Option(
            help="Follow light by preview, direct or path; else as the grammar says.",
            show_default=False,
        ),
    ] = None,
    exposure: Annotated[
        float | None,
        typer.Option(
            help="Brighten by this many stops; each doubles the light.", show_default=False
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(help="Show light by the standard or the filmic curve.", show_default=False),
    ] = None,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    camera: Annotated[
        str,
        typer.Option(metavar="KEYS", help='Place the camera: "eye=1,-5,2 target=0,0,1 fov=30".'),
    ] = "",
    sun: Annotated[
        str, typer.Option(metavar="KEYS", help='Set the sun: "direction=1,0,1 strength=2 angle=3".')
    ] = "",
    sky: Annotated[
        str, typer.Option(metavar="KEYS", help='Set the sky: "zenith=0.1,0.2,0.5 strength=0.8".')
    ] = "",
    ground: Annotated[
        str,
        typer.Option(metavar="KEYS", help='Add a ground plane: "z=auto", "z=0 material=grass".'),
    ] = "",
    fog: Annotated[
        str, typer.Option(metavar="KEYS", help='Add fog: "density=0.02 height=3".')
    ] = "",
    aov: Annotated[
        str,
        typer.Option(metavar="LIST", help="Write layers too: depth,normal,albedo,label,leaf."),
    ] = "",
    bits: Annotated[int, typer.Option(help="Write a .png with 8 or 16 bits per channel.")] = 8,
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Remove noise; needs the extra `denoise`.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a stopped run from its checkpoint.")
    ] = False,
    tile: Annotated[
        str | None,
        typer.Option(
            metavar="I/N", help="Render part I of N of the rows; the run that ends last joins them."
        ),
    ] = None,
    show_every: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Save the unfinished picture at this interval."),
    ] = None,
    detail: Annotated[
        float,
        typer.Option(metavar="PIXELS", help="Stop refining below this size in pixels (0: never)."),
    ] = 0.5,
    threads: Annotated[
        int | None,
        typer.Option(
            help="Set the number of threads; by default one per processor.", show_default=False
        ),
    ] = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    block_memory: BlockMemory = None,
    engine: EngineName = "auto",
    json: Json = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="Report what a ray visits on average.")
    ] = False,
    quiet: Quiet = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Report more, such as where the camera stands.")
    ] = False,
) -> None:
    """Make a picture of a grammar."""
    from pcsg.commands.render import RenderArguments, run

    run(
        RenderArguments(
            file=file,
            output=output,
            size=size,
            samples=samples,
            assignments=assignments,
            seed=seed,
            time=time,
            settings={
                "camera": camera,
                "sun": sun,
                "sky": sky,
                "ground": ground,
                "fog": fog,
                "film": " ".join(
                    f"{key}={value}"
                    for key, value in (("mode", mode), ("exposure", exposure), ("view", view))
                    if value is not None
                ),
            },
            aov=aov,
            bits=bits,
            denoise=denoise,
            tile=tile,
            resume=resume,
            show_every=show_every,
            threads=threads,
            include=include,
            max_memory=max_memory,
            block_memory=block_memory,
            detail=detail,
            engine=engine,
            json=json,
            profile=profile,
            quiet=quiet,
            verbose=verbose,
        )
    )


@app.command()
@guard
def check(
    file: File,
    include: Include = [],  # noqa: B006 - typer copies defaults
    json: Json = False,
) -> None:
    """Report every mistake in a grammar, all at once."""
    from pcsg.commands.check import run

    run(file, include, json)


@app.command()
@guard
def fmt(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Grammars (.pcsg); - is standard input.", show_default=False
        ),
    ],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; list the files that would change.")
    ] = False,
) -> None:
    """Set the blanks and line ends of grammars in order, in place."""
    from pcsg.commands.fmt import run

    run(files, check)


@app.command()
@guard
def lsp() -> None:
    """Serve editors over standard input and output (Language Server Protocol)."""
    from pcsg.commands.lsp import run

    run()


@app.command()
@guard
def scan(
    file: File,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            help="Write the cloud (.laz, .las, .csv, .xyz, .ply, .npz).",
        ),
    ],
    scanner: Annotated[
        str, typer.Option(metavar="NAME", help="Scan with a vz400, vz400-fast or vlp16.")
    ] = "vz400",
    at: Annotated[
        list[str],
        typer.Option(
            "--at", metavar="X,Y,Z", help="Stand here; X,Y,Z..X,Y,Z is a path. May be repeated."
        ),
    ] = [],  # noqa: B006 - typer copies defaults
    figure: Annotated[
        list[str],
        typer.Option(metavar="NAME=VALUE", help="Change a figure of the scanner: step=0.05."),
    ] = [],  # noqa: B006 - typer copies defaults
    returns: Annotated[
        str, typer.Option(metavar="WHICH", help="Keep multi, first, last or strongest echoes.")
    ] = "multi",
    rays_per_beam: Annotated[int, typer.Option(help="Make beams of 1, 7, 19 or 37 rays.")] = 19,
    misses: Annotated[
        bool, typer.Option("--misses/--no-misses", help="Keep the beams without an echo, too.")
    ] = True,
    periodic: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,X,Y", help="Repeat this cell over the plane.", show_default=False
        ),
    ] = None,
    classes: Annotated[
        list[str],
        typer.Option("--class", metavar="LABEL=CODE", help="Give a label a LAS class."),
    ] = [],  # noqa: B006 - typer copies defaults
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a stopped scan from its parts.")
    ] = False,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    block_memory: BlockMemory = None,
    quiet: Quiet = False,
) -> None:
    """Scan a grammar with a laser, and write the cloud of its echoes."""
    from pcsg.commands.scan import run

    run(
        file,
        output,
        scanner,
        at,
        figure,
        returns,
        rays_per_beam,
        misses,
        periodic,
        classes,
        resume,
        assignments,
        seed,
        time,
        include,
        max_memory,
        block_memory,
        quiet,
    )


@app.command()
@guard
def export(
    file: File,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            help="Write the scene (.usdc, .usda, .glb, .obj, .ply), or a table (.csv).",
        ),
    ],
    segments: Annotated[int, typer.Option(help="Give circles so many corners.")] = 16,
    resolution: Annotated[
        int, typer.Option(help="Contour what is no polygon with so many cells.")
    ] = 64,
    depth: Annotated[
        int | None,
        typer.Option(metavar="K", help="Put boxes in place of what is deeper.", show_default=False),
    ] = None,
    instances: Annotated[
        bool, typer.Option("--instances", help="Write a .glb with instances.")
    ] = False,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS", help="Let y or z be up; by the format's custom.", show_default=False
        ),
    ] = None,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a grammar's scene for other programs: USD, glTF, OBJ, PLY, tables."""
    from pcsg.commands.export import run

    run(
        file,
        output,
        segments,
        resolution,
        depth,
        instances,
        up,
        assignments,
        seed,
        time,
        include,
        max_memory,
        quiet,
        json,
    )


@app.command()
@guard
def stats(
    file: File,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    block_memory: BlockMemory = None,
    engine: EngineName = "auto",
    json: Json = False,
) -> None:
    """Count a grammar's nodes, states, primitives and bytes."""
    from pcsg.commands.stats import run

    run(file, assignments, seed, time, include, max_memory, block_memory, engine, json)


@app.command()
@guard
def graph(
    file: File,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="OUT", help="Write the drawing (.svg, .dot, .png)."),
    ],
    include: Include = [],  # noqa: B006 - typer copies defaults
) -> None:
    """Draw the cyclic graph of a grammar."""
    from pcsg.commands.graph import run

    run(file, output, include)


@app.command()
@guard
def animate(
    file: File,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="OUT", help="Write .webp, .gif, .png, .mp4, or frame_##.png."
        ),
    ] = None,
    frames: Annotated[
        str, typer.Option(metavar="A..B", help="Render these frames, the first and the last.")
    ] = "0..23",
    fps: Annotated[float, typer.Option(help="Play this many frames per second.")] = 12.0,
    assignments: Annotated[
        list[str],
        typer.Option(
            "-D",
            "--set",
            metavar="NAME=A..B",
            help="Let a parameter go from A to B over the frames.",
        ),
    ] = [],  # noqa: B006 - typer copies defaults
    time: Annotated[
        str | None,
        typer.Option(metavar="A..B", help="Let TIME go from A to B; by default it counts seconds."),
    ] = None,
    orbit: Annotated[
        float,
        typer.Option(metavar="DEGREES", help="Move the camera around the scene by this angle."),
    ] = 0.0,
    size: Annotated[str, typer.Option(metavar="WxH", help="Width x height in pixels.")] = "480x360",
    samples: Annotated[int, typer.Option(help="Set the maximum samples per pixel.")] = 16,
    mode: Annotated[
        str | None,
        typer.Option(
            help="Follow light by preview, direct or path; else as the grammar says.",
            show_default=False,
        ),
    ] = None,
    seed: Seed = None,
    camera: Annotated[str, typer.Option(metavar="KEYS", help="As for `pcsg render`.")] = "",
    sun: Annotated[str, typer.Option(metavar="KEYS", help="As for `pcsg render`.")] = "",
    jobs: Annotated[
        int | None, typer.Option(help="Render this many frames at once.", show_default=False)
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the frames that exist already.")
    ] = False,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    engine: EngineName = "auto",
    quiet: Quiet = False,
) -> None:
    """Make a moving picture of a grammar."""
    from pcsg.commands.animate import AnimateArguments, run

    run(
        AnimateArguments(
            file=file,
            output=output,
            frames=frames,
            fps=fps,
            time=time,
            orbit=orbit,
            size=size,
            samples=samples,
            assignments=assignments,
            seed=seed,
            settings={"camera": camera, "sun": sun, "film": f"mode={mode}" if mode else ""},
            jobs=jobs,
            include=include,
            max_memory=max_memory,
            engine=engine,
            resume=resume,
            quiet=quiet,
        )
    )


@app.command()
@guard
def view(
    file: Annotated[
        str,
        typer.Argument(metavar="FILE", help="A grammar, or a name: of a species, of the gallery."),
    ],
    port: Annotated[
        int, typer.Option(help="Listen at this port; by default at any that is free.")
    ] = 0,
    host: Annotated[str, typer.Option(help="Listen at this address.")] = "127.0.0.1",
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Let others on the network reach it unencrypted.")
    ] = False,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Encrypt with this certificate (PEM).")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The certificate's key, if it is elsewhere.")
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address only.")
    ] = False,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    threads: Annotated[
        int | None,
        typer.Option(
            help="Set the number of threads; by default one per processor.", show_default=False
        ),
    ] = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    block_memory: BlockMemory = None,
    engine: EngineName = "auto",
) -> None:
    """Show a grammar in the browser, live: turn it, change it, ask it."""
    from pcsg.commands.view import ViewArguments, run

    run(
        ViewArguments(
            file=file,
            port=port,
            host=host,
            insecure=insecure,
            certificate=certificate,
            key=key,
            browser=not no_browser,
            assignments=assignments,
            seed=seed,
            time=time,
            threads=threads,
            include=include,
            max_memory=max_memory,
            block_memory=block_memory,
            engine=engine,
        )
    )


@app.command()
@guard
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new grammar.")],
) -> None:
    """Write a commented grammar to begin with."""
    from pcsg.commands.gallery import start

    start(name)


@app.command()
@guard
def gallery(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Names of pictures; by default all."),
    ] = None,
    render: Annotated[bool, typer.Option("--render", help="Render the pictures.")] = False,
    copy: Annotated[
        bool, typer.Option("--copy", help="Copy the named grammars, to change them.")
    ] = False,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Write to this folder.")
    ] = Path(),
    size: Annotated[str, typer.Option(metavar="WxH", help="Width x height in pixels.")] = "640x480",
    samples: Annotated[
        int | None,
        typer.Option(help="Set the maximum samples per pixel; by default what each picture needs."),
    ] = None,
) -> None:
    """List the grammars that come with pcsg, copy them, or make their pictures."""
    from pcsg.commands.gallery import run

    run(names or [], render, copy, output, size, samples)


@app.command()
@guard
def warmup(json: Json = False) -> None:
    """Compile all kernels now, so that the first picture need not wait."""
    from pcsg.commands.warmup import run

    run(json)


def main() -> None:
    """Run the command line."""
    prepare_standard_files()
    follow_if_tied()
    with heard_interrupts():
        app()
