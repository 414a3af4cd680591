"""The pool: the arrays of all models of a graph, one behind the other."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf
from pcsg.leaf.apart import addresses_of, length_of_addresses
from pcsg.leaf.registry import Model, Pool, Solid


class ModelPool:
    """Places models in one pool, each once.

    Parameters
    ----------
    solids
        All leaves of the scene: of those that are compiled apart it has the addresses.
    """

    def __init__(self, solids: Collection[type[Solid]]) -> None:
        self._solids = tuple(solids)
        self._head = length_of_addresses(solids)
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
                float(sum(len(d.integers) for d in data) + self._head),
            )
            self._models[key] = model, at
            self._pool = None
        return self._models[key][1]

    @property
    def pool(self) -> Pool:
        """The arrays, never empty, as kernels take them."""
        if self._pool is None:
            data = [m.data for m, _ in self._models.values()]
            doubles = _join([d.doubles for d in data], np.float64)
            singles = _join([d.singles for d in data], np.float32)
            addresses = addresses_of(self._solids)
            integers = _join([addresses, *(d.integers for d in data)], np.int32)
            self._pool = doubles, singles, integers
        return self._pool

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of the models, nothing where there are none."""
        return (
            {"models": sum(m.data.nbytes for m, _ in self._models.values())} if self._models else {}
        )


def _join(arrays: Sequence[NDArray[Any]], dtype: type) -> NDArray[Any]:
    """Return arrays in one piece, a single one as it is; never an empty one."""
    filled = [a for a in arrays if len(a)] or [np.zeros(1, dtype)]
    return filled[0] if len(filled) == 1 else np.concatenate(filled)


_POOLS: WeakKeyDictionary[Graph, ModelPool] = WeakKeyDictionary()


def make_pool(graph: Graph) -> ModelPool:
    """Return a new pool for a graph."""
    return ModelPool({node.solid for node in graph.nodes if isinstance(node, Leaf)})


def pool_of(graph: Graph) -> ModelPool:
    """Return the pool of a graph, which all engines share."""
    found = _POOLS.get(graph)
    return _POOLS.setdefault(graph, make_pool(graph)) if found is None else found
