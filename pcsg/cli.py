"""The command line: one thin function per verb.

Nothing heavy is imported before a verb runs, so that ``pcsg --help`` is instant; what a verb does
stands in `pcsg.commands`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pcsg
from pcsg.commands.growing import app as grow
from pcsg.commands.guard import guard

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

File = Annotated[
    Path, typer.Argument(metavar="FILE", help="A grammar (.pcsg).", show_default=False)
]
Include = Annotated[
    list[Path],
    typer.Option("--include", metavar="DIR", help="Further folder that #include may read."),
]
Assignments = Annotated[
    list[str],
    typer.Option("-D", "--set", metavar="NAME=VALUE", help="Value of a parameter of the axiom."),
]
Seed = Annotated[int | None, typer.Option("--seed", help="Of sampling, and the grammar's SEED.")]
Time = Annotated[float | None, typer.Option("--time", help="The grammar's TIME.")]
MaxMemory = Annotated[
    str | None,
    typer.Option("--max-memory", metavar="SIZE", help="Such as 4G; default half of the machine."),
]
BlockMemory = Annotated[
    str | None,
    typer.Option("--block-memory", metavar="SIZE", help="For states made beforehand; 16M."),
]
EngineName = Annotated[
    str, typer.Option("--engine", metavar="NAME", help="auto, cyclic or states.")
]
Json = Annotated[bool, typer.Option("--json", help="Say it in JSON on standard output.")]


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pcsg {pcsg.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="And exit.")
    ] = False,
) -> None:
    pass


@app.command()
@guard
def render(
    file: File,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT", help="Picture (.png, .exr).")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="In pixels.")] = "800x600",
    samples: Annotated[int, typer.Option(help="Most samples per pixel.")] = 16,
    mode: Annotated[
        str | None,
        typer.Option(help="preview, direct or path; default the grammar's.", show_default=False),
    ] = None,
    exposure: Annotated[
        float | None, typer.Option(help="In stops; 1 is twice as bright.", show_default=False)
    ] = None,
    view: Annotated[
        str | None, typer.Option(help="standard or filmic.", show_default=False)
    ] = None,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    camera: Annotated[
        str, typer.Option(metavar="KEYS", help='Such as "eye=1,-5,2 target=0,0,1 fov=30".')
    ] = "",
    sun: Annotated[
        str, typer.Option(metavar="KEYS", help='Such as "direction=1,0,1 strength=2 angle=3".')
    ] = "",
    sky: Annotated[
        str, typer.Option(metavar="KEYS", help='Such as "zenith=0.1,0.2,0.5 strength=0.8".')
    ] = "",
    ground: Annotated[
        str, typer.Option(metavar="KEYS", help='A plane below: "z=auto", "z=0 material=grass".')
    ] = "",
    aov: Annotated[
        str,
        typer.Option(metavar="LIST", help="Layers to write: depth,normal,albedo,label,leaf."),
    ] = "",
    bits: Annotated[int, typer.Option(help="Of each colour of a .png: 8 or 16.")] = 8,
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Take noise out; needs the extra denoise.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the checkpoint of a stopped run.")
    ] = False,
    tile: Annotated[
        str | None,
        typer.Option(metavar="I/N", help="Part I of N of the rows; the last one joins them."),
    ] = None,
    show_every: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Write the picture so far now and then.")
    ] = None,
    detail: Annotated[
        float, typer.Option(metavar="PIXELS", help="Size of what is not looked into; 0 for none.")
    ] = 0.5,
    threads: Annotated[
        int | None, typer.Option(help="Default: one per processor.", show_default=False)
    ] = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    block_memory: BlockMemory = None,
    engine: EngineName = "auto",
    json: Json = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="Say what a ray visits on average.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Say more.")] = False,
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
        Path, typer.Option("-o", "--output", metavar="OUT", help="Drawing (.svg, .dot, .png).")
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
        typer.Option("-o", "--output", metavar="OUT", help=".webp, .gif, .png, .mp4, frame_##.png"),
    ] = None,
    frames: Annotated[str, typer.Option(metavar="A..B", help="First and last.")] = "0..23",
    fps: Annotated[float, typer.Option(help="Frames in a second.")] = 12.0,
    assignments: Annotated[
        list[str],
        typer.Option("-D", "--set", metavar="NAME=A..B", help="From A to B over the frames."),
    ] = [],  # noqa: B006 - typer copies defaults
    time: Annotated[
        str | None, typer.Option(metavar="A..B", help="The grammar's TIME; default: seconds.")
    ] = None,
    orbit: Annotated[
        float, typer.Option(metavar="DEGREES", help="How far the camera goes round.")
    ] = 0.0,
    size: Annotated[str, typer.Option(metavar="WxH", help="In pixels.")] = "480x360",
    samples: Annotated[int, typer.Option(help="Most samples per pixel.")] = 16,
    mode: Annotated[
        str | None,
        typer.Option(help="preview, direct or path; default the grammar's.", show_default=False),
    ] = None,
    seed: Seed = None,
    camera: Annotated[str, typer.Option(metavar="KEYS", help="As for render.")] = "",
    sun: Annotated[str, typer.Option(metavar="KEYS", help="As for render.")] = "",
    jobs: Annotated[
        int | None, typer.Option(help="Frames made at a time.", show_default=False)
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep frames that are there already.")
    ] = False,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    engine: EngineName = "auto",
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")] = False,
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
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the grammar.")],
) -> None:
    """Write a commented grammar to begin with."""
    from pcsg.commands.gallery import start

    start(name)


@app.command()
@guard
def gallery(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Which; default all.")
    ] = None,
    render: Annotated[bool, typer.Option("--render", help="Make the pictures.")] = False,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where to.")
    ] = Path(),
    size: Annotated[str, typer.Option(metavar="WxH", help="In pixels.")] = "640x480",
    samples: Annotated[
        int | None,
        typer.Option(help="Most samples per pixel; default what each picture needs."),
    ] = None,
) -> None:
    """List the grammars that come with pcsg, or make their pictures."""
    from pcsg.commands.gallery import run

    run(names or [], render, output, size, samples)


@app.command()
@guard
def warmup(json: Json = False) -> None:
    """Compile all kernels now, so that the first picture need not wait."""
    from pcsg.commands.warmup import run

    run(json)


Tree = Annotated[
    Path,
    typer.Argument(
        metavar="IN",
        help="A mesh (.obj .ply .stl .glb), a skeleton (.json .swc), a grammar (.pcsg), or a "
        "growing tree (.json, populus).",
        show_default=False,
    ),
]
LargestOnly = Annotated[
    bool, typer.Option("--largest-only", help="Take the largest part of a mesh, join none.")
]
Reach = Annotated[
    float | None,
    typer.Option(metavar="LENGTH", help="Widest gap between parts that is bridged."),
]
Resample = Annotated[
    bool, typer.Option("--resample/--no-resample", help="Remove nodes where limbs are straight.")
]
Angle = Annotated[
    float, typer.Option("--eps", metavar="DEGREES", help="Turning angle that counts as straight.")
]
Spacing = Annotated[
    float, typer.Option("--spacing", metavar="RADII", help="Nodes closer than this may go.")
]
MinRadius = Annotated[float, typer.Option(help="Leave out thinner twigs and what they bear.")]
MaxOrder = Annotated[
    int | None, typer.Option(help="Leave out branches of higher order; the trunk has 0.")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")]


@app.command()
@guard
def mesh(
    file: Tree,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="OUT", help="Mesh (.obj .ply .glb .usda .usd)."),
    ] = None,
    method: Annotated[
        str, typer.Option(help="quads about a tree's limbs, or contour: triangles of any solid.")
    ] = "quads",
    resolution: Annotated[
        int, typer.Option(metavar="CELLS", help="Of a contour, along the longest side.")
    ] = 64,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Measures of the mesh (.json).")
    ] = None,
    levels: Annotated[int, typer.Option(help="Steps of subdivision: 4 times the quads each.")] = 2,
    kernel: Annotated[str, typer.Option(help="cauchy or quartic.")] = "cauchy",
    max_aspect: Annotated[
        float, typer.Option(help="Longest distance of squares in radii; 0 for the fewest quads.")
    ] = 4.0,
    locality: Annotated[str, typer.Option(help="graph, or all: near branches blend.")] = "graph",
    offsets: Annotated[
        bool, typer.Option("--offsets", help="Bring the surface back to the mesh it came from.")
    ] = False,
    foot: Annotated[
        bool, typer.Option("--foot", help="Let the trunk begin one radius below its root.")
    ] = False,
    largest_only: LargestOnly = False,
    reach: Reach = None,
    resample: Resample = True,
    eps: Angle = 8.0,
    spacing: Spacing = 1.5,
    min_radius: MinRadius = 0.0,
    max_order: MaxOrder = None,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make one closed mesh of quads of a tree."""
    from pcsg.commands.mesh import Input, Output, run_mesh

    run_mesh(
        Input(
            file=file,
            assignments=assignments,
            seed=seed,
            time=time,
            include=include,
            max_memory=max_memory,
            largest_only=largest_only,
            reach=reach,
            resample=resample,
            eps_deg=eps,
            spacing=spacing,
            min_radius=min_radius,
            max_order=max_order,
        ),
        Output(
            file=output,
            report=report,
            levels=levels,
            kernel=kernel,
            max_aspect=max_aspect,
            locality=locality,
            offsets=offsets,
            foot=foot,
            quiet=quiet,
            json=json,
            method=method,
            resolution=resolution,
        ),
    )


