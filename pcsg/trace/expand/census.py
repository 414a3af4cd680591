"""What a table of states says of a scene as a whole: counts, and the leaves that differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.nodes import Leaf
from pcsg.jit import njit
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.programs import HAS_DATA, L_ARGS, L_FLAGS, LEAF_FIELDS
from pcsg.trace.expand.table import LEAF, N_STATES, OPERATION, STATE, Table

_EXACT = 2.0**53
"""Up to here sums of whole numbers in double precision are exact."""


@njit(entry=True)
def add_up(
    table: Table, order: NDArray[np.int32], own: NDArray[np.float64], totals: NDArray[np.float64]
) -> None:
    """Fill in the sums over all leaves below every state.

    Parameters
    ----------
    order : int32 (N,)
        The states, each after those that it contains.
    own : float64 (L,)
        What every leaf counts for.
    totals : float64 (N,)
        Of every state.
    """
    for k in range(table.counters[N_STATES]):
        s = order[k]
        total = 0.0
        for i in range(table.first[s], table.last[s]):
            if table.kind[i] == LEAF:
                total += own[table.target[i]]
            elif table.kind[i] == STATE:
                total += totals[table.target[i]]
        totals[s] = total


def count_primitives(expansion: Expansion) -> int | None:
    """Return the exact number of primitives of a scene, all operands counted.

    None where it is not known, because a state contains itself or a fault was met.
    """
    if expansion.order is None:
        return None
    nodes = [expansion.graph.nodes[n] for n in expansion.leaf_nodes]
    own = [node.primitives for node in nodes if isinstance(node, Leaf)]
    totals = np.zeros(expansion.n_states)
    add_up(expansion.table, expansion.order, np.array([*own, 0], np.float64), totals)
    return int(totals[0]) if totals[0] < _EXACT else _count_exactly(expansion, own)


def _count_exactly(expansion: Expansion, own: list[int]) -> int:
    """Return the number of primitives in integers of any size."""
    table, order = expansion.table, expansion.order
    assert order is not None
    n, m = expansion.n_states, expansion.n_items
    kinds, targets = table.kind[:m].tolist(), table.target[:m].tolist()
    first, last = table.first[:n].tolist(), table.last[:n].tolist()
    totals = [0] * n
    for s in order.tolist():
        totals[s] = sum(
            own[targets[i]] if kinds[i] == LEAF else totals[targets[i]]
            for i in range(first[s], last[s])
            if kinds[i] != OPERATION
        )
    return totals[0]


def data_leaves(expansion: Expansion) -> list[tuple[Leaf, tuple[float, ...]]]:
    """Return the leaves with data of all states, each with its numbers once."""
    table, programs = expansion.table, expansion.programs
    if not expansion.leaf_nodes:
        return []
    fields = programs.leaves.reshape(-1, LEAF_FIELDS)
    here = np.flatnonzero(table.kind[: expansion.n_items] == LEAF)
    here = here[fields[table.target[here], L_FLAGS] & HAS_DATA != 0]
    here = here[np.argsort(table.target[here], kind="stable")]
    found: set[tuple[int, tuple[float, ...]]] = set()
    for items in np.split(here, np.flatnonzero(np.diff(table.target[here])) + 1):
        for leaf in table.target[items[:1]].tolist():
            at = table.numbers_at[items][:, None] + np.arange(fields[leaf, L_ARGS])
            n = expansion.leaf_nodes[leaf]
            found.update((n, tuple(row)) for row in table.numbers[at].tolist())
    nodes = ((expansion.graph.nodes[n], args) for n, args in sorted(found))
    return [(node, args) for node, args in nodes if isinstance(node, Leaf)]
