"""Materials: what a surface does with light, gathered for a batch of hits.

The diffuse and glossy part of the principled model (Burley 2012): Lambert below a GGX coat.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pcsg.graph.settings import SETTINGS
from pcsg.render.textures import Textures
from pcsg.render.tracer import Floats, Ints
from pcsg.trace.hits import Hits

DEFAULTS = {key: k.default for key, k in SETTINGS["material"].keys.items()}


class Surface(NamedTuple):
    """What is known about N visible points.

    Attributes
    ----------
    position
        (N, 3) world coordinates.
    normal
        (N, 3) unit, towards the viewer, with bumps.
    facing
        (N, 3) unit, towards the viewer, of the geometry: decides on which side of it things are.
    viewer
        (N, 3) unit, towards the eye.
    color, emission
        (N, 3) linear.
    roughness, metallic, specular, translucency
        (N,)
    """

    position: Floats
    normal: Floats
    facing: Floats
    viewer: Floats
    color: Floats
    emission: Floats
    roughness: Floats
    metallic: Floats
    specular: Floats
    translucency: Floats

    def reflect(self, towards: Floats) -> Floats:
        """Return (N, 3) light sent to the eye per irradiance from unit directions, with cosine.

        Light from behind comes through translucent surfaces only.
        """
        cos = _dots(self.normal, towards)
        side = _dots(self.facing, towards)
        lit = np.where(side > 0, np.maximum(cos, 0.0) * (1.0 - self.translucency), 0.0)
        through = np.where(side < 0, np.maximum(-cos, 0.0) * self.translucency, 0.0)
        diffuse = (lit + through) * (1.0 - self.metallic) / np.pi
        gloss = np.where((side > 0) & (cos > 0), 1.0, 0.0)[:, None] * self._gloss(towards, cos)
        return np.asarray(diffuse[:, None] * self.color + gloss)

    def fresnel(self, cos: Floats) -> Floats:
        """Return (N, 3) mirrored shares at the cosines (N,) of incidence (Schlick 1994)."""
        metallic = self.metallic[:, None]
        base = 0.08 * self.specular[:, None] * (1.0 - metallic) + self.color * metallic
        edge = np.clip(1.0 - cos, 0.0, 1.0)[:, None] ** 5
        strength = np.where(self.specular > 0, 1.0, self.metallic)[:, None]
        return np.asarray(base + (strength - base) * edge)

    def _gloss(self, towards: Floats, cos: Floats) -> Floats:
        """Return (N, 3) GGX reflection with cosine (Walter et al. 2007; Hammon 2017)."""
        half = towards + self.viewer
        half /= np.maximum(np.sqrt(_dots(half, half)), 1e-12)[:, None]
        alpha = np.maximum(self.roughness, 0.03) ** 2
        squared = alpha * alpha
        nh = np.maximum(_dots(self.normal, half), 0.0)
        nv = np.maximum(_dots(self.normal, self.viewer), 1e-4)
        nl = np.maximum(cos, 0.0)
        density = squared / (np.pi * (nh * nh * (squared - 1.0) + 1.0) ** 2)
        mixed = 2.0 * nl * nv
        visible = 0.5 / np.maximum(mixed + alpha * (nl + nv - mixed), 1e-9)
        strength = self.fresnel(np.maximum(_dots(self.viewer, half), 0.0))
        return np.asarray((density * visible * nl)[:, None] * strength)


def _dots(a: Floats, b: Floats) -> Floats:
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
    """

    def __init__(
        self,
        several: Sequence[Mapping[str, Any]],
        texture_numbers: Mapping[str, int],
        textures: Textures,
    ) -> None:
        # The last row is the default, which number -1 finds.
        rows = [*several, DEFAULTS]
        self._columns = {
            key: np.array([row[key] for row in rows], dtype=float)
            for key in (
                "color",
                "emission",
                "roughness",
                "metallic",
                "specular",
                "translucency",
                "bump",
            )
        }
        self._texture = np.array(
            [texture_numbers.get(row["texture"] or "", -1) for row in rows], dtype=np.int64
        )
        self._textures = textures

    def gather(self, hits: Hits, at: Ints, directions: Floats) -> Surface:
        """Return the surfaces of hits.

        Parameters
        ----------
        at
            (M,) which of the hits.
        directions
            (N, 3) unit directions of all rays.
        """
        which = hits.material[at]
        viewer = -directions[at]
        position = hits.position[at]
        normal = hits.normal[at]
        normal = np.where(_dots(normal, viewer)[:, None] < 0, -normal, normal)
        columns = {key: values[which] for key, values in self._columns.items()}
        override = hits.color[at]
        overridden = override[:, 0] >= 0
        color = np.where(overridden[:, None], override, columns.pop("color"))
        texture = np.where(hits.texture[at] >= 0, hits.texture[at], self._texture[which])
        bump = columns.pop("bump")
        bumped = normal
        rows = np.flatnonzero(texture >= 0)
        if len(rows):
            number, size = texture[rows], hits.texture_scale[at][rows]
            # A little below the surface: faces may lie on the planes of a pattern's lattice.
            reach = self._textures.scale[number] * size
            inside = position[rows] - 1e-4 * reach[:, None] * hits.normal[at][rows]
            amount = self._textures.amounts(number, inside, size)[:, None]
            first = np.where(overridden[rows, None], override[rows], self._textures.color[number])
            color[rows] = first + amount * (self._textures.color2[number] - first)
            raised = np.flatnonzero(bump[rows] != 0)
            if len(raised):
                bumped = normal.copy()
                at_raised = rows[raised]
                slope = self._textures.relief(number[raised], inside[raised], size[raised])
                # The second colour lies deeper: bark's cracks, marble's veins.
                bumped[at_raised] = _bend(
                    normal[at_raised], slope * bump[at_raised, None], viewer[at_raised]
                )
        return Surface(position, bumped, normal, viewer, color, **columns)


def _bend(normal: Floats, slope: Floats, viewer: Floats) -> Floats:
    """Return unit normals of a surface that sinks with a slope (M, 3), still towards the eye."""
    slope = slope - _dots(slope, normal)[:, None] * normal
    bent = normal + slope
    bent /= np.sqrt(_dots(bent, bent))[:, None]
    away = np.minimum(_dots(bent, viewer) - 1e-3, 0.0)
    bent = bent - away[:, None] * viewer
    return np.asarray(bent / np.sqrt(_dots(bent, bent))[:, None])
