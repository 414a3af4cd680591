"""The pictures of docs/treemesh.md: ``python docs/pictures/treemesh.py [NAME...]``.

Meshes are written as files and rendered as leaves of a grammar, with their edges as thin prisms.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import pcsg
from pcsg.treemesh import (
    Skeleton,
    extract_skeleton,
    resample,
    restore_offsets,
    tree_surface,
)
from pcsg.treemesh.composition import compose
from pcsg.treemesh.editing import Editor
from pcsg.treemesh.library import Library
from pcsg.treemesh.offsets import local_radii
from pcsg.treemesh.pruning import extend_foot

HERE = Path(__file__).parent
GRAMMARS = HERE.parents[1] / "grammars"
SPECIES = HERE.parents[1] / "benchmarks" / "grammars"

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BARK = "0.52, 0.38, 0.25"
LINE = "0.05, 0.09, 0.16"


class Stage:
    """Meshes, one after the other, and the picture of all of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.items: list[str] = []

    def add(
        self,
        verts: Floats,
        faces: Ints,
        *,
        normals: Floats | None = None,
        color: str = BARK,
        colors: Floats | None = None,
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Add a mesh of faces with as many corners each."""
        name = f"mesh{len(self.items)}.ply"
        write_ply(self.folder / name, verts + np.array(at), faces, normals, colors)
        paint = "" if colors is not None else f"color({color}) "
        self.items.append(f'{paint}mesh("{name}")')

    def add_edges(
        self,
        verts: Floats,
        edges: Ints,
        width: float | Floats,
        *,
        color: str = LINE,
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Add thin prisms along edges."""
        self.add(*prisms(verts, edges, width), color=color, at=at)

    def render(self, name: str, size: tuple[int, int], camera: str, more: str = "") -> None:
        """Write the picture."""
        text = " | ".join(self.items) + f"\ncamera {{ {camera} }}\n{more}\n"
        path = self.folder / "scene.pcsg"
        path.write_text(text)
        image = pcsg.render(pcsg.load(path), size=size, samples=32)
        whole = self.folder / "whole.png"
        image.save(whole)
        # A palette keeps the file small.
        few = Image.open(whole).convert("RGB").quantize(256, dither=Image.Dither.FLOYDSTEINBERG)
        few.save(HERE / f"{name}.png", optimize=True)


def write_ply(
    path: Path, verts: Floats, faces: Ints, normals: Floats | None, colors: Floats | None
) -> None:
    """Write a mesh with normals and colours, as the mesh leaf reads them."""
    fields = [("place", "<f8", 3)]
    names = [f"property double {c}" for c in "xyz"]
    if normals is not None:
        fields.append(("normal", "<f4", 3))
        names += [f"property float n{c}" for c in "xyz"]
    if colors is not None:
        fields.append(("color", "u1", 3))
        names += [f"property uchar {c}" for c in ("red", "green", "blue")]
    vertex = np.empty(len(verts), dtype=fields)
    vertex["place"] = verts
    if normals is not None:
        vertex["normal"] = normals
    if colors is not None:
        vertex["color"] = np.round(255 * colors)
    n = faces.shape[1]
    face = np.empty(len(faces), dtype=[("n", "u1"), ("v", "<i4", n)])
    face["n"], face["v"] = n, faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(verts)}", *names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_bytes(("\n".join(header) + "\n").encode() + vertex.tobytes() + face.tobytes())


