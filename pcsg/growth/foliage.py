"""Leaves as sheets: blades folded along their midribs, on petioles, as one mesh.

They stand outside of the wood's field (Galbraith, Muendermann, Wyvill 2004, section 7).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcsg.growth.chance import TURN, derive, mix, uniform
from pcsg.growth.species import LeafForm
from pcsg.growth.state import State
from pcsg.meshfile.mesh import Mesh, offsets_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Blades of length 1 along x: place along, half width, of the edge on one side. The width is that of
# a blade as wide as long.
_OUTLINES = {
    "deltoid": ((0.10, 0.47), (0.46, 0.37)),
    "oval": ((0.24, 0.45), (0.66, 0.41)),
}

_FOLD = 0.35
"""How far the edges stand above the midrib, per unit of width."""

_ARCH = 0.10
"""How far the tip hangs below the line of the petiole, in lengths."""

_PETIOLE_WIDTH = 0.012
_TURN = 0.7
"""Greatest turn of a blade about its petiole, in radians."""

_NEEDLES = 9
_LEAST_COLOUR, _MOST_COLOUR = 0.75, 1.3
"""Leaves are not all of one brightness."""


def foliage_mesh(state: State) -> Mesh:
    """Return the leaves of a tree; corners have colours.

    Without a leaf, one triangle of no size stands inside of the trunk's foot: a mesh cannot be
    empty.
    """
    form = state.species.leaf
    leaves = state.leaves
    if not len(leaves.size):
        point = np.array([[0.0, 0.0, 0.0], [1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0]])
        return Mesh(point, np.arange(3), offsets_of([3]))
    local, triangles = _needles(form) if form.form == "needle" else _blade(form)
    x, y, z = _frames(state)
    size = leaves.size[:, None, None]
    verts = (
        local[:, 0, None] * x[:, None]
        + local[:, 1, None] * y[:, None]
        + local[:, 2, None] * z[:, None]
    ) * size + leaves.position[:, None]
    n, v = verts.shape[:2]
    corners = (np.arange(n)[:, None, None] * v + triangles).ravel()
    colours = np.repeat(_colours(state), 3 * len(triangles), axis=0)
    counts = np.full(n * len(triangles), 3)
    return Mesh(verts.reshape(-1, 3), corners, offsets_of(counts), corner_colors=colours)


def _blade(form: LeafForm) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (f, 3) of a leaf of size 1: x along, z up."""
    stalk = form.petiole / form.length
    outline = _OUTLINES[form.form]
    along = np.array([x for x, _ in outline])
    half = form.width * np.array([w for _, w in outline])
    rib = np.array([0.0, 0.45, 1.0])

    def sag(x: Floats) -> Floats:
        return np.asarray(-_ARCH * x * x)

    verts = [np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]) * _PETIOLE_WIDTH]
    verts.append(np.stack([stalk + rib, 0.0 * rib, sag(rib)], axis=1))
    verts += [
        np.stack([stalk + along, side * half, sag(along) + _FOLD * half], axis=1)
        for side in (-1.0, 1.0)
    ]
    base, middle, tip = 2, 3, 4
    triangles = [[0, base, 1]]
    for first in (5, 7):
        half_blade = [[base, first, middle], [first, first + 1, middle], [first + 1, tip, middle]]
        triangles += half_blade if first == 5 else [[i, k, j] for i, j, k in half_blade]
    return np.concatenate(verts), np.array(triangles)


def _needles(form: LeafForm) -> tuple[Floats, Ints]:
    """Return the tuft of needles of a metamer, all around the shoot: x outwards, z along it."""
    verts, triangles = [], []
    for k in range(_NEEDLES):
        angle = 2.0 * np.pi * k / _NEEDLES
        out = np.array([np.cos(angle), np.sin(angle), 0.9])
        out /= np.linalg.norm(out)
        across = np.cross(out, [0.0, 0.0, 1.0])
        across *= 0.5 * form.width / np.linalg.norm(across)
        foot = np.array([0.0, 0.0, -0.8 * k / _NEEDLES])
        verts += [foot - across, foot + across, foot + out]
        triangles.append([3 * k, 3 * k + 1, 3 * k + 2])
    return np.array(verts), np.array(triangles)


def _frames(state: State) -> tuple[Floats, Floats, Floats]:
    """Return along, across and up of every leaf (n, 3)."""
    form, leaves = state.species.leaf, state.leaves
    if form.form == "needle":
        return leaves.outward, np.cross(leaves.axis, leaves.outward), leaves.axis
    angle, droop = np.radians(form.angle), np.tan(np.radians(form.droop))
    along = np.cos(angle) * leaves.axis + np.sin(angle) * leaves.outward
    along = _unit(along - droop * np.array([0.0, 0.0, 1.0]))
    across = np.cross(np.array([0.0, 0.0, 1.0]), along)
    level = np.linalg.norm(across, axis=1, keepdims=True)
    spare = np.cross(leaves.axis, leaves.outward)
    across = _unit(np.where(level > 1e-3, across, spare))
    up = np.cross(along, across)
    turn = (_TURN * (2.0 * uniform(derive(leaves.key, TURN)) - 1.0))[:, None]
    return (
        along,
        np.cos(turn) * across + np.sin(turn) * up,
        np.cos(turn) * up - np.sin(turn) * across,
    )


def _colours(state: State) -> Floats:
    form, leaves = state.species.leaf, state.leaves
    autumn = leaves.autumn[:, None]
    colour = (1.0 - autumn) * np.array(form.green) + autumn * np.array(form.autumn)
    key = derive(leaves.key, TURN + 1)
    bright = _LEAST_COLOUR + (_MOST_COLOUR - _LEAST_COLOUR) * uniform(key)
    ripe = 0.85 + 0.3 * uniform(mix(key))
    return np.asarray(np.clip(colour * np.stack([bright * ripe, bright, bright], axis=1), 0.0, 1.0))


def _unit(v: Floats) -> Floats:
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
