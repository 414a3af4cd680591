"""How a surface scatters light: the principled model's formulas, one kernel for a batch.

Three kinds of matter are mixed by `metallic` and `transmission`: metal, glass, and a coated matt
surface which may let light through (`translucency`). All gloss is GGX with Smith's masking of both
directions (Walter et al. 2007; Heitz 2014), drawn by visible normals (Dupuy and Benyoub 2023).
Light that single scattering loses on rough metal comes back as in Kulla and Conty 2017, on rough
glass in the directions of the rest (Turquin 2019), and what a coat does not reflect is left for the
matt base, so that a white surface in white light is white.

Directions are in the frame of the shading normal, +z, unit and away from the surface: v to the
viewer, w to the light, h halfway.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pcsg.jit import njit
from pcsg.render.albedo import (
    GLASSES,
    Albedo,
    glass_row,
    mean_at,
    place_at,
    share_at,
    share_of,
)
from pcsg.render.facets import MIN_ALPHA, fresnel, ggx, reach, refract, schlick, visible_normal
from pcsg.render.tracer import Bools, Floats
from pcsg.vec import Vec3, dot, normalize


class Matter(NamedTuple):
    """What N surface points are made of.

    Attributes
    ----------
    normal, facing, viewer
        (N, 3) unit: shading normal and geometric normal, both towards the viewer; to the viewer.
    color
        (N, 3)
    roughness, metallic, specular, transmission, translucency
        (N,)
    eta
        (N,) index of refraction behind the surface, as the viewer sees it, over that before it.
    sheet
        (N,) whether the surface has no inside, so that light goes straight through.
    """

    normal: Floats
    facing: Floats
    viewer: Floats
    color: Floats
    roughness: Floats
    metallic: Floats
    specular: Floats
    transmission: Floats
    translucency: Floats
    eta: Floats
    sheet: Bools


@njit
def _regain(x: _Mix, a: Albedo, vz: float) -> float:
    """Return by how much rough glass must be brighter to lose nothing (Turquin 2019)."""
    if x.thin:
        share = share_at(a.low, x.roughness, vz) + share_at(a.high, x.roughness, vz)
        return 1.0 / max(share, 1e-3)
    inside, row = glass_row(x.eta)
    k = min(int(row), GLASSES - 2)
    near = share_at(a.glass[inside, k], x.roughness, vz)
    far = share_at(a.glass[inside, k + 1], x.roughness, vz)
    return 1.0 / max(near + (row - k) * (far - near), 1e-3)


class _Mix(NamedTuple):
    """One point's matter as numbers: weights of the kinds, and what the formulas need of them."""

    red: float
    green: float
    blue: float
    metal: float
    coated: float
    glass: float
    roughness: float
    alpha: float
    base: float
    edge: float
    through: float
    eta: float
    thin: bool


@njit
def _mix_at(m: Matter, i: int) -> _Mix:
    metal = m.metallic[i]
    glass = (1.0 - metal) * m.transmission[i]
    roughness = min(max(m.roughness[i], 0.0), 1.0)
    return _Mix(
        m.color[i, 0],
        m.color[i, 1],
        m.color[i, 2],
        metal,
        1.0 - metal - glass,
        glass,
        roughness,
        max(roughness * roughness, MIN_ALPHA),
        0.08 * m.specular[i],
        1.0 if m.specular[i] > 0.0 else 0.0,
        m.translucency[i],
        m.eta[i],
        m.sheet[i],
    )


@njit
def _brightness(x: _Mix) -> float:
    return (x.red + x.green + x.blue) / 3.0


class _Shares(NamedTuple):
    """What gloss sends back at a cosine: the parts that go with F0 and with F90."""

    low: float
    high: float


@njit
def _shares_at(x: _Mix, a: Albedo, cosine: float) -> _Shares:
    at = place_at(a.low, x.roughness, cosine)
    return _Shares(share_of(a.low, at), share_of(a.high, at))


@njit
def _coat(x: _Mix, shares: _Shares) -> float:
    """Return what a coat reflects."""
    return x.base * shares.low + x.edge * shares.high


@njit
def _lobes(x: _Mix, shares: _Shares) -> tuple[float, float, float]:
    """Return how likely a scattered ray is glossy, matt, or matt on the far side.

    By what gloss sends back to the viewer.
    """
    low, high = shares
    tone = _brightness(x)
    base = x.coated * (1.0 - x.base * low - x.edge * high) * tone
    gloss = x.metal * (tone * low + high) + x.coated * (x.base * low + x.edge * high) + x.glass
    matt = base * (1.0 - x.through) + x.metal * (1.0 - low - high) * tone * tone
    far = base * x.through
    total = gloss + matt + far
    if total <= 0.0:
        return 0.0, 0.0, 0.0
    return gloss / total, matt / total, far / total


