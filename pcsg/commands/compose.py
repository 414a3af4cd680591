"""``pcsg compose``: new trees of the subtrees of others."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pcsg.commands.guard import say, show
from pcsg.commands.mesh import Input, memory_limit, open_skeleton
from pcsg.commands.progress import show_share
from pcsg.errors import UsageError

MOST_TREES = 100_000
"""Trees of one command."""


@dataclass(frozen=True)
class ComposeArguments:
    """The options of ``pcsg compose``.

    Attributes
    ----------
    file
        The template.
    sources
        Trees whose subtrees are used too.
    output
        Name of the results; a number goes before its ending.
    max_memory
        Of a surface.
    """

    file: Path
    sources: Sequence[Path]
    output: Path | None
    count: int
    seed: int
    depth: int
    p_replace: float
    max_memory: str | None
    quiet: bool
    json: bool


def run(arguments: ComposeArguments) -> None:
    """Compose trees and write them, as skeletons or as meshes."""
    from pcsg.outputs import check_output
    from pcsg.skeletonfile import SKELETON_ENDINGS
    from pcsg.treemesh import save_skeleton, tree_surface
    from pcsg.treemesh.composition import CompositionOptions, compose
    from pcsg.treemesh.estimate import check_memory
    from pcsg.treemesh.files import WRITERS
    from pcsg.treemesh.library import Library

    if not 1 <= arguments.count <= MOST_TREES:
        raise UsageError(
            f"-n takes a number of trees from 1 to {MOST_TREES:,}, not {arguments.count}"
        )
    target = arguments.output or Path(f"{arguments.file.stem}-composed.json")
    files = [_numbered(target, k, arguments.count) for k in range(arguments.count)]
    check_output(target, (*SKELETON_ENDINGS, *WRITERS))
    template, _ = open_skeleton(Input(arguments.file, resample=False))
    library = Library()
    library.add(template, arguments.file.stem)
    for source in arguments.sources:
        library.add(open_skeleton(Input(source, resample=False))[0], source.stem)
    options = CompositionOptions(depth=arguments.depth, p_replace=arguments.p_replace)
    for k, file in enumerate(files):
        with show_share(file.name, arguments.quiet or arguments.json) as report:
            skel = compose(template, library, arguments.seed + k, options, report)
        if file.suffix.lower() in SKELETON_ENDINGS:
            save_skeleton(skel, file)
        else:
            check_memory(skel, None, memory_limit(arguments.max_memory))
            tree_surface(skel).save(file)
        if arguments.json:
            summary = {"file": str(file), "seed": arguments.seed + k, "segments": skel.n_edges}
            show(json.dumps(summary))
        elif not arguments.quiet:
            say(f"{file}: {skel.n_edges} segments, {len(skel.tips)} tips")


def _numbered(path: Path, k: int, count: int) -> Path:
    """Return the name of the k-th of several files."""
    return path if count == 1 else path.with_name(f"{path.stem}-{k + 1}{path.suffix}")
