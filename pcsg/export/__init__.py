"""Scenes for other programs: USD, glTF, OBJ, PLY, and tables of solids.

A grammar's cycles cannot be written; its states can. Every state is a prototype, written once, and
what stands in many places refers to it: a file is as small as the table of states.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pcsg import arguments
from pcsg.errors import UsageError

if TYPE_CHECKING:
    from pcsg.scene import Scene

ENDINGS = (".usdc", ".usda", ".glb", ".obj", ".ply", ".csv")
"""What files may be called."""

_UP = {".usdc": "z", ".usda": "z", ".glb": "y", ".obj": "y", ".ply": "z", ".csv": "z"}
"""The axis that is up where nobody says: that of each format's own readers."""


class Exported(NamedTuple):
    """What was written.

    Attributes
    ----------
    solids
        How many stand in the scene; rows of a table.
    prototypes, shapes, materials
        What they are made of; 0 for a table.
    notes
        What was left out or changed.
    """

    solids: int
    prototypes: int = 0
    shapes: int = 0
    materials: int = 0
    notes: tuple[str, ...] = ()


def check_export(path: Path, up: str | None, instances: bool) -> None:
    """Raise an error now for what could not be written later.

    Raises
    ------
    UsageError
        The name's ending is unknown, or an option does not belong to the format.
    EnvironmentFault
        The folder takes no files, or a library is missing.
    """
    from pcsg.outputs import check_output

    check_output(path, ENDINGS)
    ending = path.suffix.lower()
    if up not in (None, "y", "z"):
        raise UsageError(f"--up takes y or z, not {arguments.shown(up)}")
    if up not in (None, _UP[ending]) and ending in (".glb", ".csv"):
        raise UsageError(f"--up: in {ending} files {_UP[ending]} is always up")
    if instances and ending != ".glb":
        raise UsageError("--instances is for .glb; .usdc and .usda always have them")
    if ending in (".usdc", ".usda"):
        from pcsg.export.usd import load_usd

        load_usd()


def export(
    scene: Scene,
    path: str | Path,
    *,
    segments: int = 16,
    resolution: int = 64,
    depth: int | None = None,
    instances: bool = False,
    up: str | None = None,
) -> Exported:
    """Write a scene for another program.

    Parameters
    ----------
    path
        Its ending says how: .usdc, .usda, .glb, .obj (and .mtl), .ply, or .csv.
    segments
        Corners of a circle.
    resolution
        Cells along the longest side of what can only be contoured.
    depth
        Modules below the axiom after which boxes stand for what follows; None for all.
    instances
        Whether a .glb has instances (EXT_mesh_gpu_instancing).
    up
        The axis that is up, ``y`` or ``z``; None for the format's custom.

    Raises
    ------
    UsageError
        The scene is too large for that, or an argument is wrong.
    EnvironmentFault
        The system refuses, or a library is missing.
    """
    path = Path(path)
    check_export(path, up, instances)
    arguments.whole(segments, "segments", 3, 1_024)
    arguments.whole(resolution, "resolution", 2, 1_024)
    if depth is not None:
        arguments.whole(depth, "depth", 1, 10_000)
    ending = path.suffix.lower()
    up = up or _UP[ending]
    if ending == ".csv":
        from pcsg.export.tables import write_table

        return Exported(write_table(path, scene))
    from pcsg.export.gltf import write_gltf
    from pcsg.export.polygons import write_obj, write_ply
    from pcsg.export.prototypes import assemble
    from pcsg.export.surroundings import look_around
    from pcsg.export.usd import write_usd

    assembly = assemble(scene, segments=segments, resolution=resolution, depth=depth)
    notes = assembly.notes
    if ending == ".obj":
        write_obj(path, assembly, up)
    elif ending == ".ply":
        write_ply(path, assembly, up)
    else:
        around = look_around(scene)
        notes += around.notes
        if ending == ".glb":
            write_gltf(path, assembly, around, instances)
        else:
            write_usd(path, assembly, around, up)
    return Exported(
        assembly.instances,
        len(assembly.prototypes),
        len(assembly.shapes),
        len(assembly.materials),
        notes,
    )
