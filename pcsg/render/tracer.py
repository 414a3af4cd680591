"""What the renderer needs of a scene: rays in, hits out. The scene and tests' fakes provide it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pcsg.trace.coverage import Footprint
from pcsg.trace.hits import Hits

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GROUND = -2
"""Leaf number of the ground plane, which is no node of the graph."""


class Tracer(Protocol):
    """Answers batches of rays; callable from several threads at once."""

    def intersect(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Hits:
        """Return the first crossings in the closed ranges."""
        ...

    def occluded(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Bools:
        """Return whether anything lies in the closed ranges."""
        ...


@runtime_checkable
class WideTracer(Protocol):
    """A tracer that can end recursion below the footprints of its rays."""

    takes_footprints: bool

    def intersect(
        self,
        origins: Floats,
        directions: Floats,
        t_min: float | Floats,
        t_max: float | Floats,
        footprint: Footprint | None,
    ) -> Hits:
        """Return the first crossings in the closed ranges."""
        ...

    def occluded(
        self,
        origins: Floats,
        directions: Floats,
        t_min: float | Floats,
        t_max: float | Floats,
        footprint: Footprint | None,
    ) -> Bools:
        """Return whether anything lies in the closed ranges."""
        ...


class RenderScene(Protocol):
    """The part of a scene that makes its picture."""

    @property
    def tracer(self) -> Tracer:
        """Who answers the rays."""
        ...

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box about the bounded parts; least above greatest if empty."""
        ...

    @property
    def sheets(self) -> Bools:
        """(L,) by number of the leaf: whether it is a surface without an inside."""
        ...

    @property
    def parameters(self) -> Mapping[str, float]:
        """Values of the axiom's parameters."""
        ...

    @property
    def source_hash(self) -> str:
        """Digest of the grammar."""
        ...

    def setting_values(self, kind: str) -> list[dict[str, Any]]:
        """Return the evaluated settings of a kind, defaults filled in, None where automatic."""
        ...

    def setting_numbers(self, kind: str) -> Mapping[str, int]:
        """Return the number of every named setting of a kind."""
        ...

    def reach(self, directions: Floats) -> Floats:
        """Return (N,) how far things certainly reach in directions (N, 3), -inf if unknown."""
        ...

    def shining_covers(self, strengths: Floats) -> Floats:
        """Return (K, `COLUMNS`) covers of all that shines: see `pcsg.graph.shining`.

        Parameters
        ----------
        strengths
            (M,) how much a surface of every material shines.
        """
        ...


class DetailedTracer:
    """A tracer whose rays are as wide as a pixel looks at the place where they begin.

    What is smaller than that is not looked into. A ray of the camera has no width at the eye and a
    pixel's width where it arrives; rays that go on from there, to a light or a mirror image, begin
    with that width.

    Parameters
    ----------
    inner
        Takes footprints.
    eye
        Where the camera is.
    pixel
        Width of a pixel, and how much wider it is per distance from the eye.
    spread
        How much wider a ray gets per distance; by default a pixel's width.
    """

    def __init__(
        self,
        inner: WideTracer,
        eye: tuple[float, float, float],
        pixel: tuple[float, float],
        spread: float | None = None,
    ) -> None:
        self.inner = inner
        self.eye = np.array(eye)
        self.pixel = pixel
        self.spread = pixel[1] if spread is None else spread

    def _footprint(self, origins: Floats) -> Footprint:
        away = origins - self.eye
        fixed, spread = self.pixel
        width = spread * np.sqrt(np.einsum("ij,ij->i", away, away))
        if fixed > 0.0:
            width += fixed
        return Footprint(width, np.full(len(origins), self.spread))

    def intersect(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Hits:
        """Return the first crossings in the closed ranges."""
        footprint = self._footprint(origins)
        return self.inner.intersect(origins, directions, t_min, t_max, footprint)

    def occluded(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Bools:
        """Return whether anything lies in the closed ranges."""
        footprint = self._footprint(origins)
        return self.inner.occluded(origins, directions, t_min, t_max, footprint)


class _GroundedHits(Hits):
    """Hits of which some are on the ground; their fields are put together when asked for."""

    def __init__(self, hits: Hits, beyond: Ints, ground: Mapping[str, Any]) -> None:
        # The fields of hits are frozen.
        vars(self).update(_hits=hits, _beyond=beyond, _ground=ground)

    def __getattr__(self, name: str) -> Any:
        """Put a field together."""
        ground = vars(self).get("_ground", {})
        if name not in ground:
            raise AttributeError(name)
        values = getattr(vars(self)["_hits"], name).copy()
        values[vars(self)["_beyond"]] = ground[name]
        vars(self)[name] = values
        return values


class GroundedTracer:
    """A tracer with an infinite horizontal plane in it.

    Parameters
    ----------
    inner
        What stands on the plane.
    z
        Its height.
    material
        Number of its material, -1 for the default.
    """

    def __init__(self, inner: Tracer, z: float, material: int) -> None:
        self.inner = inner
        self.z = z
        self.material = material

    def around(self, inner: Tracer) -> GroundedTracer:
        """Return the same plane with something else standing on it."""
        return GroundedTracer(inner, self.z, self.material)

    def _crossing(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.z - origins[:, 2]) / directions[:, 2]
        return np.where((t >= t_min) & (t <= t_max) & np.isfinite(t), t, np.inf)

    def intersect(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Hits:
        """Return the first crossings; the plane's leaf number is `GROUND`."""
        plane = self._crossing(origins, directions, t_min, t_max)
        # What lies behind the plane need not be looked for.
        hits = self.inner.intersect(origins, directions, t_min, np.minimum(t_max, plane))
        beyond = np.flatnonzero(np.isinf(hits.t) & (plane < np.inf))
        if len(beyond) == 0:
            return hits
        at = origins[beyond] + plane[beyond, None] * directions[beyond]
        at[:, 2] = self.z
        values = {
            "t": plane[beyond],
            "leaf": GROUND,
            "normal": (0.0, 0.0, 1.0),
            "position": at,
            "uv": at[:, :2],
            "other_uv": 0.0,
            "label": -1,
            "color": -1.0,
            "material": self.material,
            "texture": -1,
            "texture_scale": 1.0,
        }
        return _GroundedHits(hits, beyond, values)

    def occluded(
        self, origins: Floats, directions: Floats, t_min: float | Floats, t_max: float | Floats
    ) -> Bools:
        """Return whether the scene or the plane lies in the way."""
        blocked = self._crossing(origins, directions, t_min, t_max) < np.inf
        if not blocked.any():
            return self.inner.occluded(origins, directions, t_min, t_max)
        rows = np.flatnonzero(~blocked)
        if len(rows):
            low, high = (t[rows] if isinstance(t, np.ndarray) else t for t in (t_min, t_max))
            blocked[rows] = self.inner.occluded(origins[rows], directions[rows], low, high)
        return blocked
