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

from pcsg import arguments
from pcsg.errors import UsageError
from pcsg.outputs import check_output, write_by_name, write_whole
from pcsg.render.formats import BAND, load_openexr, write_exr, write_png
from pcsg.render.view import View

AOVS = ("depth", "normal", "albedo", "label", "leaf")
"""Layers besides the colour."""

ENDINGS = (".png", ".exr")


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
    albedo
        (H, W, 3) float32, colour of the matter; zero where nothing was met.
    label
        (H, W) int64, the grammar's labels; -1 where none.
    leaf
        (H, W) int32, number of the leaf node; -1 where nothing was met, -2 for the ground.
    finished
        (H, W) bool, False where an interrupted picture has no sample; such pixels are transparent.
    metadata
        Texts that `save` puts into the file.
    view
        How light is shown in files of sRGB colours.
    """

    rgb: NDArray[np.float32]
    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    label: NDArray[np.int64]
    leaf: NDArray[np.int32]
    finished: NDArray[np.bool_]
    metadata: Mapping[str, str] = field(default_factory=dict)
    view: View = field(default_factory=View)

    def to_bytes(self) -> NDArray[np.uint8]:
        """Return (H, W, 3) sRGB pixels, or (H, W, 4) with opacity if some are unfinished."""
        return np.asarray(self._encoded(8), dtype=np.uint8)

    def _encoded(self, bits: int) -> NDArray[np.generic]:
        """Return the pixels in whole numbers of 8 or 16 bits."""
        top = np.float32((1 << bits) - 1)
        kind = np.dtype(f"uint{bits}")
        shown = np.empty(self.rgb.shape, kind)
        for k in range(0, len(shown), BAND):
            shown[k : k + BAND] = self.view.encode(self.rgb[k : k + BAND]) * top + np.float32(0.5)
        if self.finished.all():
            return shown
        opacity = np.where(self.finished, top, np.float32(0)).astype(kind)
        return np.concatenate([shown, opacity[..., None]], axis=2)

    def denoised(self) -> Image:
        """Return the picture without its noise, by Intel's Open Image Denoise.

        Raises
        ------
        EnvironmentFault
            The library is not installed: ``pip install '.[denoise]'``.
        """
        from pcsg.render.denoise import denoised

        return denoised(self)

    def save(self, path: str | Path, aovs: Sequence[str] = (), bits: int = 8) -> list[Path]:
        """Write the picture, whole or not at all.

        Parameters
        ----------
        path
            Its name, ending in ``.png`` (as shown) or ``.exr`` (linear light).
        aovs
            Layers of `AOVS` to write, exactly as they are: into an ``.exr``, beside a ``.png`` as
            ``tree.depth.npy``.
        bits
            8 or 16 for each colour of a ``.png``.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        UsageError
            The name has no known ending or is a folder's, or a layer is unknown.
        EnvironmentFault
            The system refuses, or the library for .exr is not installed.
        """
        path = arguments.path(path, "path")
        aovs = arguments.listed(aovs, "aovs", "layers")
        check_picture(path, aovs, bits)
        values = {name: getattr(self, name) for name in aovs}
        if path.suffix.lower() == ".exr":
            layers = {"RGB": self.rgb, **values}
            write_by_name(path, lambda place: write_exr(place, layers, self.metadata))
            return [path]
        write_whole(path, partial(self._write_png, bits))
        for name, layer in values.items():
            write_whole(aov_path(path, name), partial(_write_array, layer))
        return [path, *(aov_path(path, name) for name in values)]

    def _write_png(self, bits: int, file: IO[bytes]) -> None:
        write_png(file, self._encoded(bits), self.metadata)

    def _repr_png_(self) -> bytes:
        """Return the picture as PNG, which notebooks show."""
        buffer = io.BytesIO()
        self._write_png(8, buffer)
        return buffer.getvalue()


def _write_array(values: NDArray[np.generic], file: IO[bytes]) -> None:
    np.save(file, values)


def check_picture(path: Path, aovs: Sequence[str], bits: int = 8) -> None:
    """Raise an error now if a picture could not be written later.

    Raises
    ------
    UsageError
        The name has no known ending or is a folder's, or a layer is unknown.
    EnvironmentFault
        The folder takes no files, or the library for .exr is not installed.
    """
    check_output(path, ENDINGS)
    if arguments.whole(bits, "bits", 8, 16) not in (8, 16):
        raise UsageError(f"a picture has 8 or 16 bits per colour, not {bits}")
    for name in aovs:
        layer = aov_path(path, name)
        if path.suffix.lower() == ".png":
            check_output(layer, (".npy",))
    if path.suffix.lower() == ".exr":
        load_openexr()
        try:
            str(path.absolute()).encode()
        except UnicodeEncodeError:
            raise UsageError(
                f"cannot write {path}: the library OpenEXR takes no names that are not UTF-8"
            ) from None


def aov_path(path: Path, name: str) -> Path:
    """Return where a layer of a picture is written.

    Raises
    ------
    UsageError
        There is no such layer.
    """
    if not isinstance(name, str) or name not in AOVS:
        raise UsageError(f"unknown layer {arguments.shown(name)}; there are {', '.join(AOVS)}")
    return path.with_suffix(f".{name}.npy")
