"""Clouds: the echoes of beams, and the beams that came to nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Cloud:
    """Echoes of a scan, N of them, and its beams, B of them.

    Attributes
    ----------
    points, normals : float64 (N, 3)
        World coordinates; normals, labels and incidences are those of one of an echo's sub-rays,
        at random.
    intensity : float64 (N,)
        Share of a beam that comes back, times the cosine of the incidence.
    share : float64 (N,)
        Of the beam that the echo stopped.
    return_number, returns : int64 (N,)
        From 1, and how many the beam has.
    label : int64 (N,)
        -1 for none.
    leg, beam : int64 (N,)
        Which leg, from 0, and the number of the beam within `beam_directions`.
    time : float64 (N,)
        Seconds since the scan began.
    range, incidence : float64 (N,)
        Metres as measured, and degrees between the beam and the normal.
    beam_origins, beam_directions : float64 (B, 3)
        Empty where misses are not kept.
    beam_legs : int64 (B,)
    """

    points: Floats
    normals: Floats
    intensity: Floats
    share: Floats
    return_number: Integers
    returns: Integers
    label: Integers
    leg: Integers
    beam: Integers
    time: Floats
    range: Floats
    incidence: Floats
    beam_origins: Floats
    beam_directions: Floats
    beam_legs: Integers

    def __len__(self) -> int:
        return len(self.points)

    @property
    def missed(self) -> Integers:
        """Numbers of the beams without an echo."""
        return np.flatnonzero(np.bincount(self.beam, minlength=len(self.beam_legs)) == 0)

    def write(self, path: str | Path, classes: Mapping[int, int] | None = None) -> None:
        """Write the cloud to a file: .laz .las .csv .xyz .ply .npz, by its ending.

        LAS is version 1.4, point format 6, with the extra dimensions ``label``, ``range``,
        ``incidence``, ``nx ny nz``. It cannot hold misses: those stand in a .npz beside it.

        Parameters
        ----------
        path
            The file.
        classes
            LAS classes by label; by default 1, unclassified.

        Raises
        ------
        UsageError
            The ending is unknown, or laspy is missing: ``pip install '.[science]'``.
        """
        from pcsg.lidar.files import write_cloud

        write_cloud(Path(path), [self], classes or {})


BEAM_FIELDS = ("beam_origins", "beam_directions", "beam_legs")


def join(parts: Sequence[Cloud]) -> Cloud:
    """Return the clouds of parts of a scan as one."""
    columns = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(Cloud)
        if f.name != "beam"
    }
    before = np.cumsum([0, *(len(part.beam_legs) for part in parts[:-1])])
    beams = [part.beam + n for part, n in zip(parts, before.tolist(), strict=True)]
    return Cloud(beam=np.concatenate(beams), **columns)
