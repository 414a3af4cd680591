"""``pcsg mesh`` and ``pcsg skeleton``: quad meshes of trees, and what they are built on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcsg.commands.compiling import announce_compiling, tell_unkept
from pcsg.commands.files import check_there
from pcsg.commands.guard import say, show
from pcsg.commands.options import parse_assignments, parse_memory
from pcsg.commands.scenes import open_scene
from pcsg.errors import UsageError

if TYPE_CHECKING:
    from pcsg.scene import Scene
    from pcsg.treemesh.skeleton import Skeleton
    from pcsg.treemesh.surface import QuadMesh

MESHES = (".obj", ".ply", ".stl", ".glb")
GRAMMARS = (".pcsg",)
SCENES = (".pcsg", ".lsys")


@dataclass(frozen=True)
class Input:
    """Where a skeleton comes from, and how it is prepared.

    Attributes
    ----------
    file
        A mesh, a skeleton or a grammar; its ending says which.
    assignments, seed, time, include
        For grammars.
    max_memory
        Of the surface, and of a grammar's rays.
    largest_only, reach
        For meshes of several parts.
    resample
        Whether nodes are removed where limbs are straight, with the angle and the distance.
    min_radius, max_order
        What is thinned out.
    """

    file: Path
    assignments: Sequence[str] = ()
    seed: int | None = None
    time: float | None = None
    include: Sequence[Path] = ()
    max_memory: str | None = None
    largest_only: bool = False
    reach: float | None = None
    resample: bool = True
    eps_deg: float = 8.0
    spacing: float = 1.5
    min_radius: float = 0.0
    max_order: int | None = None

    @property
    def is_mesh(self) -> bool:
        """Whether the file is a mesh."""
        return self.file.suffix.lower() in MESHES


@dataclass(frozen=True)
class Output:
    """How a surface is made and what is written.

    Attributes
    ----------
    file
        The mesh; None for the input's name with ``.obj``.
    report
        A JSON file of measures.
    levels, kernel, max_aspect, locality
        See `pcsg.treemesh.SurfaceOptions`; a `max_aspect` of 0 is none.
    offsets
        Bring the surface back to the original mesh.
    foot
        Let the trunk begin one radius lower.
    method
        ``quads``, or ``contour`` for triangles of any solid, of so many cells.
    """

    file: Path | None
    report: Path | None
    levels: int
    kernel: str
    max_aspect: float
    locality: str
    offsets: bool
    foot: bool
    quiet: bool
    json: bool
    method: str = "quads"
    resolution: int = 64


def run_mesh(given: Input, wanted: Output) -> None:
    """Build a surface and write it."""
    from pcsg.outputs import check_output, write_whole
    from pcsg.treemesh import SurfaceOptions, restore_offsets, tree_surface
    from pcsg.treemesh.estimate import check_memory
    from pcsg.treemesh.files import WRITERS, report_text
    from pcsg.treemesh.projection import project_range
    from pcsg.treemesh.pruning import extend_foot

    file = wanted.file or Path(given.file.stem + ".obj")
    if wanted.method == "contour":
        _write_contour(given, wanted, file)
        return
    if wanted.method != "quads":
        raise UsageError(f"--method takes quads or contour, not `{wanted.method}`")
    check_output(file, tuple(WRITERS))
    if wanted.report is not None:
        check_output(wanted.report, (".json",))
    if wanted.offsets and not given.is_mesh:
        raise UsageError("--offsets needs a mesh as input")
    options = SurfaceOptions(
        levels=wanted.levels,
        kernel=wanted.kernel,  # type: ignore[arg-type]  # build_field checks it
        max_aspect=wanted.max_aspect or None,
        locality=wanted.locality,  # type: ignore[arg-type]  # likewise
    )
    if not wanted.quiet:
        announce_compiling(project_range, "some ten seconds")
    skel, notes = open_skeleton(given)
    check_memory(skel, options, memory_limit(given.max_memory))
    surf = tree_surface(extend_foot(skel) if wanted.foot else skel, options)
    if wanted.offsets:
        surf = restore_offsets(surf, given.file)
    notes = [*notes, *surf.notes]
    if file.suffix.lower() == ".glb":
        notes.append("GLB knows no quads: every quad was written as two triangles")
    surf.save(file)
    files = [file]
    if wanted.report is not None:
        text = report_text(surf.report(given.file if given.is_mesh else None))
        write_whole(wanted.report, lambda out: out.write(text.encode()))
        files.append(wanted.report)
    _tell(surf, files, notes, wanted)
    if not wanted.quiet:
        tell_unkept()


def memory_limit(text: str | None) -> int:
    """Return the bytes that ``--max-memory`` allows, by default half of the machine's."""
    from pcsg.memory import half_of_memory

    limit = parse_memory(text)
    return half_of_memory() if limit is None else limit


