"""Height fields: pictures and arrays of heights as closed meshes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg.arguments import array as array_of
from pcsg.errors import UsageError
from pcsg.inputs import read_bytes
from pcsg.leaf.mesh import Mesh, MeshModel
from pcsg.leaf.registry import Constant, LeafConstant, word
from pcsg.meshfile.mesh import FARTHEST, make_mesh

Floats = NDArray[np.float64]

PICTURES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF"}

MOST_HEIGHTS = 1 << 20
"""Most heights: two million triangles."""


def read_heights(path: Path) -> Floats:
    """Return the heights of a file, (rows, columns).

    Raises
    ------
    UsageError
        It holds none, is damaged, or is too large.
    EnvironmentFault
        It cannot be read.
    """
    ending = path.suffix.lower()
    if ending == ".npy":
        try:
            heights = np.load(io.BytesIO(read_bytes(path, "heights")), allow_pickle=False)
        except UsageError:
            raise
        except Exception as error:  # NumPy raises whatever a damaged file leads it to
            raise UsageError(f"{path} is damaged: {error}") from None
        return check_heights(heights, str(path))
    if ending not in PICTURES:
        raise UsageError(f"{path}: heights are read from .png, .tif and .npy files")
    from PIL import Image, UnidentifiedImageError

    data = read_bytes(path, "heights")
    try:
        with warnings.catch_warnings():
            # It warns of large pictures; we have a limit of our own.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=[PICTURES[ending]]) as picture:
                _check_count(picture.height, picture.width, str(path))
                deep, real = picture.mode.startswith("I"), picture.mode == "F"
                level = 65535.0 if deep else 1.0 if real else 255.0
                grey = picture if deep or real else picture.convert("L")
                heights = np.array(grey, np.float64) / level
    except UnidentifiedImageError:
        raise UsageError(f"{path} is not a picture that can be read") from None
    except (UsageError, MemoryError):
        raise
    except Exception as error:  # decoders raise anything when a file is damaged
        raise UsageError(f"{path} is damaged: {error}") from None
    return check_heights(heights, str(path))


def _check_count(rows: int, columns: int, what: str) -> None:
    if min(rows, columns) < 2 or rows * columns > MOST_HEIGHTS:
        raise UsageError(
            f"{what} has {rows:,} x {columns:,} heights: at least 2 x 2 are needed, and at most "
            f"{MOST_HEIGHTS:,} are read; make it smaller"
        )


def check_heights(heights: Any, what: str) -> Floats:
    """Return heights as floats (rows, columns); raises UsageError where they are none."""
    numbers = array_of(heights, what)
    if numbers.ndim != 2:
        raise UsageError(f"{what}: heights are numbers in rows and columns, not {numbers.shape}")
    rows, columns = numbers.shape
    _check_count(rows, columns, what)
    bad = np.argwhere(~(np.abs(numbers) <= FARTHEST))
    if len(bad):
        row, column = bad[0]
        value = numbers[row, column]
        raise UsageError(f"{what}: row {row + 1}, column {column + 1} is {value:g}, no height")
    return numbers


def heightfield_mesh(heights: Floats, name: str | None = None) -> MeshModel:
    """Return the closed mesh below heights: two triangles between four, walls, and a floor.

    Parameters
    ----------
    heights : float64 (rows, columns)
        The first row is the one at y = 1, the first column at x = -1.
    name
        The file as the grammar names it; None for an array.
    """
    rows, columns = heights.shape
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(1.0, -1.0, rows))
    top = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    low, high = float(heights.min()), float(heights.max())
    floor = low - (0.1 * (high - low) if high > low else 1.0)
    number = np.arange(rows * columns).reshape(rows, columns)
    # Round the border, to the left of it the heights.
    border = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    below = top[border]
    below[:, 2] = floor
    vertices = np.concatenate([top, below, [(0.0, 0.0, floor)]])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    under = rows * columns + np.arange(len(border))
    turned = np.roll(border, -1), np.roll(under, -1)
    center = np.full(len(border), len(vertices) - 1)
    sides = [(a, b, c), (a, c, d), (border, under, turned[1]), (border, turned[1], turned[0])]
    sides.append((under, center, turned[1]))
    faces = np.concatenate([np.stack([np.ravel(v) for v in s], axis=-1) for s in sides])
    corners = faces.ravel().astype(np.int64)
    uv = 0.5 + 0.5 * vertices[corners, :2]
    mesh = make_mesh(vertices, corners, np.arange(0, len(corners) + 1, 3), uv)
    return MeshModel(mesh, name)


@word
class Heightfield(Mesh):
    """Land below heights over -1 <= x, y <= 1: a .png, .tif or .npy file.

    z is the height: from 0, black, to 1, white, in pictures of 8 and 16 bits; as they are in arrays
    and in pictures of floats. The first row of the file lies at y = 1, the first column at x = -1.
    Between four heights there are two triangles. It is a closed solid: walls go down to a floor, a
    tenth of the heights' range below the lowest (1, where all are equal).

    In Python, ``heightfield("dem.png")`` or ``heightfield(heights)``, an array of two dimensions.

    Surface coordinates: x and y, from 0 to 1.
    """

    constants = (LeafConstant("file", "the name of a .png, .tif or .npy file in quotes"),)
    soft = True

    @classmethod
    def read_model(cls, path: Path, name: str) -> MeshModel:
        return heightfield_mesh(read_heights(path), name)

    @classmethod
    def take_arguments(cls, args: Sequence[Any]) -> tuple[tuple[Constant, ...], Sequence[Any]]:
        if len(args) == 1 and not isinstance(args[0], (str, Path)):
            heights: ArrayLike = args[0]
            return (heightfield_mesh(check_heights(heights, "heightfield")),), ()
        return super().take_arguments(args)