@njit
def _split(x: _Mix, cosine: float) -> tuple[float, float]:
    """Return how much light a facet mirrors and refracts, averaged over the colours."""
    f = 0.0
    if x.glass > 0.0:
        f = fresnel(cosine, x.eta)
    mirrored = x.metal * schlick(_brightness(x), 1.0, cosine)
    mirrored += x.coated * schlick(x.base, x.edge, cosine) + x.glass * f
    return mirrored, x.glass * (1.0 - f)


@njit
def _lost(x: _Mix, mean: float, to_viewer: _Shares, from_light: _Shares) -> float:
    """Return what scatters several times on rough metal (Kulla and Conty 2017).

    By what gloss sends back to the viewer, from the light, and on average.
    """
    if x.metal <= 0.0 or mean >= 1.0:
        return 0.0
    viewer = 1.0 - to_viewer.low - to_viewer.high
    light = 1.0 - from_light.low - from_light.high
    return viewer * light / (math.pi * (1.0 - mean))


@njit
def _repeated(mean: float, tone: float) -> float:
    """Return how a metal colours light that it reflects several times."""
    fresnel = (20.0 * tone + 1.0) / 21.0
    return fresnel * fresnel * mean / (1.0 - fresnel * (1.0 - mean))


@njit
def _evaluate(
    x: _Mix, a: Albedo, v: Vec3, w: Vec3, to_viewer: _Shares
) -> tuple[float, float, float, float]:
    """Return the light towards v per irradiance from w, with cosine, and the density of w."""
    gloss, matt, far = _lobes(x, to_viewer)
    squared = x.alpha * x.alpha
    cosine = abs(w.z)
    from_light = _shares_at(x, a, cosine)
    glass = x.glass * _regain(x, a, v.z) if x.glass > 0.0 else 0.0
    red, green, blue, density = 0.0, 0.0, 0.0, 0.0
    # The matt base below the coat, on either side.
    passed = x.coated * cosine * (1.0 - _coat(x, to_viewer)) * (1.0 - _coat(x, from_light))
    passed /= math.pi
    mean_low, mean_high = mean_at(a.mean_low, x.roughness), mean_at(a.mean_high, x.roughness)
    passed /= max(1.0 - x.base * mean_low - x.edge * mean_high, 1e-9)
    if w.z > 0.0:
        passed *= 1.0 - x.through
        mean = mean_low + mean_high
        lost = x.metal * cosine * _lost(x, mean, to_viewer, from_light)
        red = passed * x.red + lost * _repeated(mean, x.red)
        green = passed * x.green + lost * _repeated(mean, x.green)
        blue = passed * x.blue + lost * _repeated(mean, x.blue)
        density = matt * cosine / math.pi
        # Facets that mirror.
        h = normalize(Vec3(v.x + w.x, v.y + w.y, v.z + w.z))
        vh = dot(v, h)
        d = ggx(h.z, squared)
        toward = reach(v.z, squared)
        bright = d * 0.5 * w.z / (w.z * toward + v.z * reach(w.z, squared))
        shared = x.coated * schlick(x.base, x.edge, vh)
        if x.glass > 0.0:
            shared += glass * fresnel(vh, x.eta)
        red += bright * (shared + x.metal * schlick(x.red, 1.0, vh))
        green += bright * (shared + x.metal * schlick(x.green, 1.0, vh))
        blue += bright * (shared + x.metal * schlick(x.blue, 1.0, vh))
        mirrored, refracted = _split(x, vh)
        if mirrored > 0.0:
            density += gloss * mirrored / (mirrored + refracted) * 0.5 * d / (v.z + toward)
    else:
        passed *= x.through
        red, green, blue = passed * x.red, passed * x.green, passed * x.blue
        density = far * cosine / math.pi
        # Facets that refract. Two surfaces tint what goes through, so each takes the root.
        if x.glass > 0.0:
            if x.thin:
                h = normalize(Vec3(v.x + w.x, v.y + w.y, v.z - w.z))
            else:
                h = normalize(Vec3(v.x + x.eta * w.x, v.y + x.eta * w.y, v.z + x.eta * w.z))
                if h.z < 0.0:
                    h = Vec3(-h.x, -h.y, -h.z)
            vh, wh = dot(v, h), dot(w, h)
            if vh > 0.0 and (x.thin or wh < 0.0):
                mirrored, refracted = _split(x, vh)
                d = ggx(h.z, squared)
                toward = reach(v.z, squared)
                spread = 0.25 / vh
                narrowed = 1.0
                if not x.thin:
                    root = x.eta * wh + vh
                    spread = x.eta * x.eta * abs(wh) / max(root * root, 1e-300)
                    narrowed = 1.0 / (x.eta * x.eta)
                # Masked by both sides: G2 / G1 = share; density of the facet: 2 vh d / (vz + ...).
                both = v.z * reach(cosine, squared) + cosine * toward
                share = cosine * (v.z + toward) / both
                facet = 2.0 * vh * d / (v.z + toward) * spread
                bright = glass * (1.0 - fresnel(vh, x.eta)) * facet * share * narrowed
                power = 1.0 if x.thin else 0.5
                red += bright * x.red**power
                green += bright * x.green**power
                blue += bright * x.blue**power
                density += gloss * refracted / (mirrored + refracted) * facet
    return red, green, blue, density


