"""Machine code that is kept on disk gives what it gave when it was compiled."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from pcsg.codecache import opened, unpack
from pcsg.commands.compiling import announce_compiling, tell_unkept
from pcsg.jit import is_cached, njit
from pcsg.machine import Entry
from pcsg.objectcode import describe_kinds, flatten


class Pair(NamedTuple):
    a: Any
    b: Any


def _mix(pair: Any, x: float, k: int, flag: bool, nothing: None, out: Any) -> Any:
    for i in range(len(out)):
        out[i] = pair.a[i, 0] * x + pair.b[i] + math.sin(x) * k
    if nothing is not None or flag:
        return k, x
    return -k, -x


def arguments(rows: Any = None) -> tuple[Any, ...]:
    rows = np.arange(6.0).reshape(3, 2) if rows is None else rows
    return Pair(rows, np.arange(3, dtype=np.float32)), 2.5, 7, True, None, np.zeros(3)


def expected(args: tuple[Any, ...]) -> tuple[Any, Any]:
    mine = (*args[:5], np.zeros(3))
    return _mix(*mine), mine[5]


def fresh() -> Any:
    return njit(entry=True)(_mix)


def test_loaded_code_answers_as_compiled_code_does(kernel_folder: Path) -> None:
    for kernel in (fresh(), fresh()):
        args = arguments()
        answer, out = expected(args)
        assert kernel(*args) == answer
        np.testing.assert_array_equal(args[5], out)
        assert len(list(kernel_folder.glob("*.code"))) == 1


def test_arrays_of_other_layouts_get_code_of_their_own(kernel_folder: Path) -> None:
    kernel = fresh()
    for rows in (np.arange(6.0).reshape(2, 3).T, np.arange(12.0).reshape(6, 2)[::2]):
        args = arguments(rows)
        kernel(*args)
        np.testing.assert_array_equal(args[5], expected(args)[1])
    assert len(list(kernel_folder.glob("*.code"))) == 2


def damages() -> dict[str, Callable[[bytes], bytes]]:
    def flipped(at: int) -> Callable[[bytes], bytes]:
        return lambda data: data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]

    return {
        "nothing": lambda data: b"",
        "other text": lambda data: b"no kernel\n",
        "cut": lambda data: data[:-7],
        "longer": lambda data: data + b"x",
        "kind of file": flipped(3),
        "digest": flipped(20),
        "length of the head": flipped(49),
        "name of the symbol": flipped(70),
        "machine code": flipped(900),
        "last byte": lambda data: data[:-1] + bytes([data[-1] ^ 1]),
    }


@pytest.mark.parametrize("damage", damages())
def test_damaged_code_is_compiled_again_and_replaced(kernel_folder: Path, damage: str) -> None:
    fresh()(*arguments())
    (path,) = kernel_folder.glob("*.code")
    whole = path.read_bytes()
    path.write_bytes(damages()[damage](whole))
    args = arguments()
    fresh()(*args)
    np.testing.assert_array_equal(args[5], expected(args)[1])
    assert unpack(path.name, path.read_bytes()) is not None


def test_where_nothing_can_be_kept_kernels_run_all_the_same(
    tmp_path: Path, kernel_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("a file")
    opened.cache_clear()
    args = arguments()
    assert fresh()(*args) == expected(args)[0]
    assert not is_cached(fresh())


def test_what_is_said_of_compiling_is_true(
    kernel_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    announce_compiling(fresh(), "a moment")
    assert "kept for later runs: a moment" in capsys.readouterr().err
    opened().failure = "no room"
    tell_unkept()
    assert "no room" in capsys.readouterr().err
    fresh()(*arguments())
    opened.cache_clear()
    announce_compiling(fresh(), "a moment")
    tell_unkept()
    assert not capsys.readouterr().err
    monkeypatch.setenv("PCSG_CACHE", __file__)
    opened.cache_clear()
    announce_compiling(fresh(), "a moment")
    told = capsys.readouterr().err
    assert "at every run" in told
    assert __file__ in told
    assert "PCSG_CACHE" in told


class Turned(NamedTuple):
    b: Any
    a: Any


def test_tuples_of_other_fields_are_other_types() -> None:
    told = []
    for kind in (Pair, Turned, Turned):
        kinds: list[Any] = []
        flatten(kind(1, 2.0), kinds, [])
        told.append(describe_kinds(kinds))
    assert told[0] != told[1] == told[2]
    Turned.__qualname__, before = Pair.__qualname__, Turned.__qualname__
    try:
        assert describe_kinds([Turned, 2, "i", "f"]) != told[0]
    finally:
        Turned.__qualname__ = before


def test_types_that_kernels_do_not_take_are_named() -> None:
    with pytest.raises(TypeError, match="list"):
        flatten([1.0], [], [])


def test_numbers_keep_their_kinds() -> None:
    kinds: list[Any] = []
    words: list[Any] = []
    flatten((True, 3, np.float64(2.5), np.uint64(1 << 63), None), kinds, words)
    assert kinds == [tuple, 5, "b", "i", "f", "u", "none"]
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
    kernel_folder: Path,
) -> None:
    import numba
    from numba.core.registry import cpu_target

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


_ALONE = """
import sys
import numpy as np
from pcsg.jit import njit

