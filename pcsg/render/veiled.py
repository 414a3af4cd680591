"""Light seen through fog."""

from __future__ import annotations

from pcsg.render.fog import Fog
from pcsg.render.integrators import Integrator, Light, Samples
from pcsg.render.tracer import Floats


class Veiled:
    """A way to find light, with fog between the eye and what it sees.

    Parameters
    ----------
    inner
        Finds the light without fog.
    fog
        The fog.
    """

    def __init__(self, inner: Integrator, fog: Fog) -> None:
        self.inner, self.fog = inner, fog

    def radiance(self, origins: Floats, directions: Floats, samples: Samples) -> Light:
        """See `Integrator`."""
        light = self.inner.radiance(origins, directions, samples)
        clear = self.fog.clearness(origins, directions, light.hits.t)
        rgb = light.rgb
        for k, tone in enumerate(self.fog.color):
            rgb[:, k] = tone + clear * (rgb[:, k] - tone)
        return light
