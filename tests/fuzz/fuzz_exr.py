"""Pictures in the format OpenEXR, spoilt, as skies and textures."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from driver import Subject
from lights import use_picture
from mutations import spoil_bytes

COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA")


def seeds() -> Sequence[bytes]:
    import OpenEXR

    made = []
    rng = np.random.default_rng(1)
    pixels = np.linspace(0, 2, 20 * 24 * 3).reshape(20, 24, 3).round(1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.exr")
        for k, name in enumerate(COMPRESSIONS):
            values = (pixels + (k % 2) * rng.random(pixels.shape)).astype("f" if k % 3 else "e")
            header = {
                "compression": getattr(OpenEXR, f"{name}_COMPRESSION"),
                "type": OpenEXR.scanlineimage,
            }
            OpenEXR.File(header, {"RGB": values}).write(str(path))
            made.append(path.read_bytes())
    return made


def mutate(rng: random.Random, data: bytes) -> bytes:
    # What stands before the pixels says most.
    head = data.find(b"screenWindowWidth") + 50
    if rng.random() < 0.5:
        return spoil_bytes(rng, data[:head]) + data[head:]
    return data[:head] + spoil_bytes(rng, data[head:])


def run(data: bytes, folder: Path) -> None:
    use_picture(folder / "a.exr", data)


SUBJECT = Subject("exr", seeds, mutate, run)
