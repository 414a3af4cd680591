"""How deep the derivation of a table goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.depth import count_until_shrunk
from pcsg.jit import njit
from pcsg.trace.expand.table import N_STATES, STATE, Table
from pcsg.vec import IDENTITY, load_affine, store_affine


@njit(entry=True)
def deepest_above(table: Table, selects: NDArray[np.bool_], depth: NDArray[np.int32]) -> int:
    """Return the state with the most selections on the way that found it.

    Parameters
    ----------
    selects : bool (M,)
        Which modules are selections.
    depth : int32 (N,)
        Receives the selections on the way to every state.
    """
    best = depth[0] = 0
    for s in range(1, table.counters[N_STATES]):
        depth[s] = depth[table.parent[s]] + (1 if selects[table.module[s]] else 0)
        if depth[s] > depth[best]:
            best = s
    return int(best)


@njit(entry=True)
def deepest_below(
    table: Table,
    order: NDArray[np.int32],
    selects: NDArray[np.bool_],
    depth: NDArray[np.int32],
    below: NDArray[np.int32],
) -> None:
    """Fill in the most selections on a path from every state down, and the state it leads to.

    Parameters
    ----------
    order : int32 (N,)
        The states, each after those that it contains.
    depth, below : int32 (N,)
        Zeros; -1 for none.
    """
    for k in range(table.counters[N_STATES]):
        s = order[k]
        best = -1
        for i in range(table.first[s], table.last[s]):
            if table.kind[i] == STATE and (best < 0 or depth[table.target[i]] > depth[best]):
                best = table.target[i]
        below[s] = best
        own = 1 if s > 0 and selects[table.module[s]] else 0
        depth[s] = own + (depth[best] if best >= 0 else 0)


@njit(entry=True)
def collect_places(table: Table, chain: NDArray[np.int32], places: NDArray[np.float64]) -> None:
    """Write the matrix of every state of a chain, which begins with the axiom, in the one above."""
    for k in range(1, len(chain)):
        i = table.first[chain[k - 1]]
        while table.kind[i] != STATE or table.target[i] != chain[k]:
            i += 1
        m = table.matrix[i]
        place = IDENTITY if m < 0 else load_affine(table.matrices, 12 * m)
        store_affine(places, 12 * (k - 1), place)


def chain_above(table: Table, state: int) -> NDArray[np.int32]:
    """Return the states that led to one when it was found, from the axiom down."""
    chain = [state]
    while chain[-1] > 0:
        chain.append(int(table.parent[chain[-1]]))
    return np.array(chain[::-1], np.int32)


def chain_below(below: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the states of the deepest path from the axiom down."""
    chain = [0]
    while below[chain[-1]] >= 0:
        chain.append(int(below[chain[-1]]))
    return np.array(chain, np.int32)


def shrinks(table: Table, chain: NDArray[np.int32]) -> bool:
    """Return whether the frame of a chain's last state, or one before it, is below rounding."""
    places = np.zeros(12 * len(chain))
    collect_places(table, chain, places)
    return count_until_shrunk(places, 0, len(chain) - 1) >= 0
