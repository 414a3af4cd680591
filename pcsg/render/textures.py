"""Textures: patterns of space, and pictures on surfaces.

A pattern says how much of the second colour there is at a point. Patterns are solid: cut from a
block, so they need no surface coordinates. Lengths are in periods of the pattern. A picture lies on
the surface coordinates (u, v) and repeats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.graph.settings import SETTINGS
from pcsg.jit import njit
from pcsg.render.noise import fill_cells, fractal_noise, noise, stir
from pcsg.render.pictures import Pixels, read_linear, read_values
from pcsg.render.tracer import Bools, Floats, Ints

KINDS = SETTINGS["texture"].keys["kind"].words
GRADIENT, CELLS = KINDS.index("gradient"), KINDS.index("cells")

ALONG = SETTINGS["texture"].keys["along"].words
SPACE, UV = ALONG.index("space"), ALONG.index("uv")

_AXIS = {"space": 2, "x": 0, "y": 1, "z": 2, "u": 3, "v": 4, "uv": 4}
"""Which of x, y, z, u, v a gradient follows."""

_COORDINATES = np.array([_AXIS[word] for word in ALONG])
_FLAT = ("checker", "waves")
"""Patterns of flat coordinates; others go round a tube, so that they close."""


_CRESTS = 24


@njit
def _waves(x: float, y: float) -> float:
    """Return the height of a wind sea at rest: long-crested waves, most along x.

    Lengths fall from 1 to 1/16 by the golden ratio's steps, so that nothing repeats; heights fall a
    little faster than lengths, as in a spectrum of a sea under wind.
    """
    total, height = 0.0, 0.0
    for k in range(_CRESTS):
        share = k / (_CRESTS - 1.0)
        length = 0.0625**share
        spread = (k * 0.6180339887498949) % 1.0 - 0.5
        angle = spread * (1.2 + 1.2 * share)
        phase = 2.0 * math.pi * ((k * 0.7548776662466927) % 1.0)
        along = (x * math.cos(angle) + y * math.sin(angle)) / length
        total += length**1.1 * math.sin(2.0 * math.pi * along + phase)
        height += length**1.1
    # Deviations add like noise, so the sum rarely leaves a part of its range.
    return min(max(0.5 + 1.2 * total / height, 0.0), 1.0)


@njit
def pattern(kind: int, x: float, y: float, z: float) -> float:
    """Return the amount of the second colour, in [0, 1]."""
    if kind == 1:
        return float(int(math.floor(x) + math.floor(y) + math.floor(z)) & 1)
    if kind == 2:
        vein = math.sin(2.0 * math.pi * (x + 1.6 * fractal_noise(x, y, z, 5)))
        return (1.0 - abs(vein)) ** 3
    if kind == 3:
        bend = 0.35 * noise(0.7 * x, 0.7 * y, 0.2 * z)
        ring = 4.0 * (math.sqrt(x * x + y * y) + bend)
        ring -= math.floor(ring)
        grain = 0.2 * noise(24.0 * x, 24.0 * y, 1.5 * z)
        return min(max(ring * ring * (1.0 - 0.6 * ring**6) * 1.3 + grain, 0.0), 1.0)
    if kind == 5:
        return _waves(x, y)
    if kind == 4:
        wave = 0.6 * fractal_noise(1.5 * x, 1.5 * y, 0.4 * z, 3)
        ridge = abs(fractal_noise(5.0 * x + wave, 5.0 * y - wave, 1.1 * z, 4))
        fine = 0.15 * noise(23.0 * x, 23.0 * y, 9.0 * z)
        return min(max(1.0 - 4.5 * ridge + fine, 0.0), 1.0)
    return min(max(0.5 + 0.9 * fractal_noise(x, y, z, 5), 0.0), 1.0)


@njit(entry=True)
def evaluate(kinds: Ints, points: Floats, values: Floats) -> None:
    """Write the pattern of each kind (N,) at each point (N, 3) to values (N,)."""
    for k in range(len(kinds)):
        values[k] = pattern(kinds[k], points[k, 0], points[k, 1], points[k, 2])


@dataclass(frozen=True)
class Textures:
    """The textures of a scene.

    Attributes
    ----------
    kind
        (K,) position in `KINDS`.
    color, color2
        (K, 3) first and second colour.
    scale
        (K,) size of the pattern in world units, of a picture in (u, v).
    pictures
        By number: (H, W, 3) pixels of the kinds image, linear, and normals, as they are.
    along
        (K,) position in `ALONG`: what the pattern follows.
    turbulence
        (K,) how far the pattern is stirred, in periods.
    palettes
        By number: (S,) amounts and (S, 3) colours, in place of two colours.
    """

    kind: Ints
    color: Floats
    color2: Floats
    scale: Floats
    pictures: Mapping[int, Pixels]
    along: Ints
    turbulence: Floats
    palettes: Mapping[int, tuple[Floats, Floats]]

    @classmethod
    def of(
        cls, several: Sequence[Mapping[str, Any]], palettes: Sequence[Mapping[str, Any]] = ()
    ) -> Textures:
        """Return the textures of settings ``texture NAME {}`` and ``palette NAME {}``.

        Raises
        ------
        UsageError
            A picture is not given, or is none.
        EnvironmentFault
            A picture cannot be read.
        """
        return cls(
            np.array([KINDS.index(v["kind"]) for v in several], dtype=np.int64),
            np.array([v["color"] for v in several], dtype=float).reshape(-1, 3),
            np.array([v["color2"] for v in several], dtype=float).reshape(-1, 3),
            np.array([v["scale"] for v in several], dtype=float),
            {k: _read(v) for k, v in enumerate(several) if v["kind"] in ("image", "normals")},
            np.array([ALONG.index(v["along"]) for v in several], dtype=np.int64),
            np.array([v["turbulence"] for v in several], dtype=float),
            _palettes(several, palettes),
        )

    def is_picture(self, which: Ints) -> Bools:
        """Return (N,) which textures are pictures."""
        return np.asarray((self.kind[which] == IMAGE) | (self.kind[which] == NORMALS))

    def is_on_surface(self, which: Ints) -> Bools:
        """Return (N,) which textures lie on surface coordinates."""
        return np.asarray(self.is_picture(which) | _ON_SURFACE[self.along[which]])

    def has_colors(self, which: Ints) -> Bools:
        """Return (N,) which textures have colours of their own, which others only tint."""
        found = self.is_picture(which)
        for number in self.palettes:
            found |= which == number
        return found

    def colors(self, which: Ints, position: Floats, uv: Floats, size: Floats) -> Floats:
        """Return (N, 3) colours at world positions (N, 3) with surface coordinates (N, 2).

        Parameters
        ----------
        which
            (N,) numbers of textures.
        size
            (N,) scales from the grammar, on top of the textures' own.
        """
        amount = self.amounts(which, position, uv, size)
        first = self.color[which]
        found = first + amount[:, None] * (self.color2[which] - first)
        for number, (stops, colors) in self.palettes.items():
            rows = np.flatnonzero(which == number)
            for k in range(3):
                found[rows, k] = np.interp(amount[rows], stops, colors[:, k])
        for number in self.pictures:
            rows = np.flatnonzero((which == number) & (self.kind[which] == IMAGE))
            if len(rows):
                found[rows] = self.look_up(number, uv[rows], size[rows])
        return np.asarray(found)

    def look_up(self, number: int, uv: Floats, size: Floats) -> Floats:
        """Return (N, 3) values of a picture at surface coordinates (N, 2): the mean of four."""
        pixels = self.pictures[number]
        height, width = pixels.shape[:2]
        scale = self.scale[number] * size
        x = uv[:, 0] / scale * width - 0.5
        y = -uv[:, 1] / scale * height - 0.5
        left, top = np.floor(x), np.floor(y)
        s, t = (x - left)[:, None], (y - top)[:, None]
        columns = [(left.astype(np.int64) + k) % width for k in (0, 1)]
        rows = [(top.astype(np.int64) + k) % height for k in (0, 1)]
        upper = (1 - s) * pixels[rows[0], columns[0]] + s * pixels[rows[0], columns[1]]
        lower = (1 - s) * pixels[rows[1], columns[0]] + s * pixels[rows[1], columns[1]]
        return np.asarray((1 - t) * upper + t * lower)

    def amounts(self, which: Ints, position: Floats, uv: Floats, size: Floats) -> Floats:
        """Return (N,) amounts of the second colour at world positions (N, 3), or on (u, v)."""
        period = self.scale[which] * size
        points = np.ascontiguousarray(position / period[:, None])
        along, kind = self.along[which], self.kind[which]
        rows = np.flatnonzero(along == UV)
        if len(rows):
            flat = np.isin(kind[rows], [KINDS.index(word) for word in _FLAT])
            points[rows] = _on_surface(uv[rows], flat) / period[rows, None]
        rows = np.flatnonzero((kind == GRADIENT) & (_COORDINATES[along] > 2))
        if len(rows):
            points[rows, 2] = uv[rows, _COORDINATES[along[rows]] - 3] / period[rows]
        stirred = self.turbulence[which]
        if stirred.any():
            stir(points, stirred)
        values = np.empty(len(which))
        rows = np.flatnonzero(kind < GRADIENT)
        if len(rows) == len(which):
            evaluate(kind, points, values)
            return values
        if len(rows):
            some = np.empty(len(rows))
            evaluate(kind[rows], points[rows], some)
            values[rows] = some
        rows = np.flatnonzero(kind == GRADIENT)
        axis = np.minimum(_COORDINATES[along[rows]], 2)
        values[rows] = np.clip(points[rows, axis], 0.0, 1.0)
        rows = np.flatnonzero(kind == CELLS)
        if len(rows):
            some = np.empty(len(rows))
            fill_cells(points[rows], some)
            values[rows] = some
        return values

    def relief(self, which: Ints, position: Floats, uv: Floats, size: Floats) -> Floats:
        """Return (N, 3) gradients of the pattern, per period of the pattern."""
        step = 1e-3 * self.scale[which] * size
        middle = self.amounts(which, position, uv, size)
        slopes = [
            self.amounts(which, position + step[:, None] * axis, uv, size) - middle
            for axis in np.eye(3)
        ]
        return np.stack(slopes, axis=1) / 1e-3

    def slopes(self, number: int, uv: Floats, size: Floats) -> Floats:
        """Return (N, 2) slopes of the relief of a picture along u and v.

        Of a picture of normals, as it says: red along u, green along v, blue upwards. Of any other,
        the differences of its brightness, in the picture's widths.
        """
        if self.kind[number] == NORMALS:
            tilt = 2.0 * self.look_up(number, uv, size) - 1.0
            return np.asarray(-tilt[:, :2] / np.maximum(tilt[:, 2:], 0.05))
        if number not in self.pictures:
            return self._pattern_slopes(number, uv, size)
        step = self.scale[number] * size / max(self.pictures[number].shape)
        found = []
        for axis in np.eye(2):
            shift = step[:, None] * axis
            ahead = self.look_up(number, uv + shift, size).mean(axis=1)
            behind = self.look_up(number, uv - shift, size).mean(axis=1)
            found.append((ahead - behind) / (2.0 * step))
        # Lower is darker, while in patterns the second colour lies deeper.
        return np.stack(found, axis=1)

    def _pattern_slopes(self, number: int, uv: Floats, size: Floats) -> Floats:
        """Return (N, 2) slopes of a pattern that lies on the surface, as of a picture."""
        which, nowhere = np.full(len(uv), number), np.zeros((len(uv), 3))
        found = []
        for axis in np.eye(2):
            shift = 1e-3 * self.scale[number] * size[:, None] * axis
            ahead, behind = (
                self.amounts(which, nowhere, uv + way * shift, size) for way in (1.0, -1.0)
            )
            found.append((behind - ahead) / 2e-3)
        return np.stack(found, axis=1)


_ON_SURFACE = np.array([word in ("u", "v", "uv") for word in ALONG])


def _on_surface(uv: Floats, flat: Bools) -> Floats:
    """Return (N, 3) places of a pattern: on a tube that u goes round once, or on a plane."""
    turn = 2.0 * math.pi * uv[:, 0]
    radius = 1.0 / (2.0 * math.pi)
    tube = np.stack([radius * np.cos(turn), radius * np.sin(turn), uv[:, 1]], axis=1)
    plane = np.stack([uv[:, 0], uv[:, 1], np.zeros(len(uv))], axis=1)
    return np.where(flat[:, None], plane, tube)


def _palettes(
    several: Sequence[Mapping[str, Any]], palettes: Sequence[Mapping[str, Any]]
) -> dict[int, tuple[Floats, Floats]]:
    """Return the stops of textures that have a palette, by number of the texture."""
    stops = {values["name"]: np.reshape(values["stops"], (-1, 4)) for values in palettes}
    found = {k: values["palette"] for k, values in enumerate(several)}
    return {
        k: (stops[name][:, 0], stops[name][:, 1:]) for k, name in found.items() if name is not None
    }


IMAGE, NORMALS = KINDS.index("image"), KINDS.index("normals")


def _read(values: Mapping[str, Any]) -> Pixels:
    if values["file"] is None:
        raise UsageError(f"a texture of kind `{values['kind']}` needs a `file`")
    path = Path(values["file"])
    return read_values(path) if values["kind"] == "normals" else read_linear(path)
