"""A scene of analytic balls, so that the renderer can be tested without the tracer."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from pcsg.errors import Diagnostic, EvaluationFault
from pcsg.graph.shining import CENTER, COLUMNS, POWER, RADIUS
from pcsg.trace.hits import Hits


class Spheres:
    parameters: Mapping[str, float] = {"cnt": 3.0}
    source_hash = "0123abcd"
    sheets = np.zeros(8, dtype=bool)

    def __init__(
        self,
        centers=((0.0, 0.0, 1.0), (1.6, 0.3, 0.6), (-1.2, -0.9, 0.5)),
        radii=(1.0, 0.6, 0.5),
        *,
        material=-1,
        texture=-1,
        color=(0.7, 0.4, 0.2),
        **settings: list[dict[str, Any]],
    ) -> None:
        self.centers = np.array(centers, dtype=float)
        self.radii = np.array(radii, dtype=float)
        self.material, self.texture, self.color = material, texture, color
        self.settings = settings
        self.batches = 0
        self.fault_after: int | None = None

    @property
    def tracer(self):
        return self

    @property
    def bounds(self):
        reach = self.radii[:, None]
        return np.array([(self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)])

    def setting_values(self, kind):
        return self.settings.get(kind, [])

    def setting_numbers(self, kind):
        return {v["name"]: k for k, v in enumerate(self.settings.get(kind, [])) if "name" in v}

    def reach(self, directions):
        along = np.linalg.norm(directions, axis=1)
        return (directions @ self.centers.T + along[:, None] * self.radii).max(axis=1)

    def shining_covers(self, strengths):
        if not (self.material >= 0 and strengths[self.material] > 0):
            return np.empty((0, COLUMNS))
        covers = np.zeros((len(self.radii), COLUMNS))
        covers[:, CENTER], covers[:, RADIUS] = self.centers, self.radii
        covers[:, POWER] = np.pi * self.radii**2 * strengths[self.material]
        return covers

    def _all(self, origins, directions, t_min, t_max):
        result = np.full((len(origins), len(self.radii)), np.inf)
        for k, (center, radius) in enumerate(zip(self.centers, self.radii, strict=True)):
            q = origins - center
            a = (directions * directions).sum(axis=1)
            b = (q * directions).sum(axis=1)
            root = b * b - a * ((q * q).sum(axis=1) - radius * radius)
            with np.errstate(invalid="ignore"):
                for sign in (1.0, -1.0):
                    t = (-b + sign * np.sqrt(root)) / a
                    fits = (root > 0) & (t >= t_min) & (t <= t_max)
                    result[:, k] = np.where(fits, t, result[:, k])
        return result

    def intersect(self, origins, directions, t_min, t_max):
        self.batches += 1
        if self.fault_after is not None and self.batches > self.fault_after:
            raise EvaluationFault(Diagnostic("nan", "sqrt of a negative number"))
        each = self._all(origins, directions, t_min, t_max)
        which, t = each.argmin(axis=1), each.min(axis=1)
        hit = np.isfinite(t)
        position = origins + np.where(hit, t, 0.0)[:, None] * directions
        normal = position - self.centers[which]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        n = len(t)
        number = np.where(hit, which, -1)
        return Hits(
            t=t,
            leaf=number,
            normal=normal,
            position=position,
            uv=np.zeros((n, 2)),
            other_uv=np.zeros((n, 2, 3)),
            label=number + 10 * hit,
            color=np.where(hit[:, None], self.color, -1.0),
            material=np.where(hit, self.material, -1),
            texture=np.where(hit, self.texture, -1),
            texture_scale=np.ones(n),
        )

    def occluded(self, origins, directions, t_min, t_max):
        return np.isfinite(self._all(origins, directions, t_min, t_max)).any(axis=1)
