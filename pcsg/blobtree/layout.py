"""Where what stands in the arrays of a model: three pools that kernels read, and their workspace.

A model may lie anywhere in larger pools; offsets are relative to where its own parts begin.

=======  =======================================================================================
float64  `CENTRE`..., then rows of primitives, operators' numbers, chains of warps, attributes
float32  boxes of the hierarchy, six numbers a node; turns u and lengths v of primitives
int32    the header; primitives, three numbers each; operators, four each; nodes, one each
=======  =======================================================================================

Primitives are numbered depth first, and so are the nodes of their hierarchy: an inner node is
followed by its first child, and says where to go on after a miss; the primitives of a subtree, of
operators as of nodes, are consecutive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.jit import njit

Pool = tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.int32]]

# float64: the middle and half the diagonal of the support's box.
CENTRE, SIZE, FLOATS = 0, 3, 4

# int32: the header.
COUNT, OPERATORS, NODES, OPERATORS_AT, NODES_AT, UV_AT, ATTRIBUTES_AT, HEADER = range(8)
"""Numbers of things, and where they begin; `UV_AT` is -1 where all are zero."""

# A primitive: where its row is, its operator, and its kind with flags and its attributes.
ROW, PARENT, ABOUT, PRIMITIVE = range(4)
SLIM = 32
SILENT = 64
ATTRIBUTES = 128
"""``about = kind + SLIM * slim + SILENT * silent + ATTRIBUTES * attributes``; what is silent, as a
bound is, has no part in colours."""

# An operator: its parent (-1 for the root), the end of its primitives, what it is, and where its
# numbers are.
UP, END, WHAT, ARGS, OPERATOR = range(5)
KIND, ANCHOR, LOOSE, SLOT = 31, 32, 64, 128
"""``what = kind + ANCHOR * anchor + LOOSE * loose + SLOT * slot``: an anchor does more than hand on
a single child, a loose one has no anchor from it upwards; `slot` is which child of its parent."""

# A slim row: foot and axis vector, radius of the skeleton's foot, reach.
SLIM_ROW = 8

# A full row: local_from_model or, behind warps, from the last one's frame; a box that holds the
# support, in the local frame or, with warps, in the model's; weight, 1 / reach2, chain of warps or
# -1, greatest speed and acceleration, the skeleton's constants.
MATRIX, BOX, WEIGHT, INVERSE, CHAIN, SPEED, ACCELERATION, CONSTANT = 0, 12, 18, 19, 20, 21, 22, 23
FULL_ROW = 31

FALL, RISE, STEEP = 28, 29, 30
"""Of a field that is no distance's: bounds of its second derivative, and its greatest slope."""

# A warp of a chain, in float64: the map into its frame, its numbers, the greatest speed before it.
WARP_CONSTANT, WARP_SPEED, WARP_ROW = 12, 16, 17

LEAF_BITS = 16
"""A leaf of the hierarchy is ``first * LEAF_BITS + count``, an inner node -(the next on a miss)."""

MAX_LEAF = 12


class Tables(NamedTuple):
    """A model in the pools: the arrays, where its parts begin, and its header."""

    floats: NDArray[np.float64]
    singles: NDArray[np.float32]
    ints: NDArray[np.int32]
    f: int
    s: int
    primitives: int
    operators: int
    nodes: int
    primitive_count: int
    node_count: int
    uv: int
    attributes: int


@njit
def wide(x: float) -> int:
    """Return an integer of 64 bits, so that offsets do not overflow."""
    return np.int64(x)  # type: ignore[return-value]  # to numba it is an int


@njit
def find_tables(pool: Pool, f: int, s: int, i: int) -> Tables:
    """Return the model whose parts begin at these places of the pools."""
    ints = pool[2]
    return Tables(
        pool[0],
        pool[1],
        ints,
        f,
        s,
        i + HEADER,
        i + wide(ints[i + OPERATORS_AT]),
        i + wide(ints[i + NODES_AT]),
        wide(ints[i + COUNT]),
        wide(ints[i + NODES]),
        wide(ints[i + UV_AT]),
        f + wide(ints[i + ATTRIBUTES_AT]),
    )


# What is known of a primitive that a ray meets: the ray in its frame, from its nearest point on;
# that point's parameter; 1 / reach2, weight; twice the squared speed, or speed and acceleration
# behind warps; constants; where its support begins and ends; its full row and its chain.
ORIGIN, DIRECTION, NEAREST, H_INVERSE, H_WEIGHT, H_SPEED, H_ACCELERATION = 0, 3, 6, 7, 8, 9, 10
H_CONSTANT, ENTER, LEAVE, H_ROW, MET = 11, 16, 17, 18, 20

STACK = 512
"""Most intervals that wait at a time."""

# Places in the workspace, in units of the room. Values and their slots have the same number, and
# begin with a cell of the bounds' share.
KINDS, ORDER, FRAMES, SLOTS, LISTS = 1, 2, 3, 5, 6


class Work(NamedTuple):
    """The workspace of one thread.

    Attributes
    ----------
    floats
        `MET` numbers for each primitive that is met; then four for each value.
    ints
        Numbers of what is met, kinds, order, frames of operators, slots of values, lists.
    intervals, marks
        Two and four numbers for each interval that waits.
    room
        Most primitives that a ray may meet, a multiple of 4.
    """

    floats: NDArray[np.float64]
    ints: NDArray[np.int64]
    intervals: NDArray[np.float64]
    marks: NDArray[np.int64]
    room: int


@njit
def list_length(room: int) -> int:
    """Return the length of all lists that wait: few primitives are listed on many levels."""
    return 12 * room + 96 * min(room, 128)
