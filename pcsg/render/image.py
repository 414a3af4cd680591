"""A finished picture: its pixels and what is known about each of them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.render.files import check_output, write_whole
from pcsg.render.view import encode

AOVS = ("depth", "normal", "label")
"""Layers besides the colour."""

ENDINGS = (".png",)


@dataclass(frozen=True, eq=False)
class Image:
    """A picture. Row 0 is the top.

    Attributes
    ----------
    rgb
        (H, W, 3) float32, linear light.
    depth
        (H, W) float32, distance from the eye to what the pixel's centre shows; inf: nothing.
    normal
        (H, W, 3) float32, unit and outward; zero where nothing was met.
    label
        (H, W) int64, the grammar's labels; -1 where none.
    finished
        (H, W) bool, False where an interrupted picture has no sample; such pixels are transparent.
    metadata
        Texts that `save` puts into the file.
    """

    rgb: NDArray[np.float32]
    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    label: NDArray[np.int64]
    finished: NDArray[np.bool_]
    metadata: Mapping[str, str] = field(default_factory=dict)

    def to_bytes(self) -> NDArray[np.uint8]:
        """Return (H, W, 3) sRGB pixels, or (H, W, 4) with opacity if some are unfinished."""
        shown = np.asarray(encode(self.rgb) * np.float32(255) + np.float32(0.5)).astype(np.uint8)
        if self.finished.all():
            return shown
        opacity = np.where(self.finished, 255, 0).astype(np.uint8)
        return np.concatenate([shown, opacity[..., None]], axis=2)

    def save(self, path: str | Path, aovs: Sequence[str] = ()) -> list[Path]:
        """Write the picture as PNG, whole or not at all.

        Parameters
        ----------
        path
            Its name, ending in ``.png``.
        aovs
            Layers of `AOVS` to write beside it, exactly as they are: ``tree.depth.npy`` beside
            ``tree.png``.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        UsageError
            The name has no known ending or is a folder's, or a layer is unknown.
        EnvironmentFault
            The system refuses.
        """
        path = Path(path)
        check_output(path, ENDINGS)
        layers = {aov_path(path, name): getattr(self, name) for name in aovs}
        write_whole(path, self._write_png)
        for place, values in layers.items():
            write_whole(place, partial(_write_array, values))
        return [path, *layers]

    def _write_png(self, file: IO[bytes]) -> None:
        from PIL import Image as Pillow
        from PIL.PngImagePlugin import PngInfo

        info = PngInfo()
        info.add(b"sRGB", b"\x00")
        for keyword, text in self.metadata.items():
            if text.isascii():
                info.add_text(keyword, text)
            else:
                info.add_itxt(keyword, text)
        Pillow.fromarray(self.to_bytes()).save(file, format="PNG", pnginfo=info)

    def _repr_png_(self) -> bytes:
        """Return the picture as PNG, which notebooks show."""
        buffer = io.BytesIO()
        self._write_png(buffer)
        return buffer.getvalue()


def _write_array(values: NDArray[np.generic], file: IO[bytes]) -> None:
    np.save(file, values)


def aov_path(path: Path, name: str) -> Path:
    """Return where a layer of a picture is written.

    Raises
    ------
    UsageError
        There is no such layer.
    """
    if name not in AOVS:
        raise UsageError(f"unknown layer `{name}`; there are {', '.join(AOVS)}")
    return path.with_suffix(f".{name}.npy")
