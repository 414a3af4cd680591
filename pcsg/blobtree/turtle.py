r"""The turtle: strings of an L-system become internodes, leaves and polygons.

=============  =================================================================================
``F(l)``       an internode; its radii are the widths before and after it
``f(l)``       a move
``+ -``        turn left, right (about the turtle's up)
``& ^``        pitch down, up
``/ \``        roll right, left
``|``          turn back
``$``          roll until the turtle's left is horizontal
``[ ]``        a branch
``!(w)``       the width: the radius of what follows; without a number `thinning` times the last one
``'``          the next colour of wood and leaves
``%``          cuts off the rest of the branch
``L(size)``    a leaf
``{ }``        a polygon; its corners are where it begins and where each ``F``, ``f``, ``G`` leads
``.``          a corner of the polygon; where one has dots, ``G`` makes no corners
=============  =================================================================================

After every internode the turtle is pulled (`Pull`). Angles are degrees; without a number they are
the constant ``angle``. The turtle starts in the origin, looking up. Polygons are those of
Prusinkiewicz and Lindenmayer 1990, section 5.1: they stand on a stack of their own, so that one may
begin in a branch and end behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.blobtree.lsystem import Letter
from pcsg.blobtree.skeletons import LARGEST, SMALLEST
from pcsg.errors import UsageError

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

COMMANDS = frozenset("FfG+-&^/\\|$[]!'%L{}.")
"""Modules that the turtle knows."""

DOWN: Vector = (0.0, 0.0, -1.0)

MOST_PARTS = 20_000
"""Internodes, leaves and triangles at most, where a file does not ask for more: some seconds."""


class Skeleton(NamedTuple):
    """Internodes of a plant, parents before children.

    Attributes
    ----------
    start, end : float64 (N, 3)
    base, top : float64 (N,)
        Radii.
    parent : int64 (N,)
        Number of the internode that bears it, -1 for none.
    lateral : bool (N,)
        Whether it begins a branch, rather than goes on with its parent's axis.
    colour : int64 (N,)
        How many ``'`` came before it.
    """

    start: Array
    end: Array
    base: Array
    top: Array
    parent: NDArray[np.int64]
    lateral: NDArray[np.bool_]
    colour: NDArray[np.int64]


class Leaves(NamedTuple):
    """Leaves of a plant: where, with which frame (columns: heading, left, up), how large.

    `colour` counts as that of internodes does.
    """

    place: Array
    frame: Array
    size: Array
    colour: NDArray[np.int64]


class Polygon(NamedTuple):
    """A polygon: corners (K, 3), and its colour's number."""

    corners: Array
    colour: int


class Drawing(NamedTuple):
    """What a turtle has drawn."""

    skeleton: Skeleton
    leaves: Leaves
    polygons: list[Polygon]


class _State(NamedTuple):
    place: Vector
    heading: Vector
    left: Vector
    up: Vector
    width: float
    colour: int
    last: int
    own: bool


class Pull(NamedTuple):
    """Tropism: what turns the turtle after every internode.

    It turns about the product of heading and direction by ``elasticity`` times its length, in
    radians (Prusinkiewicz and Lindenmayer 1990, p. 58).
    """

    elasticity: float = 0.0
    direction: Vector = DOWN


