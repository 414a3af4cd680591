"""Materials: what the surfaces that a batch of rays met are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pcsg.graph.settings import LARGEST_COLOR, SETTINGS
from pcsg.render.albedo import Albedo, albedo_tables
from pcsg.render.bsdf import Matter, scatter_batch
from pcsg.render.surfaces import Gathered, gather_hits, make_gathered
from pcsg.render.textures import NORMALS, Textures
from pcsg.render.tracer import Bools, Floats, Ints, Tracer
from pcsg.trace.hits import Hits

DEFAULTS = {key: k.default for key, k in SETTINGS["material"].keys.items()}

PLAIN, UNTINTED = (0.7, 0.7, 0.7), (1.0, 1.0, 1.0)
"""What a material without a colour has, and what its texture is multiplied by."""

_NUMBERS = (
    "color",
    "emission",
    "roughness",
    "metallic",
    "specular",
    "transmission",
    "translucency",
    "ior",
    "bump",
)


class Scattered(NamedTuple):
    """What N surfaces do with light.

    Attributes
    ----------
    direction
        (N, 3) unit.
    light
        (N, 3) light to the viewer per irradiance on a surface that faces the direction.
    density
        (N,) with which the direction is drawn, per solid angle.
    """

    direction: Floats
    light: Floats
    density: Floats


class Surface(NamedTuple):
    """What is known about N visible points.

    Attributes
    ----------
    position
        (N, 3) world coordinates.
    emission
        (N, 3) linear.
    matter
        What scatters the light.
    number
        (N,) of the material.
    """

    position: Floats
    emission: Floats
    matter: Matter
    number: Ints

    def take(self, rows: Ints) -> Surface:
        """Return some of the points."""
        return Surface(
            self.position[rows],
            self.emission[rows],
            Matter._make(column[rows] for column in self.matter),
            self.number[rows],
        )

    def roughened(self, least: Floats) -> Surface:
        """Return the points with at least these roughnesses (N,)."""
        rough = np.maximum(self.matter.roughness, least)
        return self._replace(matter=self.matter._replace(roughness=rough))

    def _tables(self) -> Albedo:
        return albedo_tables(bool((self.matter.transmission > 0).any()))

    def scatter(self, pairs: Floats, choices: Floats) -> Scattered:
        """Draw directions by pairs and choices (N, 2) in [0, 1)."""
        n = len(pairs)
        found = Scattered(np.empty((n, 3)), np.empty((n, 3)), np.empty(n))
        scatter_batch(self.matter, self._tables(), True, pairs, choices, *found)
        return found

    def reflect(self, towards: Floats) -> Scattered:
        """Return what surfaces do with light from unit directions (N, 3)."""
        n = len(towards)
        found = Scattered(np.array(towards), np.empty((n, 3)), np.empty(n))
        scatter_batch(self.matter, self._tables(), False, _NO_PAIRS, _NO_PAIRS, *found)
        return found

    def fresnel(self, cos: Floats) -> Floats:
        """Return (N, 3) mirrored shares at the cosines (N,) of incidence (Schlick 1994)."""
        m = self.matter
        metallic = m.metallic[:, None]
        base = 0.08 * m.specular[:, None] * (1.0 - metallic) + m.color * metallic
        squared = np.square(np.clip(1.0 - cos, 0.0, 1.0))
        edge = (squared * squared * np.clip(1.0 - cos, 0.0, 1.0))[:, None]
        strength = np.where(m.specular > 0, 1.0, m.metallic)[:, None]
        return np.asarray(base + (strength - base) * edge)


_NO_PAIRS = np.empty((0, 2))


def largest(v: Floats) -> Floats:
    """Return the (N,) greatest numbers of vectors (N, 3); reducing an axis of three is slow."""
    return np.asarray(np.maximum(np.maximum(v[:, 0], v[:, 1]), v[:, 2]))


def dots(a: Floats, b: Floats) -> Floats:
    """Return the (N,) products of vectors (N, 3)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


