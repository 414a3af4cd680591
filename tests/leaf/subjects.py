"""What the contract of leaves is tested on: every solid of the registry, and models of those with
data, in one form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapes
from shapes import Shape

from pcsg.leaf.mesh import Mesh, mesh_of_arrays
from pcsg.leaf.registry import LEAVES, Box, Model, Solid
from pcsg.trace.pool import ModelPool
from pcsg.vec import Vec3


class Subject:
    """A solid without data."""

    def __init__(self, solid: type[Solid], name: str, shape: Shape) -> None:
        self.name, self.kind, self.shape = name, solid.kind, shape
        self.solid = solid
        self.pool: Any = ModelPool([solid]).pool

    def bounds_of(self, args: Sequence[float]) -> Box:
        return self.solid.bounds_of(args)

    def support(self, direction: Vec3, args: Sequence[float]) -> float:
        return self.solid.support_of(direction, args)

    def arguments(self, args: Sequence[float]) -> Any:
        """Return the kernel arguments, which begin at 1."""
        return np.array([9.0, *args, 9.0])


class ModelSubject(Subject):
    """A model, with other models around it in the pool."""

    def __init__(self, solid: type[Solid], name: str, shape: Shape, model: Model) -> None:
        super().__init__(solid, name, shape)
        self.model = model
        models = ModelPool([solid])
        models.place(mesh_of_arrays(np.eye(3), [[0, 1, 2]]))
        self.places = models.place(model)
        models.place(mesh_of_arrays(2.0 * np.eye(3), [[0, 1, 2]]))
        self.pool = models.pool

    def bounds_of(self, args: Sequence[float]) -> Box:
        return self.model.bounds

    def support(self, direction: Vec3, args: Sequence[float]) -> float:
        return self.model.support(direction)

    def arguments(self, args: Sequence[float]) -> Any:
        return np.array([9.0, *self.places, 9.0])


def subjects() -> list[Subject]:
    """Return everything that is described in `shapes`."""
    plain = [
        Subject(cls, name, shapes.SHAPES[name])
        for name, cls in LEAVES.items()
        if not cls.sheet and not cls.constants
    ]
    return plain + [
        ModelSubject(Mesh, f"mesh-{name}", shape, mesh_of_arrays(vertices, faces))
        for name, (vertices, faces, shape) in shapes.MESHES.items()
    ]
