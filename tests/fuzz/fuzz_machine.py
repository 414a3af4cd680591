"""Files of machine code, spoilt: none is taken, and what is taken runs as it was compiled."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from driver import Subject
from mutations import spoil_bytes

from pcsg.codecache import Folder, pack
from pcsg.compilation import compile_kernel
from pcsg.jit import njit
from pcsg.objectcode import Code, bind, flatten

NAME = "kernel.code"


def _sum(x: Any, k: int) -> Any:
    total = 0.0
    for i in range(len(x)):
        total += x[i] * k
    return total, k + 1


@cache
def _code() -> Code:
    return compile_kernel(njit(entry=True)(_sum), _arguments())


def _arguments() -> tuple[Any, ...]:
    return np.arange(5.0), 3


def seeds() -> Sequence[bytes]:
    return [pack(NAME, _code())]


def mutate(rng: random.Random, data: bytes) -> bytes:
    if rng.random() < 0.3:
        return spoil_bytes(rng, data)
    # One bit: of the head as often as of the rest.
    end = rng.choice([len(data) - len(_code().content), len(data)])
    at = rng.randrange(end)
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def run(data: bytes, folder: Path) -> None:
    path = folder / "kernels"
    path.mkdir(mode=0o700)
    (path / NAME).write_bytes(data)
    (path / NAME).chmod(0o600)
    code = Folder(path).read(NAME)
    assert (code is not None) == (data == seeds()[0])
    if code is not None:
        words: list[Any] = []
        args = _arguments()
        for value in args:
            flatten(value, [], words)
        assert bind("kernel", code, args)(*words) == (30.0, 4)


SUBJECT = Subject("machine", seeds, mutate, run)