@njit(entry=True)
def double(x, out):
    for i in range(len(out)):
        out[i] = 2.0 * x
    return x + 1.0, 3

out = np.zeros(2)
print(double(4.0, out), *out, 'numba' in sys.modules)
"""


def run_alone(text: str, *flags: str, **env: str) -> subprocess.Popen[str]:
    """Start a process of its own that runs a script from a file."""
    line = [sys.executable, *flags, "-c", text]
    return subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, **env}
    )


def said(process: subprocess.Popen[str]) -> str:
    out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    return out


def test_of_many_processes_one_compiles(tmp_path: Path) -> None:
    started = [run_alone(_ALONE, PCSG_CACHE=str(tmp_path)) for _ in range(4)]
    assert sorted(said(p) for p in started) == ["(5.0, 3) 8.0 8.0 False\n"] * 3 + [
        "(5.0, 3) 8.0 8.0 True\n"
    ]
    assert {path.suffix for path in (tmp_path / "kernels").iterdir()} == {".code", ""}


def test_a_process_with_a_spoilt_file_says_the_same(tmp_path: Path) -> None:
    first = said(run_alone(_ALONE, PCSG_CACHE=str(tmp_path)))
    (path,) = (tmp_path / "kernels").glob("*.code")
    # In the head, whose length stands at 46, and in the machine code.
    for at in (60, -400):
        data = bytearray(path.read_bytes())
        data[at] ^= 1
        path.write_bytes(data)
        assert said(run_alone(_ALONE, PCSG_CACHE=str(tmp_path))) == first
        assert path.read_bytes() != data


def test_a_process_without_a_cache_leaves_no_folder_behind(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "tmp").mkdir()
    place = {"PCSG_CACHE": str(tmp_path / "file"), "TMPDIR": str(tmp_path / "tmp")}
    assert said(run_alone(_ALONE, **place)) == "(5.0, 3) 8.0 8.0 True\n"
    assert not list((tmp_path / "tmp").iterdir())


_MISSING = """
import numba.core.codegen
{spoil}
from pcsg import compilation
from pcsg.jit import function_address, njit
import ctypes
import numpy as np

def square(x):
    return x * x

inner = njit(square)

@njit(entry=True)
def outer(x, out):
    out[0] = inner(x)
    return x + 1.0, 3

out = np.zeros(1)
print(compilation.is_linkable(), outer(4.0, out), *out)

def add(k, x):
    return k + np.int64(x)

address = function_address("int64(int64, float64)", add)
result = ctypes.c_int64()
call = ctypes.CFUNCTYPE(ctypes.c_int32, *[ctypes.c_void_p] * 2, ctypes.c_int64, ctypes.c_double)
print(call(address)(ctypes.addressof(result), None, 40, 2.5), result.value)
"""


@pytest.mark.parametrize(
    ("spoil", "linkable"),
    [
        ("", True),
        ("del numba.core.codegen.JITCodeLibrary", False),
        ("import numba.core.cpu\ndel numba.core.cpu._options_mixin._nrt", False),
    ],
)
def test_where_numba_is_another_it_compiles_in_its_own_way(
    tmp_path: Path, spoil: str, linkable: bool
) -> None:
    script = tmp_path / "script.py"
    # numba reads the source of what it compiles.
    script.write_text(_MISSING.format(spoil=spoil))
    told = said(
        run_alone(f"import runpy; runpy.run_path({str(script)!r})", PCSG_CACHE=str(tmp_path))
    )
    assert told.splitlines() == [f"{linkable} (5.0, 3) 16.0", "0 42"]
    assert bool(list((tmp_path / "kernels").glob("*.code"))) is linkable


def test_pcsg_works_without_docstrings() -> None:
    text = "import pcsg; print(pcsg.loads('rotx(30) uscale(abs(-2)) sphere').bounds.max() >= 2)"
    assert said(run_alone(text, "-OO")) == "True\n"


NAMESAKES = """
import sys
import numpy as np
from pcsg.jit import njit
from pcsg.simd import stay_apart

def make(number):
    @njit
    def inner(out):
        stay_apart()
        for i in range(len(out)):
            out[i] += number
        return number

    @njit(entry=True)
    def kernel(out):
        return inner(out)

    return kernel

for number in map(int, sys.argv[1:]):
    out = np.zeros(2)
    print(make(number)(out), out.tolist())
"""


def test_namesakes_of_several_processes_stay_apart(tmp_path: Path, kernel_folder: Path) -> None:
    file = tmp_path / "namesakes.py"
    file.write_text(NAMESAKES)

    def run(*numbers: str) -> list[str]:
        command = [sys.executable, str(file), *numbers]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    told = [*run("1"), *run("2")]
    assert len(list(kernel_folder.glob("*.code"))) == 2
    assert run("1", "2") == told == ["1 [1.0, 1.0]", "2 [2.0, 2.0]"]
