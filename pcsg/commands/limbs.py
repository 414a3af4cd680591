"""The verbs about limbs of trees: ``pcsg mesh``, ``skeleton``, ``compose``; thin, as `pcsg.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pcsg.commands.arguments import Assignments, Include, Json, MaxMemory, Quiet, Seed, Time
from pcsg.commands.guard import guard

app = typer.Typer(rich_markup_mode=None)

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
    bool, typer.Option("--largest-only", help="Use only the largest part of a mesh.")
]
Reach = Annotated[
    float | None,
    typer.Option(metavar="LENGTH", help="Bridge gaps between parts up to this length."),
]
Resample = Annotated[
    bool,
    typer.Option(
        "--resample/--no-resample", help="Remove nodes where limbs are straight, or keep all."
    ),
]
Angle = Annotated[
    float,
    typer.Option("--eps", metavar="DEGREES", help="Treat bends below this angle as straight."),
]
Spacing = Annotated[
    float,
    typer.Option(
        "--spacing", metavar="RADII", help="Allow removing nodes closer than this, in radii."
    ),
]
MinRadius = Annotated[float, typer.Option(help="Leave out thinner twigs and what they bear.")]
MaxOrder = Annotated[
    int | None, typer.Option(help="Leave out branches of higher order; the trunk has 0.")
]


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
        int,
        typer.Option(
            metavar="CELLS",
            help="Divide the longest side into this many cells, for --method contour.",
        ),
    ] = 64,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write measures of the mesh to this .json.")
    ] = None,
    levels: Annotated[
        int, typer.Option(help="Subdivide this many times; each step makes 4 times the quads.")
    ] = 2,
    kernel: Annotated[
        str, typer.Option(help="Shape of the field about limbs: cauchy or quartic.")
    ] = "cauchy",
    max_aspect: Annotated[
        float,
        typer.Option(
            help="Limit the length of quads to this many radii (0: as few quads as possible)."
        ),
    ] = 4.0,
    locality: Annotated[str, typer.Option(help="graph, or all: near branches blend.")] = "graph",
    offsets: Annotated[
        bool,
        typer.Option("--offsets", help="Move the surface back onto the mesh that it came from."),
    ] = False,
    foot: Annotated[
        bool, typer.Option("--foot", help="Extend the trunk one radius below its root.")
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
    seed: Annotated[
        int, typer.Option(help="Random seed of the first tree; the next ones count up.")
    ] = 0,
    depth: Annotated[int, typer.Option(help="Replace within replacements up to this depth.")] = 2,
    replace: Annotated[float, typer.Option(help="Probability that a branch is replaced.")] = 0.7,
    max_memory: MaxMemory = None,
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
            max_memory=max_memory,
            quiet=quiet,
            json=json,
        )
    )
