"""Archives of arrays, spoilt: by bytes, and by arrays whose check sums are right."""

from __future__ import annotations

import io
import random
import zipfile
from typing import Any

import numpy as np
from mutations import spoil_bytes

VALUES = (0, 1, -1, 2, 255, 2**31, -(2**62), 1e30, -1e300, float("nan"), float("inf"))
TYPES = ("b", "B", "<i4", ">i8", "<f4", "<f8", "?", "<c8", "<U3", "<M8[s]")


def spoil_archive(rng: random.Random, data: bytes) -> bytes:
    """Return an archive after some small changes."""
    if rng.random() < 0.3:
        return spoil_bytes(rng, data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        whole = {name: archive.read(name) for name in archive.namelist()}
    members = dict(whole)
    for _ in range(rng.randint(1, 2)):
        name = rng.choice(sorted(members))
        what = rng.randrange(6)
        if what == 0:
            del members[name]
        elif what == 1:
            members[name] = spoil_bytes(rng, members[name], 2)
        elif what == 2:  # what stands before the numbers
            members[name] = spoil_bytes(rng, members[name][:128], 2) + members[name][128:]
        elif what == 3:
            members[name] = members[rng.choice(sorted(members))]
        else:
            members[name] = _saved(_spoilt(rng, np.load(io.BytesIO(whole[name]))))
        if not members:
            break
    file = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if rng.random() < 0.1 else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", kind) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def _saved(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _spoilt(rng: random.Random, array: Any) -> Any:
    """Return an array with other numbers, of another kind or another shape."""
    what = rng.randrange(4)
    with np.errstate(all="ignore"):
        if what == 0:
            return array[:-1] if array.ndim and len(array) else np.zeros(rng.randrange(4))
        if what == 1:
            return np.zeros(array.shape, rng.choice(TYPES))
        array = array.copy()
        flat = array.reshape(-1)
        for _ in range(rng.randint(1, 5) if len(flat) else 0):
            value = np.asarray(rng.choice(VALUES), np.float64)
            flat[rng.randrange(len(flat))] = value.astype(array.dtype)
        return array
