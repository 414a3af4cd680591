"""Machine code that is kept on disk gives what it gave when it was compiled."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from pcsg import machine
from pcsg.jit import is_cached, njit
from pcsg.machine import Entry, flatten


class Pair(NamedTuple):
    a: Any
    b: Any


def _mix(pair: Any, x: float, k: int, flag: bool, nothing: None, out: Any) -> Any:
    for i in range(len(out)):
        out[i] = pair.a[i, 0] * x + pair.b[i] + math.sin(x) * k
    if nothing is not None or flag:
        return k, x
    return -k, -x


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(machine, "cache_folder", lambda name: tmp_path)
    return tmp_path


def arguments(rows: Any = None) -> tuple[Any, ...]:
    rows = np.arange(6.0).reshape(3, 2) if rows is None else rows
    return Pair(rows, np.arange(3, dtype=np.float32)), 2.5, 7, True, None, np.zeros(3)


def expected(args: tuple[Any, ...]) -> tuple[Any, Any]:
    mine = (*args[:5], np.zeros(3))
    return _mix(*mine), mine[5]


def fresh() -> Any:
    return njit(entry=True)(_mix)


def test_loaded_code_answers_as_compiled_code_does(folder: Path) -> None:
    for kernel in (fresh(), fresh()):
        args = arguments()
        answer, out = expected(args)
        assert kernel(*args) == answer
        np.testing.assert_array_equal(args[5], out)
        assert len(list(folder.glob("*.code"))) == 1


def test_arrays_of_other_layouts_get_code_of_their_own(folder: Path) -> None:
    kernel = fresh()
    for rows in (np.arange(6.0).reshape(2, 3).T, np.arange(12.0).reshape(6, 2)[::2]):
        args = arguments(rows)
        kernel(*args)
        np.testing.assert_array_equal(args[5], expected(args)[1])
    assert len(list(folder.glob("*.code"))) == 2


@pytest.mark.parametrize("damage", [b"", b"no json", b"cut"])
def test_damaged_code_is_compiled_again(folder: Path, damage: bytes) -> None:
    fresh()(*arguments())
    (path,) = folder.glob("*.code")
    path.write_bytes(path.read_bytes()[:-7] if damage == b"cut" else damage)
    args = arguments()
    fresh()(*args)
    np.testing.assert_array_equal(args[5], expected(args)[1])
    assert machine._read(path) is not None


def test_a_folder_that_cannot_be_written_does_no_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "cache_folder", lambda name: tmp_path / "nowhere")
    args = arguments()
    assert fresh()(*args) == expected(args)[0]


def test_types_that_kernels_do_not_take_are_named() -> None:
    with pytest.raises(TypeError, match="list"):
        flatten([1.0], [], [])


def test_numbers_keep_their_kinds() -> None:
    kinds: list[Any] = []
    words: list[Any] = []
    flatten((True, 3, np.float64(2.5), np.uint64(1 << 63), None), kinds, words)
    assert kinds[2:] == ["b", "i", "f", "u", "none"]
    assert words == [True, 3, 2.5, 1 << 63, 0]


def test_entries_know_whether_they_were_compiled() -> None:
    def unheard_of(x: float) -> float:
        return x + 0.123456789

    assert not is_cached(njit(entry=True)(unheard_of))


def test_entries_are_entries_only_where_they_say_so() -> None:
    assert isinstance(fresh().entry, Entry)
    assert njit(_mix).entry is None  # type: ignore[attr-defined]


def test_a_second_process_renders_without_the_compiler(tmp_path: Path) -> None:
    scene = tmp_path / "ball.pcsg"
    scene.write_text("sphere\n", encoding="utf-8")
    script = (
        "import sys\nfrom pcsg.cli import main\n"
        "try:\n    main()\nfinally:\n    print('numba' in sys.modules)\n"
    )
    line = [sys.executable, "-c", script, "render", str(scene), "--size", "8x8", "-q"]
    line += ["-o", str(tmp_path / "ball.png")]
    told = [
        subprocess.run(line, capture_output=True, text=True, check=True, env=dict(os.environ))
        for _ in range(2)
    ]
    assert told[1].stdout.split()[-1] == "False"


def _square(x: float) -> float:
    return x * x


def test_what_was_linked_into_a_kernel_is_still_a_function(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import numba
    from numba.core.registry import cpu_target

    def folder_of(name: str) -> Path:
        (tmp_path / name).mkdir(exist_ok=True)
        return tmp_path / name

    monkeypatch.setattr(machine, "cache_folder", folder_of)
    square = njit(_square)

    def outer(x: float) -> float:
        return square(x) + 1.0

    def failing(x: float) -> float:
        return square(x).nothing  # type: ignore[attr-defined,no-any-return]

    def other(x: float) -> float:
        return square(x) - 1.0

    before = cpu_target.target_context.codegen()._library_class
    assert njit(entry=True)(outer)(3.0) == 10.0
    with pytest.raises(numba.TypingError):
        njit(entry=True)(failing)(3.0)
    # numba goes on as before, also with what was linked.
    assert cpu_target.target_context.codegen()._library_class is before
    assert square(3.0) == 9.0
    assert numba.njit(other)(3.0) == 8.0