@app.command()
@guard
def skeleton(
    file: Tree,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT", help="Skeleton (.json .swc).")
    ] = None,
    largest_only: LargestOnly = False,
    reach: Reach = None,
    resample: Resample = True,
    eps: Angle = 8.0,
    spacing: Spacing = 1.5,
    min_radius: MinRadius = 0.0,
    max_order: MaxOrder = None,
    assignments: Assignments = [],  # noqa: B006 - typer copies defaults
    seed: Seed = None,
    time: Time = None,
    include: Include = [],  # noqa: B006 - typer copies defaults
    max_memory: MaxMemory = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the line skeleton of a tree."""
    from pcsg.commands.mesh import Input, run_skeleton

    given = Input(
        file=file,
        assignments=assignments,
        seed=seed,
        time=time,
        include=include,
        max_memory=max_memory,
        largest_only=largest_only,
        reach=reach,
        resample=resample,
        eps_deg=eps,
        spacing=spacing,
        min_radius=min_radius,
        max_order=max_order,
    )
    run_skeleton(given, output, quiet, json)


@app.command()
@guard
def compose(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="TEMPLATE",
            help="A tree: a skeleton, a mesh or a grammar.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="OUT", help="Skeletons (.json .swc) or meshes, numbered."
        ),
    ] = None,
    sources: Annotated[
        list[Path], typer.Option("--with", metavar="FILE", help="A tree that gives subtrees too.")
    ] = [],  # noqa: B006 - typer copies defaults
    count: Annotated[int, typer.Option("-n", help="How many trees.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the first tree; the others count on.")] = 0,
    depth: Annotated[int, typer.Option(help="Replacements within replacements.")] = 2,
    replace: Annotated[float, typer.Option(help="Probability that a branch is replaced.")] = 0.7,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compose new trees of the branches of others."""
    from pcsg.commands.compose import ComposeArguments, run

    run(
        ComposeArguments(
            file=file,
            sources=sources,
            output=output,
            count=count,
            seed=seed,
            depth=depth,
            p_replace=replace,
            quiet=quiet,
            json=json,
        )
    )


def main() -> None:
    """Run the command line."""
    app()
