"""Where a scene of many states shines: the hierarchy of light of `pcsg.graph.shining`, compiled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pcsg.graph.attributes import ATTRIBUTE_SLOTS
from pcsg.graph.nodes import Leaf
from pcsg.graph.shining import (
    COLUMNS,
    Floats,
    Glow,
    Part,
    cut_light,
    growth,
    join_corners,
    leaf_part,
    place_box,
    widening,
)
from pcsg.jit import njit
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.expand.programs import L_ARGS, LEAF_FIELDS
from pcsg.trace.expand.table import LEAF, N_STATES, STATE, Table
from pcsg.vec import IDENTITY, Affine, Vec3, load_affine

_MATERIAL = ATTRIBUTE_SLOTS.index("@material")

_PART = 7
"""Numbers of a part: the corners of its box, and its power."""


@njit(entry=True)
def gather_light(
    table: Table,
    order: NDArray[np.int32],
    part_of: NDArray[np.int32],
    parts: NDArray[np.float64],
    states: NDArray[np.float64],
) -> None:
    """Fill in what shines in every state.

    Parameters
    ----------
    order : int32 (N,)
        The states, each after those that it contains.
    part_of : int32 (M,)
        What a leaf sends out, by item; -1 for nothing.
    parts : float64 (_PART P,)
        Corners and powers of leaves.
    states : float64 (_PART N,)
        The same of states, in the end; lower corners above upper ones where nothing shines.
    """
    for k in range(table.counters[N_STATES]):
        s = order[k]
        lower = Vec3(math.inf, math.inf, math.inf)
        upper = Vec3(-math.inf, -math.inf, -math.inf)
        power = 0.0
        for i in range(table.first[s], table.last[s]):
            m = table.matrix[i]
            place = IDENTITY if m < 0 else load_affine(table.matrices, 12 * m)
            if table.kind[i] == LEAF and part_of[i] >= 0:
                at = _PART * part_of[i]
                low, high = _corners(parts, at)
                power += parts[at + 6] * widening(place, low, high)
            elif table.kind[i] == STATE:
                at = _PART * table.target[i]
                low, high = _corners(states, at)
                if not low.x <= high.x:
                    continue
                power += states[at + 6] * growth(place)
            else:
                continue
            low, high = place_box(place, low, high)
            lower, upper = join_corners(lower, upper, low, high)
        for j in range(3):
            states[_PART * s + j], states[_PART * s + 3 + j] = lower[j], upper[j]
        states[_PART * s + 6] = power


@njit
def _corners(parts: NDArray[np.float64], at: int) -> tuple[Vec3, Vec3]:
    return (
        Vec3(parts[at], parts[at + 1], parts[at + 2]),
        Vec3(parts[at + 3], parts[at + 4], parts[at + 5]),
    )


def shining_covers(expansion: Expansion, strengths: Sequence[float]) -> Floats:
    """Return covers of all that shines, those of `pcsg.graph.shining.shining_covers`.

    Parameters
    ----------
    strengths
        How much a surface of every material shines.
    """
    if expansion.order is None:
        return np.empty((0, COLUMNS))
    light = _Light(expansion, strengths)
    return cut_light(light.part(0), light.items)


class _Light:
    """The hierarchy of light of an expansion without cycles."""

    def __init__(self, expansion: Expansion, strengths: Sequence[float]) -> None:
        self.table = expansion.table
        self.parts: list[Part] = []
        self.part_of = np.full(expansion.n_items, -1, np.int32)
        self._find_leaves(expansion, strengths)
        numbers = [x for p in self.parts for x in (*p.lower, *p.upper, p.power)]
        states = np.zeros(_PART * expansion.n_states)
        assert expansion.order is not None
        gather_light(self.table, expansion.order, self.part_of, np.array(numbers or [0.0]), states)
        self.states = states.reshape(-1, _PART)

    def _find_leaves(self, expansion: Expansion, strengths: Sequence[float]) -> None:
        """Fill in the parts of leaves; those that are alike share one."""
        table, programs = self.table, expansion.programs
        assigned = programs.attributes >= 0
        if not (assigned[_MATERIAL] and expansion.leaf_nodes):
            return
        counts = programs.leaves[L_ARGS::LEAF_FIELDS]
        here = np.flatnonzero(table.kind[: expansion.n_items] == LEAF)
        behind = counts[table.target[here]] + int(np.count_nonzero(assigned[:_MATERIAL]))
        material = np.nan_to_num(table.numbers[table.numbers_at[here] + behind], nan=-1.0)
        shines = np.append(np.array(strengths, np.float64) > 0.0, False)[material.astype(np.int64)]
        here, material = here[shines], material[shines]
        count = counts[table.target[here]]
        rows = np.zeros((len(here), 2 + int(count.max(initial=0))))
        rows[:, 0], rows[:, 1] = table.target[here], material
        for k in range(rows.shape[1] - 2):
            some = count > k
            rows[some, 2 + k] = table.numbers[table.numbers_at[here[some]] + k]
        # By bits: numbers that are equal may differ in their sign.
        whole = np.ascontiguousarray(rows).view(f"V{8 * rows.shape[1]}").ravel()
        _, one, which = np.unique(whole, return_index=True, return_inverse=True)
        found = np.full(len(one), -1, np.int32)
        for k, row in enumerate(rows[one].tolist()):
            leaf, number = int(row[0]), int(row[1])
            node = expansion.graph.nodes[expansion.leaf_nodes[leaf]]
            assert isinstance(node, Leaf)
            part = leaf_part(node, tuple(row[2 : 2 + int(counts[leaf])]), strengths[number])
            if part is not None:
                found[k] = len(self.parts)
                self.parts.append(part)
        self.part_of[here] = found[which]

    def part(self, state: int) -> Part | None:
        """Return what shines in a state, None where nothing does."""
        a, b, c, d, e, f, power = self.states[state].tolist()
        return Part(Vec3(a, b, c), Vec3(d, e, f), power, math.inf) if a <= d else None

    def items(self, k: int, most: float) -> list[Glow]:
        """Return what shines in a state, but nothing where that is more than `most`."""
        table = self.table
        run = slice(int(table.first[k]), int(table.last[k]))
        kinds, targets = table.kind[run], table.target[run]
        inner = kinds == STATE
        lit = (kinds == LEAF) & (self.part_of[run] >= 0)
        lit[inner] = self.states[targets[inner], 0] <= self.states[targets[inner], 3]
        found = np.flatnonzero(lit) + run.start
        if len(found) > most:
            return []
        glows = []
        for i in found.tolist():
            m = int(table.matrix[i])
            place = Affine(*table.matrices[12 * m : 12 * m + 12].tolist()) if m >= 0 else IDENTITY
            state = int(table.target[i])
            if table.kind[i] == LEAF:
                glows.append(Glow(-1, self.parts[self.part_of[i]], place))
            else:
                part = self.part(state)
                assert part is not None
                glows.append(Glow(state, part, place))
        return glows