class Materials:
    """The materials of a scene.

    Parameters
    ----------
    several
        Settings ``material NAME {}`` in the order of the text.
    texture_numbers
        Number of every texture.
    textures
        The textures themselves.
    sheets
        (L,) which leaves of the graph have no inside.
    """

    def __init__(
        self,
        several: Sequence[Mapping[str, Any]],
        texture_numbers: Mapping[str, int],
        textures: Textures,
        sheets: Bools,
    ) -> None:
        # The last row is the default, which number -1 finds.
        rows = [*several, DEFAULTS]
        colors = [row["color"] for row in rows]
        rows = [{**row, "color": c or PLAIN} for row, c in zip(rows, colors, strict=True)]
        self._columns = {key: np.array([row[key] for row in rows], dtype=float) for key in _NUMBERS}
        self._tints = np.array([c or UNTINTED for c in colors])
        self._table = np.column_stack(list(self._columns.values()))
        texture = [texture_numbers.get(row["texture"] or "", -1) for row in rows]
        relief = [texture_numbers.get(row["relief"] or "", -1) for row in rows]
        self._texture = np.array(texture, dtype=np.int64)
        self._relief = np.array(relief, dtype=np.int64)
        self._textures = textures
        # Leaves with negative numbers, such as the ground, are no sheets.
        self._sheets = np.append(sheets, [False, False])

    @property
    def shine(self) -> bool:
        """Whether one of them does."""
        return bool((self._columns["emission"] > 0.0).any())

    def emission(self, numbers: Ints) -> Floats:
        """Return (N, 3) light that surfaces of materials (N,) send out; -1 is the default."""
        return np.asarray(self._columns["emission"][numbers])

    def strengths(self) -> Floats:
        """Return (M,) how much every material shines, averaged over the colours."""
        return np.asarray(self._columns["emission"][:-1].mean(axis=1))

    def gather(self, hits: Hits, at: Ints, directions: Floats, tracer: Tracer) -> Surface:
        """Return the surfaces of hits.

        Parameters
        ----------
        at
            (M,) which of the hits.
        directions
            (M, 3) unit directions of their rays.
        tracer
            Who finds the surface coordinates beside a point, for pictures that are reliefs.
        """
        which = hits.material[at]
        found = make_gathered(len(at))
        gather_hits(
            at,
            hits.position,
            hits.normal,
            hits.leaf,
            hits.material,
            hits.color,
            np.ascontiguousarray(directions),
            self._table,
            self._sheets,
            found,
        )
        normal = found.facing
        if len(self._textures.scale):
            normal = self._textured(hits, at, which, found, tracer)
        seen = (normal, found.facing, found.viewer, found.color)
        matter = Matter._make([*seen, *found.numbers, found.eta, found.sheet])
        return Surface(found.position, found.emission, matter, which)

    def _textured(
        self, hits: Hits, at: Ints, which: Ints, known: Gathered, tracer: Tracer
    ) -> Floats:
        """Write textures' colours, and return the shading normals (M, 3)."""
        outward, facing, color = known.outward, known.facing, known.color
        override = hits.color[at]
        overridden = override[:, 0] >= 0
        override = np.clip(override, 0.0, LARGEST_COLOR)
        texture = np.where(hits.texture[at] >= 0, hits.texture[at], self._texture[which])
        relief = np.where(self._relief[which] >= 0, self._relief[which], texture)
        size = hits.texture_scale[at]
        # A little below the surface: faces may lie on the planes of a pattern's lattice.
        used = np.maximum(texture, relief)
        depth = 1e-4 * np.where(used >= 0, np.append(self._textures.scale, 1.0)[used], 0.0) * size
        inside = known.position - depth[:, None] * outward
        rows = np.flatnonzero(texture >= 0)
        if len(rows):
            number = texture[rows]
            found = self._colors(hits, at[rows], number, inside[rows], size[rows])
            tint = np.where(overridden[rows, None], 1.0, self._tints[which[rows]])
            found *= tint
            given = np.flatnonzero(overridden[rows])
            if len(given):
                found[given] = self._tinted(
                    number[given],
                    override[rows[given]],
                    found[given],
                    inside[rows[given]],
                    hits.uv[at[rows[given]]],
                    size[rows[given]],
                )
            color[rows] = found
        raised = np.flatnonzero((relief >= 0) & (known.bump != 0))
        if len(raised) == 0:
            return facing
        slope = self._slopes(hits, at[raised], relief[raised], inside[raised], tracer)
        normal = facing.copy()
        normal[raised] = _bend(
            facing[raised], slope * known.bump[raised, None], known.viewer[raised]
        )
        return normal

    def _colors(self, hits: Hits, at: Ints, number: Ints, inside: Floats, size: Floats) -> Floats:
        """Return textures' colours; where parts of a leaf blend, so do their pictures."""
        found = self._textures.colors(number, inside, hits.uv[at], size)
        pictures = np.flatnonzero(self._textures.is_on_surface(number))
        if len(pictures):
            others = hits.other_uv[at[pictures]]
            strongest = found[pictures]
            for k in range(others.shape[1]):
                mixed = np.flatnonzero(others[:, k, 2] > 0.0)
                rows = pictures[mixed]
                uv, share = others[mixed, k, :2], others[mixed, k, 2:]
                other = self._textures.colors(number[rows], inside[rows], uv, size[rows])
                found[rows] += share * (other - strongest[mixed])
        return found

    def _tinted(
        self,
        number: Ints,
        override: Floats,
        found: Floats,
        inside: Floats,
        uv: Floats,
        size: Floats,
    ) -> Floats:
        """Return textures' colours under a colour of the grammar.

        It takes the place of a pattern's first colour, and tints a picture or a palette.
        """
        amount = self._textures.amounts(number, inside, uv, size)[:, None]
        pattern = override + amount * (self._textures.color2[number] - override)
        picture = self._textures.has_colors(number)[:, None]
        return np.where(picture, override * found, pattern)

    def _slopes(self, hits: Hits, at: Ints, relief: Ints, inside: Floats, tracer: Tracer) -> Floats:
        """Return (N, 3) vectors along which reliefs sink, with their steepness."""
        size = hits.texture_scale[at]
        slope = self._textures.relief(relief, inside, hits.uv[at], size)
        on_surface = self._textures.is_on_surface(relief)
        for number in np.unique(relief[on_surface]):
            rows = np.flatnonzero(relief == number)
            along = self._textures.slopes(number, hits.uv[at[rows]], size[rows])
            across = _coordinates(hits, at[rows], tracer)
            if self._textures.kind[number] == NORMALS:
                # Normals are tilted towards u and v, whatever their lengths on the surface.
                length = np.sqrt(np.square(across).sum(axis=2, keepdims=True))
                across = across / np.maximum(length, 1e-300)
            slope[rows] = -(along[:, :, None] * across).sum(axis=1)
            # Reliefs of parts that blend end where these change places.
            shares = hits.other_uv[at[rows], :, 2]
            strongest = 1.0 - shares.sum(axis=1)
            slope[rows] *= (1.0 - shares[:, 0] / strongest)[:, None]
        return slope