def _write_contour(given: Input, wanted: Output, file: Path) -> None:
    """Write the surface of a scene as triangles."""
    from pcsg.contouring import contour, write_triangles
    from pcsg.outputs import check_output, write_whole

    check_output(file, (".obj",))
    check_there(given.file)
    if given.file.suffix.lower() not in SCENES:
        raise UsageError(f"--method contour takes a scene ({', '.join(SCENES)})")
    vertices, faces = contour(_open(given), wanted.resolution)
    write_whole(file, lambda out: out.write(write_triangles(vertices, faces)))
    if wanted.json:
        counts = {"files": [str(file)], "vertices": len(vertices), "triangles": len(faces)}
        show(json.dumps(counts))
    elif not wanted.quiet:
        say(f"{file}: {len(vertices):,} vertices, {len(faces):,} triangles")


def run_skeleton(given: Input, file: Path | None, quiet: bool, as_json: bool) -> None:
    """Find a skeleton and write it."""
    from pcsg.outputs import check_output
    from pcsg.skeletonfile import SKELETON_ENDINGS
    from pcsg.treemesh.files import save_skeleton

    file = file or Path(given.file.stem + ".json")
    check_output(file, SKELETON_ENDINGS)
    if file.resolve() == given.file.resolve():
        raise UsageError(f"{file} is the input; name another file with -o")
    skel, notes = open_skeleton(given)
    save_skeleton(skel, file)
    summary = {
        "file": str(file),
        "nodes": skel.n_nodes,
        "segments": skel.n_edges,
        "joints": len(skel.joints),
        "tips": len(skel.tips),
        "notes": notes,
    }
    if as_json:
        show(json.dumps(summary))
    elif not quiet:
        say(f"{file}: {skel.n_edges} segments, {len(skel.joints)} joints, {len(skel.tips)} tips")
        _list(notes)


def open_skeleton(given: Input) -> tuple[Skeleton, list[str]]:
    """Return the skeleton of whatever the input is, prepared, and notes for the user.

    Raises
    ------
    UsageError
        The file's ending is unknown, or the file cannot be used.
    """
    from pcsg.treemesh import resample
    from pcsg.treemesh.pruning import thin_out

    skel, notes = _read(given)
    if given.min_radius > 0.0 or given.max_order is not None:
        skel, gone = thin_out(skel, given.min_radius, given.max_order)
        notes.append(f"{gone} segments were thinned out")
    if given.resample:
        skel = resample(skel, given.eps_deg, given.spacing)
    return skel, notes


def _read(given: Input) -> tuple[Skeleton, list[str]]:
    from pcsg.skeletonfile import SKELETON_ENDINGS
    from pcsg.treemesh.files import load_skeleton
    from pcsg.treemesh.meshes import extract

    ending = given.file.suffix.lower()
    if _is_species(given.file):
        return _grown(given), []
    endings = (*MESHES, *SKELETON_ENDINGS, *GRAMMARS)
    if ending in ("", *GRAMMARS):
        check_there(given.file, endings)
    if ending in SKELETON_ENDINGS:
        return load_skeleton(given.file), []
    if given.is_mesh:
        found = extract(given.file, largest_only=given.largest_only, reach=given.reach)
        return found.skeleton, list(found.notes)
    if ending in GRAMMARS:
        limbs = _open(given).limbs()
        return limbs.skeleton, list(limbs.notes)
    raise UsageError(f"{given.file}: the name must end in one of {', '.join(endings)}")


def _is_species(file: Path) -> bool:
    """Return whether a file is a growing tree's, or its name that of a shipped one."""
    from pcsg.growth.leaf import is_species
    from pcsg.growth.species import shipped
    from pcsg.inputs import read_bytes

    if str(file) in shipped():
        return True
    if file.suffix.lower() != ".json" or not file.is_file():
        return False
    return is_species(read_bytes(file, "skeleton").decode("utf-8", errors="replace"))


def _grown(given: Input) -> Skeleton:
    """Return the axes of a growing tree at the time ``-D t=``, by default the last autumn."""
    from pcsg.growth.model import GrowthModel

    values = parse_assignments(given.assignments)
    unknown = values.keys() - {"t", "seed"}
    if unknown:
        raise UsageError(f"a growing tree has the parameters t and seed, not {min(unknown)}")
    seed = values.get("seed", given.seed)
    model = GrowthModel.load(given.file, None if seed is None else int(seed))
    return model.at(values.get("t", model.species.ymax - 0.25)).skeleton()


def _tell(surf: QuadMesh, files: Sequence[Path], notes: Sequence[str], wanted: Output) -> None:
    if wanted.json:
        summary: dict[str, Any] = {
            "files": [str(f) for f in files],
            "quads": len(surf.quads),
            "vertices": len(surf.verts),
            "segments": surf.skeleton.n_edges,
            "seconds": {k: round(t, 4) for k, t in (surf.times or {}).items()},
            "notes": list(notes),
        }
        show(json.dumps(summary))
    elif not wanted.quiet:
        say(
            f"{files[0]}: {len(surf.quads):,} quads about {surf.skeleton.n_edges} segments,"
            f" closed, in {sum((surf.times or {}).values()):.2f} s"
        )
        _list(notes)


def _list(notes: Sequence[str]) -> None:
    for note in notes:
        say(f"  {note}")


def _open(given: Input) -> Scene:
    """Return the scene of a grammar."""
    return open_scene(
        given.file,
        given.assignments,
        given.seed,
        given.time,
        given.include,
        given.max_memory,
    )