@njit
def _draw(
    x: _Mix, to_viewer: _Shares, v: Vec3, u: float, turn: float, lobe: float, side: float
) -> Vec3:
    """Return a direction that light may come from; zero where none was found."""
    gloss, matt, far = _lobes(x, to_viewer)
    if lobe < gloss:
        h = visible_normal(v, x.alpha, u, turn)
        vh = dot(v, h)
        mirrored, refracted = _split(x, vh)
        up = Vec3(2.0 * vh * h.x - v.x, 2.0 * vh * h.y - v.y, 2.0 * vh * h.z - v.z)
        if side * (mirrored + refracted) < mirrored:
            return up if up.z > 0.0 else Vec3(0.0, 0.0, 0.0)
        down = Vec3(up.x, up.y, -up.z) if x.thin else refract(v, h, x.eta)
        return down if down.z < 0.0 else Vec3(0.0, 0.0, 0.0)
    if matt + far <= 0.0:
        return Vec3(0.0, 0.0, 0.0)
    radius = math.sqrt(u)
    z = math.sqrt(max(1.0 - u, 1e-18))
    if lobe >= gloss + matt:
        z = -z
    return Vec3(radius * math.cos(2.0 * math.pi * turn), radius * math.sin(2.0 * math.pi * turn), z)


@njit(entry=True)
def scatter_batch(
    matter: Matter,
    albedo: Albedo,
    draw: bool,
    pairs: Floats,
    choices: Floats,
    towards: Floats,
    light: Floats,
    density: Floats,
) -> None:
    """Write what surfaces do with light from directions, and how likely each is to be drawn.

    Parameters
    ----------
    draw
        Whether to draw the directions first, by pairs and choices (N, 2).
    towards
        (N, 3) unit directions in world coordinates.
    light
        (N, 3) light to the viewer per irradiance on a surface that faces the direction; written.
    density
        (N,) per solid angle; 0 where nothing is scattered; written.
    """
    for i in range(len(density)):
        n = Vec3(matter.normal[i, 0], matter.normal[i, 1], matter.normal[i, 2])
        # The frame of Duff et al. 2017 has no singular direction.
        sign = math.copysign(1.0, n.z)
        p = -1.0 / (sign + n.z)
        q = n.x * n.y * p
        s = Vec3(1.0 + sign * n.x * n.x * p, sign * q, -sign * n.x)
        t = Vec3(q, sign + n.y * n.y * p, -n.y)
        world = Vec3(matter.viewer[i, 0], matter.viewer[i, 1], matter.viewer[i, 2])
        v = Vec3(dot(world, s), dot(world, t), max(dot(world, n), 1e-6))
        x = _mix_at(matter, i)
        to_viewer = _shares_at(x, albedo, v.z)
        if draw:
            w = _draw(x, to_viewer, v, pairs[i, 0], pairs[i, 1], choices[i, 0], choices[i, 1])
            towards[i, 0] = w.x * s.x + w.y * t.x + w.z * n.x
            towards[i, 1] = w.x * s.y + w.y * t.y + w.z * n.y
            towards[i, 2] = w.x * s.z + w.y * t.z + w.z * n.z
        d = Vec3(towards[i, 0], towards[i, 1], towards[i, 2])
        w = Vec3(dot(d, s), dot(d, t), dot(d, n))
        side = d.x * matter.facing[i, 0] + d.y * matter.facing[i, 1] + d.z * matter.facing[i, 2]
        light[i, 0], light[i, 1], light[i, 2], density[i] = 0.0, 0.0, 0.0, 0.0
        # Bumps must not let light through the geometry.
        if side * w.z > 0.0:
            light[i, 0], light[i, 1], light[i, 2], density[i] = _evaluate(
                x, albedo, v, w, to_viewer
            )