def prisms(verts: Floats, edges: Ints, width: float | Floats) -> tuple[Floats, Ints]:
    """Three-sided prisms along edges."""
    a, b = verts[edges[:, 0]], verts[edges[:, 1]]
    way = b - a
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
    u = np.cross(way, np.where(np.abs(way[:, 2:]) < 0.9, [0.0, 0, 1], [1.0, 0, 0]))
    u /= np.linalg.norm(u, axis=1)[:, None]
    w = np.cross(way, u)
    r = np.broadcast_to(np.asarray(width, dtype=float).reshape(-1, 1), (len(edges), 1))
    angle = 2 * np.pi * np.arange(3) / 3
    ring = np.cos(angle)[:, None, None] * u + np.sin(angle)[:, None, None] * w
    corners = np.concatenate([a + r * ring, b + r * ring]).transpose(1, 0, 2)
    local = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5], [0, 2, 1], [3, 4, 5]]
    faces = (6 * np.arange(len(edges)))[:, None, None] + np.array(local)
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def edges_of(faces: Ints) -> Ints:
    """Every edge of faces once."""
    pairs = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], axis=1)
    return np.unique(np.sort(pairs, axis=1), axis=0)


def balls(stage: Stage, skel: Skeleton, share: float, at: tuple[float, float, float]) -> None:
    """Add the nodes of a skeleton as small octahedra."""
    unit = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    tri = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    verts = (skel.pos[:, None] + share * skel.radius[:, None, None] * unit).reshape(-1, 3)
    faces = (6 * np.arange(skel.n_nodes)[:, None, None] + tri).reshape(-1, 3)
    stage.add(verts, faces, color="0.75, 0.12, 0.06", at=at)


LIGHT = """
sun { direction = (-0.55, -0.75, 0.8); color = (1, 0.93, 0.82); strength = 2.3; angle = 2 }
sky { zenith = (0.55, 0.66, 0.80); horizon = (0.86, 0.88, 0.90); strength = 0.75 }
"""
FLOOR = """
ground { z = %g; material = paper }
material paper { color = (0.62, 0.60, 0.56); roughness = 1; specular = 0 }
"""


def tree(**values: float) -> Skeleton:
    """The limbs of grammars/tree.pcsg, with a foot below the ground."""
    return extend_foot(pcsg.load(GRAMMARS / "tree.pcsg", **values).limbs().skeleton)


def species(name: str, **values: float) -> Skeleton:
    """The limbs of a measured tree."""
    return pcsg.load(SPECIES / f"{name}.pcsg", **values).limbs().skeleton


def steps(stage: Stage) -> None:
    """Skeleton, cage, subdivision, projection."""
    skel = tree(cnt=3, trunk=0)
    surf = tree_surface(skel)
    step = 2.25
    shift = [(k * step, 0.0, 0.0) for k in range(4)]
    stage.add_edges(skel.pos, skel.edges, 0.014, at=shift[0])
    balls(stage, skel, 0.34, shift[0])
    mesh = surf.cage.mesh
    triangles, edges = [], []
    for a, b in zip(mesh.ptr, mesh.ptr[1:], strict=False):
        face = mesh.flat[a:b]
        triangles += [[face[0], face[k], face[k + 1]] for k in range(1, len(face) - 1)]
        edges += [[face[k - 1], face[k]] for k in range(len(face))]
    stage.add(mesh.verts, np.array(triangles), color="0.55, 0.60, 0.66", at=shift[1])
    lines = np.unique(np.sort(np.array(edges), axis=1), axis=0)
    stage.add_edges(mesh.verts, lines, 0.007, at=shift[1])
    stage.add(surf.start, surf.quads, color="0.66, 0.62, 0.50", at=shift[2])
    stage.add_edges(surf.start, edges_of(surf.quads), 0.0035, at=shift[2])
    stage.add(surf.verts, surf.quads, normals=surf.normals, at=shift[3])
    stage.add_edges(surf.verts, edges_of(surf.quads), 0.0035, at=shift[3])
    camera = "eye = (3.1, -15, 2.2); target = (3.1, 0, 1.3); fov = 13.4"
    stage.render("treemesh-steps", (1200, 420), camera, LIGHT + FLOOR % 0.0)


