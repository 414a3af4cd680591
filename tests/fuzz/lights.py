"""What scenes do with pictures, for the subjects that spoil them."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.graph.settings import SETTINGS
from pcsg.render.pictures import read_values
from pcsg.render.sky import Sky, make_sky
from pcsg.render.textures import Textures

_RNG = np.random.default_rng(1)
_DIRECTIONS = _RNG.normal(size=(64, 3))
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
_PAIRS = _RNG.random((64, 2))
_POINTS = _RNG.normal(size=(64, 3))


def use_picture(path: Path, data: bytes) -> None:
    """Take a picture as a sky and as textures."""
    path.write_bytes(data)
    sky = make_sky(_values("sky", kind="image", file=str(path)), (0.0, 0.0, 1.0))
    assert isinstance(sky, Sky)
    found = [sky.backdrop(_DIRECTIONS)]
    # What adds up the whole sky takes a while.
    if zlib.crc32(data) % 10 == 0:
        found.append(sky.ambient(_DIRECTIONS))
    if zlib.crc32(data) % 500 == 0:
        found += [sky.sample(_POINTS, _PAIRS).irradiance, sky.density(_DIRECTIONS)]
    kinds = ("image",) if path.suffix in (".hdr", ".exr") else ("image", "normals")
    textures = Textures.of([_values("texture", kind=k, file=str(path)) for k in kinds])
    which = np.zeros(64, np.int64)
    found.append(textures.colors(which, _POINTS, _PAIRS, np.ones(64)))
    found += [textures.slopes(k, _PAIRS, np.ones(64)) for k in range(len(kinds))]
    if "normals" in kinds:
        found.append(read_values(path))
    assert all(np.isfinite(values).all() for values in found)


def _values(setting: str, **given: Any) -> dict[str, Any]:
    return {**{key: k.default for key, k in SETTINGS[setting].keys.items()}, **given}
