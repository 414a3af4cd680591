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