def soup_of(skel: Skeleton, sides: int = 9) -> list[tuple[Floats, Ints]]:
    """Every limb as an open tube, as tree generators write them."""
    limbs = skel.limbs
    found = []
    around = 2 * np.pi * np.arange(sides) / sides
    for k in range(len(limbs)):
        at = slice(limbs.ptr[k], limbs.ptr[k + 1])
        places, radii = skel.pos[limbs.nodes[at]], limbs.radius[at]
        tangent = np.gradient(places, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        u = np.cross(tangent[0], [0.3, 0.5, 0.8])
        rings = []
        for p, r, t in zip(places, radii, tangent, strict=True):
            u = u - t * (u @ t)
            u /= np.linalg.norm(u)
            rings.append(
                p + r * (np.cos(around)[:, None] * u + np.sin(around)[:, None] * np.cross(t, u))
            )
        q = np.arange(sides)
        ahead = (q + 1) % sides
        faces = [
            i + np.stack([q, ahead, sides + ahead, sides + q], axis=1)
            for i in sides * np.arange(len(places) - 1)
        ]
        found.append((np.concatenate(rings), np.concatenate(faces)))
    return found


def mended(stage: Stage) -> None:
    """A soup of open tubes beside the surface that it becomes."""
    tubes = soup_of(tree(cnt=4, trunk=0))
    verts, faces, n = [], [], 0
    rng = np.random.default_rng(4)
    for v, f in tubes:
        tint = rng.uniform(0.75, 1.15)
        paint = f"{0.36 * tint:.3f}, {0.43 * tint:.3f}, {0.50 * tint:.3f}"
        stage.add(v, f, color=paint)
        verts.append(v)
        faces.append(f + n)
        n += len(v)
    quads = np.concatenate(faces)
    soup = np.concatenate(verts), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    surf = tree_surface(resample(extract_skeleton(soup)))
    shift = (2.75, 0.0, 0.0)
    stage.add(surf.verts, surf.quads, normals=surf.normals, at=shift)
    stage.add_edges(surf.verts, edges_of(surf.quads), 0.0024, at=shift)
    camera = "eye = (1.25, -10, 2.6); target = (1.25, 0, 1.5); fov = 17.5"
    stage.render("treemesh-mended", (1000, 560), camera, LIGHT)


def colors_of(error: Floats, most: float) -> Floats:
    """Blue where the original lies outside, red where it lies inside, white between."""
    t = np.clip(error / most, -1.0, 1.0)[:, None]
    white, red, blue = (
        np.array([0.9, 0.9, 0.88]),
        np.array([0.8, 0.1, 0.05]),
        np.array([0.05, 0.2, 0.75]),
    )
    return np.where(t >= 0, white + t * (red - white), white - t * (blue - white))


def errors(stage: Stage) -> None:
    """The original with its bark, the error in colours, the surface after offsets."""
    skel = species("quercus")
    true = tree_surface(skel, levels=3)
    angle = np.arctan2(true.uv[..., 0], 1.0)
    assert angle.shape == true.uv.shape[:2]
    u = np.zeros(len(true.verts))
    u[true.quads.ravel()] = true.uv[..., 0].ravel()
    v = np.zeros(len(true.verts))
    v[true.quads.ravel()] = true.uv[..., 1].ravel()
    bark = 0.05 * np.sin(2 * np.pi * 5 * u + 2.0 * np.sin(6.0 * v)) + 0.04 * np.sin(9.0 * v)
    rough = true.verts + (bark * local_radii(true))[:, None] * true.normals
    original = rough, true.triangles
    surf = restore_offsets(tree_surface(resample(extract_skeleton(original)), levels=3), original)
    assert surf.offsets is not None
    share = -surf.offsets / local_radii(surf)
    step = 3.9
    stage.add(rough, true.triangles, color="0.50, 0.53, 0.56", at=(-step, 0.0, 0.0))
    stage.add(surf.verts, surf.quads, colors=colors_of(share, 0.2))
    stage.add(surf.positions, surf.quads, at=(step, 0.0, 0.0))
    camera = "eye = (-0.6, -20, 4.6); target = (-0.6, 0, 4.0); fov = 20"
    stage.render("treemesh-errors", (1100, 640), camera, LIGHT)


def edits(stage: Stage) -> None:
    """One tree, edited four times."""
    editor = Editor(tree(cnt=4))
    limb = _edge_at(editor.skeleton, order=1)
    frames = [editor.surface]
    editor.rotate(limb, [0.2, 1.0, 0.0], -38.0)
    frames.append(editor.surface)
    editor.delete(_edge_at(editor.skeleton, order=1, last=True))
    frames.append(editor.surface)
    off = species("acer")
    ptr, others, _ = off.incidence
    way = off.pos[others[ptr[off.root]]] - off.pos[off.root]
    assert np.linalg.norm(way) > 0
    graft = Skeleton.make(0.26 * off.pos, 0.26 * off.radius, off.edges, off.root)
    turned = graft.pos @ np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]]).T
    editor.merge(graft.replaced(pos=turned + np.array([0.03, 0.0, 0.55])))
    frames.append(editor.surface)
    for k, surf in enumerate(frames):
        stage.add(surf.verts, surf.quads, normals=surf.normals, at=(2.6 * k, 0.0, 0.0))
        stage.add_edges(surf.verts, edges_of(surf.quads), 0.0024, at=(2.6 * k, 0.0, 0.0))
    camera = "eye = (3.75, -16, 2.6); target = (3.75, 0, 1.68); fov = 16.4"
    stage.render("treemesh-edits", (1200, 400), camera, LIGHT + FLOOR % 0.0)