def _turn(a: Vector, b: Vector, degrees: float) -> tuple[Vector, Vector]:
    """Return two orthogonal directions turned in their plane, the first towards the second."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    first = (c * a[0] + s * b[0], c * a[1] + s * b[1], c * a[2] + s * b[2])
    second = (c * b[0] - s * a[0], c * b[1] - s * a[1], c * b[2] - s * a[2])
    return first, second


class _Outline:
    """The corners of a polygon while it is drawn.

    Parameters
    ----------
    start
        Where it begins.
    """

    def __init__(self, start: Vector) -> None:
        self.start = start
        # Corners, and whether they are of `G`, which makes none where there are dots.
        self.corners: list[tuple[Vector, bool]] = []
        self.dotted = False

    def add(self, place: Vector, symbol: str) -> None:
        self.corners.append((place, symbol == "G"))
        self.dotted = self.dotted or symbol == "."

    def polygon(self, colour: int) -> Polygon | None:
        """Return the polygon; None for one of fewer than three corners."""
        places = [place for place, of_g in self.corners if not (self.dotted and of_g)]
        places = [p for k, p in enumerate(places) if not k or p != places[k - 1]]
        # Dots say where all corners are, the first one too if there are enough.
        if not self.dotted or len(places) < 3:
            places = [self.start, *(p for p in places[:1] if p != self.start), *places[1:]]
        return Polygon(np.array(places), colour) if len(places) >= 3 else None


NO_PULL = Pull()


def draw(
    string: Sequence[Letter],
    angle: float = 30.0,
    width: float = 0.1,
    thinning: float = 0.7,
    most: int = MOST_PARTS,
    pull: Pull = NO_PULL,
) -> Drawing:
    """Return what the turtle draws for a string.

    Parameters
    ----------
    angle, width
        In degrees, of turns without a number; the radius of what comes first.
    thinning
        What ``!`` without a number multiplies the width by.
    most
        Internodes, leaves and triangles of polygons at most.
    pull
        What turns the turtle after every internode.

    Raises
    ------
    UsageError
        Brackets do not match, a number makes no sense, or there are too many parts.
    """
    rows: list[tuple[Vector, Vector, float, float, int, bool, int]] = []
    tops: list[float] = []
    leaves: list[tuple[Vector, tuple[Vector, Vector, Vector], float, int]] = []
    polygons: list[Polygon] = []
    outlines: list[_Outline] = []
    triangles = 0
    if not SMALLEST <= width <= LARGEST:
        raise UsageError(f"the constant `width` must be > 0, not {width:g}")
    s = _State((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), width, 0, -1,
               False)  # fmt: skip
    stack: list[_State] = []
    cut = 0
    was_cut = False
    for symbol, args in string:
        if cut and symbol not in "[]":
            continue
        first = args[0] if args else None
        if symbol in "FfG":
            length = 1.0 if first is None else first
            to = tuple(p + length * h for p, h in zip(s.place, s.heading, strict=True))
            if not max(map(abs, to)) < LARGEST:
                raise UsageError(f"{symbol}({length:g}): it leads too far away")
            here: Vector = (to[0], to[1], to[2])
            if symbol == "F" and here != s.place and length > 0.0:
                rows.append((s.place, here, s.width, s.width, s.last, not s.own, s.colour))
                tops.append(s.width)
                s = s._replace(place=here, last=len(rows) - 1, own=True)
                s = _pulled(s, pull) if pull.elasticity else s
            else:
                s = s._replace(place=here, own=s.own and (symbol == "G" or here == s.place))
            if outlines:
                outlines[-1].add(here, symbol)
        elif symbol in "+-":
            turned = (angle if first is None else first) * (1.0 if symbol == "+" else -1.0)
            h, left = _turn(s.heading, s.left, turned)
            s = s._replace(heading=h, left=left)
        elif symbol in "&^":
            turned = (angle if first is None else first) * (1.0 if symbol == "^" else -1.0)
            h, up = _turn(s.heading, s.up, turned)
            s = s._replace(heading=h, up=up)
        elif symbol in "/\\":
            turned = (angle if first is None else first) * (1.0 if symbol == "/" else -1.0)
            left, up = _turn(s.left, s.up, -turned)
            s = s._replace(left=left, up=up)
        elif symbol == "|":
            h, left = _turn(s.heading, s.left, 180.0)
            s = s._replace(heading=h, left=left)
        elif symbol == "$":
            s = _level(s)
        elif symbol == "!":
            w = s.width * thinning if first is None else first
            if not SMALLEST <= w <= LARGEST:
                wrong = "a width must be > 0" if w <= 0.0 else "no such width can be drawn"
                raise UsageError(f"!({w:g}): {wrong}")
            if s.own and s.last >= 0:
                tops[s.last] = min(tops[s.last], w)
            s = s._replace(width=w)
        elif symbol == "'":
            s = s._replace(colour=s.colour + 1)
        elif symbol == "[":
            if cut:
                cut += 1
                continue
            stack.append(s)
            s = s._replace(own=False)
        elif symbol == "]":
            if cut > 1:
                cut -= 1
                continue
            cut = 0
            if not stack:
                raise UsageError("the string has a `]` without `[`")
            s = stack.pop()
        elif symbol == "%":
            cut, was_cut = 1, True
        elif symbol == "L":
            size = 1.0 if first is None else first
            if abs(size) > LARGEST:
                raise UsageError(f"L({size:g}): no such leaf can be drawn")
            leaves.append((s.place, (s.heading, s.left, s.up), size, s.colour))
        elif symbol == "{":
            outlines.append(_Outline(s.place))
        elif symbol == "." and outlines:
            outlines[-1].add(s.place, symbol)
        elif symbol == "}":
            if not outlines:
                raise UsageError("the string has a `}` without `{`")
            if polygon := outlines.pop().polygon(s.colour):
                polygons.append(polygon)
                triangles += len(polygon.corners) - 2
        if len(rows) + len(leaves) + triangles > most:
            raise UsageError(
                f"it draws more than {most:,} internodes, leaves and triangles; take fewer "
                f"`steps`, or allow more by a line `most: {4 * most}`"
            )
    if stack:
        raise UsageError("the string has a `[` without `]`")
    # What `%` cuts off may be the end of a polygon.
    if outlines and not was_cut:
        raise UsageError("the string has a `{` without `}`")
    return Drawing(_skeleton(rows, tops), _leaves(leaves), polygons)


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _pulled(s: _State, pull: Pull) -> _State:
    axis = _cross(s.heading, pull.direction)
    size = math.hypot(*axis)
    if size < 1e-12:
        return s
    k = (axis[0] / size, axis[1] / size, axis[2] / size)
    c, sine = math.cos(pull.elasticity * size), math.sin(pull.elasticity * size)

    def turned(v: Vector) -> Vector:
        along = (1.0 - c) * (k[0] * v[0] + k[1] * v[1] + k[2] * v[2])
        x, y, z = _cross(k, v)
        return (
            c * v[0] + sine * x + along * k[0],
            c * v[1] + sine * y + along * k[1],
            c * v[2] + sine * z + along * k[2],
        )

    return s._replace(heading=turned(s.heading), left=turned(s.left), up=turned(s.up))


def _level(s: _State) -> _State:
    x, y, _z = s.heading
    across = math.hypot(x, y)
    if across < 1e-9:
        return s
    left = (-y / across, x / across, 0.0)
    return s._replace(left=left, up=_cross(s.heading, left))


def _skeleton(
    rows: Sequence[tuple[Vector, Vector, float, float, int, bool, int]], tops: Sequence[float]
) -> Skeleton:
    n = len(rows)
    return Skeleton(
        np.array([r[0] for r in rows], np.float64).reshape(n, 3),
        np.array([r[1] for r in rows], np.float64).reshape(n, 3),
        np.array([r[2] for r in rows], np.float64),
        np.array(tops, np.float64),
        np.array([r[4] for r in rows], np.int64),
        np.array([r[5] for r in rows], np.bool_),
        np.array([r[6] for r in rows], np.int64),
    )


def _leaves(
    leaves: Sequence[tuple[Vector, tuple[Vector, Vector, Vector], float, int]],
) -> Leaves:
    n = len(leaves)
    return Leaves(
        np.array([leaf[0] for leaf in leaves], np.float64).reshape(n, 3),
        np.array([leaf[1] for leaf in leaves], np.float64).reshape(n, 3, 3).transpose(0, 2, 1),
        np.array([leaf[2] for leaf in leaves], np.float64),
        np.array([leaf[3] for leaf in leaves], np.int64),
    )
