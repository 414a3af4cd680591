"""The pool: the arrays of all models of a graph, one behind the other."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.leaf.registry import Data, Model, Pool


class ModelPool:
    """Places models in one pool, each once."""

    def __init__(self) -> None:
        self._models: dict[int, tuple[Model, tuple[float, float, float]]] = {}
        self._pool: Pool | None = None

    def place(self, model: Model) -> tuple[float, float, float]:
        """Return the kernel arguments of a model: where its arrays begin."""
        key = id(model)
        if key not in self._models:
            data = [m.data for m, _ in self._models.values()]
            at = (
                float(sum(len(d.doubles) for d in data)),
                float(sum(len(d.singles) for d in data)),
                float(sum(len(d.integers) for d in data)),
            )
            self._models[key] = model, at
            self._pool = None
        return self._models[key][1]

    @property
    def pool(self) -> Pool:
        """The arrays, never empty, as kernels take them."""
        if self._pool is None:
            data = [m.data for m, _ in self._models.values()]
            if len(data) == 1:
                # A single model is not copied.
                self._pool = (_filled(data[0].doubles), *map(_filled, data[0][1:]))  # type: ignore[assignment]
            else:
                none = Data(np.zeros(1), np.zeros(1, np.float32), np.zeros(1, np.int32))
                self._pool = tuple(np.concatenate(a) for a in zip(*data, none, strict=True))  # type: ignore[assignment]
        assert self._pool is not None
        return self._pool

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of the models, nothing where there are none."""
        return (
            {"models": sum(m.data.nbytes for m, _ in self._models.values())} if self._models else {}
        )


def _filled(array: NDArray[np.generic]) -> NDArray[np.generic]:
    return array if len(array) else np.zeros(1, array.dtype)


_POOLS: WeakKeyDictionary[Graph, ModelPool] = WeakKeyDictionary()


def pool_of(graph: Graph) -> ModelPool:
    """Return the pool of a graph, which all engines share."""
    return _POOLS.setdefault(graph, ModelPool())