def _edge_at(skel: Skeleton, order: int, last: bool = False) -> int:
    """The first edge of a long branch of an order."""
    from pcsg.treemesh.editing import subtree
    from pcsg.treemesh.pruning import branch_orders

    orders = branch_orders(skel)
    parent, up, nodes = skel.parents
    starts = [
        int(up[a]) for a in nodes[1:] if orders[up[a]] == order and skel.degree[parent[a]] >= 3
    ]
    sizes = [len(subtree(skel, e)[1]) for e in starts]
    ranked = [e for _, e in sorted(zip(sizes, starts, strict=True), reverse=True)]
    return ranked[2] if last else ranked[0]


def composed(stage: Stage) -> None:
    """Six trees of one template."""
    template = tree(cnt=7)
    library = Library()
    library.add(template, "tree")
    for k in range(6):
        surf = tree_surface(compose(template, library, 7 + k), max_aspect=None)
        place = (3.6 * (k % 6) - 9.0, 1.2 * (k % 2), 0.0)
        stage.add(surf.verts, surf.quads, normals=surf.normals, at=place)
    camera = "eye = (0, -26, 2.6); target = (0, 0, 1.85); fov = 12.6"
    stage.render("treemesh-composed", (1300, 330), camera, LIGHT + FLOOR % 0.0)


def hero(stage: Stage) -> None:
    """A tree of the gallery, without its leaves, as one surface."""
    surf = tree_surface(tree(cnt=11, trunk=0), max_aspect=None)
    stage.add(surf.verts, surf.quads, normals=surf.normals, color="0.36, 0.26, 0.17")
    camera = "eye = (2.0, -10, 0.9); target = (0.05, 0, 2.02); fov = 27.5"
    more = """
    sun { direction = (-0.85, -0.5, 0.5); color = (1, 0.82, 0.56); strength = 4.4; angle = 1 }
    sky { zenith = (0.20, 0.36, 0.62); horizon = (0.72, 0.71, 0.68) }
    ground { z = 0; material = grass }
    material grass { color = (0.30, 0.31, 0.14); roughness = 1; specular = 0 }
    """
    stage.render("treemesh", (800, 640), camera, more)


PICTURES: dict[str, Callable[[Stage], None]] = {
    "steps": steps,
    "mended": mended,
    "errors": errors,
    "edits": edits,
    "composed": composed,
    "hero": hero,
}


def main() -> None:
    """Make the pictures that are named, or all."""
    for name in sys.argv[1:] or list(PICTURES):
        with tempfile.TemporaryDirectory() as folder:
            PICTURES[name](Stage(Path(folder)))
        print(name, flush=True)


if __name__ == "__main__":
    main()