def _coordinates(hits: Hits, at: Ints, tracer: Tracer) -> Floats:
    """Return (N, 2, 3) gradients of the surface coordinates u and v along the surface.

    They are found by two more rays, which meet the surface beside each point. Where they meet
    something else the gradients are zero: the surface counts as flat.
    """
    position, normal = hits.position[at], hits.normal[at]
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normal, helper)
    first /= np.sqrt(dots(first, first))[:, None]
    step = 1e-5 * np.maximum(largest(np.abs(position)), hits.t[at])[:, None]
    gradient = np.zeros((len(at), 2, 3))
    fine = np.ones(len(at), dtype=bool)
    for axis in (first, np.cross(normal, first)):
        above = position + step * (axis + normal)
        beside = tracer.intersect(above, -normal, 0.0, 2.0 * step[:, 0])
        fine &= beside.leaf == hits.leaf[at]
        change = beside.uv - hits.uv[at]
        # Coordinates that go round jump by 1.
        change = (change - np.round(change)) / step
        gradient += change[:, :, None] * axis[:, None, :]
    return np.where(fine[:, None, None], gradient, 0.0)


def _bend(normal: Floats, slope: Floats, viewer: Floats) -> Floats:
    """Return unit normals of a surface that sinks with a slope (M, 3).

    They face the viewer, and mirror nothing from below the surface: where they would, they are
    turned back towards the geometry.
    """
    slope = slope - dots(slope, normal)[:, None] * normal
    bent = normal + slope
    bent /= np.sqrt(dots(bent, bent))[:, None]
    for _ in range(4):
        cos = dots(bent, viewer)
        mirrored = 2.0 * cos * dots(bent, normal) - dots(viewer, normal)
        wrong = (cos < 1e-3) | (mirrored < 1e-3)
        bent[wrong] = 0.5 * (bent[wrong] + normal[wrong])
        bent /= np.sqrt(dots(bent, bent))[:, None]
    cos = dots(bent, viewer)
    mirrored = 2.0 * cos * dots(bent, normal) - dots(viewer, normal)
    return np.where(((cos < 1e-3) | (mirrored < 1e-3))[:, None], normal, bent)
