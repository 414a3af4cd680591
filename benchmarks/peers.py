"""Other ray tracers on the same triangles. One that is not installed is None."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from benchmarks.meshes import Triangles
from benchmarks.views import Floats


class Peer(Protocol):
    """A ray tracer that holds a mesh."""

    name: str
    clock: Callable[[], float]
    """What its work counts on: most take the calling thread, some have threads of their own."""

    def prepare(self, rays: tuple[Floats, Floats]) -> Any:
        """Return rays in its own form; not measured."""

    def closest(self, rays: Any) -> Any:
        """Return first hits with distance, normal and triangle."""

    def distances(self, answer: Any) -> Floats:
        """Return the distances of an answer, inf where nothing was hit."""


class Embree:
    """Embree by way of embreex: single rays, float32, on the calling thread."""

    name = "embreex"
    clock = staticmethod(time.thread_time)

    def __init__(self, mesh: Triangles) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        self.mesh = TriangleMesh(self.scene, mesh.corners.astype(np.float32), mesh.faces)
        self.scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def prepare(self, rays: tuple[Floats, Floats]) -> Any:
        return tuple(a.astype(np.float32) for a in rays)

    def closest(self, rays: Any) -> Any:
        return self.scene.run(*rays, query="INTERSECT", output=True)

    def distances(self, answer: Any) -> Floats:
        hit = answer["primID"] >= 0
        return np.where(hit, answer["tfar"].astype(float), np.inf)


class Mitsuba:
    """Mitsuba 3 in its vectorised form on one thread of its own; float32."""

    name = "Mitsuba"
    clock = staticmethod(time.process_time)

    def __init__(self, mesh: Triangles) -> None:
        import drjit
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        drjit.set_thread_count(1)
        self.drjit, self.mitsuba = drjit, mitsuba
        shape = mitsuba.Mesh("mesh", len(mesh.corners), len(mesh.faces))
        parameters = mitsuba.traverse(shape)
        parameters["vertex_positions"] = mitsuba.Float(mesh.corners.astype(np.float32).ravel())
        parameters["faces"] = mitsuba.UInt32(mesh.faces.astype(np.uint32).ravel())
        parameters.update()
        self.scene = mitsuba.load_dict({"type": "scene", "mesh": shape})

    def prepare(self, rays: tuple[Floats, Floats]) -> Any:
        origins, directions = (
            self.mitsuba.Point3f(a.astype(np.float32).T.copy()) for a in rays
        )  # fmt: skip
        made = self.mitsuba.Ray3f(origins, directions)
        self.drjit.eval(made)
        return made

    def closest(self, rays: Any) -> Any:
        found = self.scene.ray_intersect(rays)
        answer = (found.t, found.n, found.prim_index)
        self.drjit.eval(answer)
        self.drjit.sync_thread()
        return answer

    def distances(self, answer: Any) -> Floats:
        return np.array(answer[0], float)


PEERS = (Embree, Mitsuba)


def make_peers(mesh: Triangles | None) -> list[Peer]:
    """Return the peers that are installed, with a mesh; none without one."""
    found: list[Peer] = []
    for kind in PEERS if mesh is not None else ():
        try:
            found.append(kind(mesh))
        except (ImportError, OSError, RuntimeError):
            continue  # not installed, or without what it needs in turn
    return found
