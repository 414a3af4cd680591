"""Machine code is told apart by all that it is made from: old code never runs for new sources."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import pkgutil
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcsg
from pcsg.blobtree.native import answer
from pcsg.commands.compiling import announce_compiling
from pcsg.fingerprint import _content, fingerprint
from pcsg.jit import Intrinsic, Kernel, njit

HEAD = """
from __future__ import annotations
import functools
from typing import NamedTuple
import numpy as np
from pcsg.jit import Intrinsic, njit
"""

# What another module says before and after an edit, and how a kernel uses it.
EDITS = {
    "plain helper of an intrinsic": (
        "def helper():\n    return 1\n",
        "def helper():\n    return 2\n",
        "from dependency import helper\n"
        "def _give(typing):\n"
        "    from numba.core import types\n"
        "    def generate(context, builder, signature, args):\n"
        "        return context.get_constant(types.int64, helper())\n"
        "    return types.int64(), generate\n"
        "give = Intrinsic(_give)\n"
        "@njit(entry=True)\ndef kernel():\n    return give()\n",
    ),
    "inner kernel": (
        "from pcsg.jit import njit\n@njit\ndef inner():\n    return 1\n",
        "from pcsg.jit import njit\n@njit\ndef inner():\n    return 2\n",
        "from dependency import inner\n@njit(entry=True)\ndef kernel():\n    return inner()\n",
    ),
    "module's array": (
        "import numpy as np\ntable = np.array([1, 5])\n",
        "import numpy as np\ntable = np.array([2, 5])\n",
        "from dependency import table\n@njit(entry=True)\ndef kernel():\n    return table[0]\n",
    ),
    "array made from an array": (
        "import numpy as np\nbase = np.array([1, 5])\n",
        "import numpy as np\nbase = np.array([2, 5])\n",
        "import dependency\ntable = dependency.base * 1\n"
        "@njit(entry=True)\ndef kernel():\n    return table[0]\n",
    ),
    "constant": (
        "VALUE = 1\n",
        "VALUE = 2\n",
        "from dependency import VALUE\n@njit(entry=True)\ndef kernel():\n    return VALUE\n",
    ),
    "constant of a module": (
        "VALUE = 1\n",
        "VALUE = 2\n",
        "import dependency\n@njit(entry=True)\ndef kernel():\n    return dependency.VALUE\n",
    ),
    "default argument": (
        "VALUE = 1\n",
        "VALUE = 2\n",
        "import dependency\n@njit\ndef inner(x=dependency.VALUE):\n    return x\n"
        "@njit(entry=True)\ndef kernel():\n    return inner()\n",
    ),
    "closure": (
        "VALUE = 1\n",
        "VALUE = 2\n",
        "import dependency\n"
        "def make(x):\n    def inner():\n        return x\n    return njit(inner)\n"
        "inner = make(dependency.VALUE)\n"
        "@njit(entry=True)\ndef kernel():\n    return inner()\n",
    ),
    "type": (
        "from typing import NamedTuple\nclass Two(NamedTuple):\n    a: int\n    b: int\n",
        "from typing import NamedTuple\nclass Two(NamedTuple):\n    b: int\n    a: int\n",
        "from dependency import Two\n@njit(entry=True)\ndef kernel():\n    return Two(1, 2).a\n",
    ),
    "kind of number": (
        "VALUE = 1\n",
        "VALUE = 1.0\n",
        "from dependency import VALUE\n@njit(entry=True)\ndef kernel():\n    return VALUE\n",
    ),
}


class Edited:
    """A kernel whose module, or the module that this uses, is written anew."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        monkeypatch.syspath_prepend(folder)
        monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def kernel(self, dependency: str, user: str) -> Any:
        for name, text in (("dependency", dependency), ("user", HEAD + user)):
            sys.modules.pop(name, None)
            (self.folder / f"{name}.py").write_text(text)
        importlib.invalidate_caches()
        return importlib.import_module("user").kernel


@pytest.fixture
def edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Edited]:
    yield Edited(tmp_path, monkeypatch)
    for name in ("dependency", "user"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("edit", EDITS)
def test_every_kind_of_dependency_is_noticed(
    edited: Edited, kernel_folder: Path, edit: str
) -> None:
    before, after, user = EDITS[edit]
    assert [edited.kernel(text, user)() for text in (before, after, before)] == [1, 2, 1] or (
        edit == "kind of number"
    )
    assert len(list(kernel_folder.glob("*.code"))) == 2


def test_values_count_that_no_source_tells(edited: Edited) -> None:
    user = EDITS["module's array"][2]
    digests = set()
    for value in (1, 2):
        kernel = edited.kernel(EDITS["module's array"][0], user)
        sys.modules["user"].table = np.array([value])  # type: ignore[attr-defined]
        digests.add(fingerprint(kernel).digest)
    assert len(digests) == 2


def test_the_source_counts_also_where_no_code_differs(edited: Edited) -> None:
    before, _after, user = EDITS["inner kernel"]
    digests = set()
    for text in (before, before + "# more\n"):
        # A process reads a file once.
        _content.cache_clear()
        digests.add(fingerprint(edited.kernel(text, user)).digest)
    assert len(digests) == 2


def test_without_its_source_a_kernel_is_not_kept(edited: Edited) -> None:
    before, _after, user = EDITS["constant"]
    kernel = edited.kernel(before, user)
    (edited.folder / "user.py").unlink()
    _content.cache_clear()
    assert fingerprint(kernel).digest == ""


def test_options_count() -> None:
    def plain(x: float) -> float:
        return x * x + 1.0

    assert fingerprint(njit(plain)).digest != fingerprint(njit(contract=True)(plain)).digest


@pytest.mark.parametrize("name", ["NUMBA_CPU_NAME", "NUMBA_OPT"])
def test_options_of_numba_count(name: str) -> None:
    text = "from pcsg.fingerprint import toolchain; print(toolchain())"
    line = [sys.executable, "-c", text]
    told = {
        subprocess.run(line, env={**os.environ, **env}, capture_output=True, check=True).stdout
        for env in ({}, {name: "1"}, {"NUMBA_NUM_THREADS": "1"})
    }
    assert len(told) == 2


def test_what_cannot_be_digested_is_not_kept(
    kernel_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    thing = object()

    def uses(typing: Any) -> Any:
        from numba.core import types

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return context.get_constant(types.int64, 3 if thing else 4)

        return types.int64(), generate

    give: Any = Intrinsic(uses)

    def kernel() -> int:
        return give()  # type: ignore[no-any-return]

    entry: Any = njit(entry=True)(kernel)
    assert entry() == 3
    assert not list(kernel_folder.parent.rglob("*.code"))
    announce_compiling(entry, "a moment")
    assert "at every run" in capsys.readouterr().err

    def imports() -> object:
        import hypothesis

        return hypothesis

    assert fingerprint(uses).unknown == ("builtins.object",)
    assert fingerprint(imports).unknown == ("import hypothesis",)
    assert fingerprint(imports).digest == ""


def entries() -> dict[str, Any]:
    """Return all that becomes a file of machine code."""
    found: dict[str, Any] = {"pcsg.blobtree.native.answer": answer}
    for module in pkgutil.walk_packages(pcsg.__path__, "pcsg."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(importlib.import_module(module.name)).items():
            if isinstance(value, Kernel) and value.entry and value.__module__ == module.name:
                found[f"{module.name}.{name}"] = value
    return found


def plain_function(thing: Any) -> types.FunctionType | None:
    for attribute in ("py_func", "_defn", "__func__", "__wrapped__"):
        inner = inspect.getattr_static(thing, attribute, None)
        if isinstance(inner, types.FunctionType):
            return inner
    return thing if isinstance(thing, types.FunctionType) else None


def reached(kernel: Any) -> Iterator[Any]:
    """Yield all functions, types and values that a kernel names, found by other means."""
    todo, seen = [kernel], set()
    while todo:
        thing = todo.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        yield thing
        function = plain_function(thing)
        if function is None:
            continue
        home = function.__globals__.get("__name__", "").partition(".")[0]
        if home in sys.stdlib_module_names | {"numba", "numpy", "llvmlite"}:
            continue
        names = inspect.getclosurevars(function)
        todo += [*names.globals.values(), *names.nonlocals.values(), *(function.__defaults__ or ())]
        # Functions within it name what they use themselves.
        codes = [c for c in function.__code__.co_consts if isinstance(c, types.CodeType)]
        while codes:
            code = codes.pop()
            codes += [c for c in code.co_consts if isinstance(c, types.CodeType)]
            todo += [function.__globals__[n] for n in code.co_names if n in function.__globals__]


ENTRIES = entries()


def test_there_are_entries() -> None:
    assert len(ENTRIES) > 20
    inside = [t for t in reached(ENTRIES["pcsg.trace.batch.trace_batch"]) if isinstance(t, Kernel)]
    assert len(inside) > 50


@pytest.mark.parametrize("name", ENTRIES)
def test_all_that_a_kernel_reaches_is_in_its_digest(name: str) -> None:
    found = fingerprint(ENTRIES[name])
    # Nothing has to be compiled in every process.
    assert found.unknown == ()
    for thing in reached(ENTRIES[name]):
        function = plain_function(thing)
        module = None
        if function is not None:
            module = function.__globals__.get("__name__")
        elif isinstance(thing, type):
            module = thing.__module__
        if module is not None and module.startswith("pcsg"):
            assert Path(sys.modules[module].__file__ or "") in found.files


def test_no_kernel_is_changed_through_registries_of_numba() -> None:
    """Such changes would be reached from nowhere."""
    names = ("overload", "register_jitable", "overload_method", "lower_builtin", "register_model")
    for path in (Path(pcsg.__file__).parent).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not any(f"import {name}" in text or f"numba.{name}" in text for name in names)


_OUTSIDE = """
import sys
from pathlib import Path
from pcsg.leaf.registry import Solid, leaf
from outside_help import SIDE

@leaf
class Outside(Solid):
    @staticmethod
    def crossings(ray, want, args, at, pool, t, n):
        t[n], t[n + 1] = SIDE, 2.0
        return n + 2
"""

_PRINT_ALL = """
import importlib, json, sys
sys.path[:0] = {folder!r}, {tests!r}
import {module}
from test_fingerprint import ENTRIES, fingerprint
print(json.dumps({{name: fingerprint(entry).digest for name, entry in ENTRIES.items()}}))
"""


def digests(folder: Path, module: str, seed: str) -> dict[str, str]:
    """Return the digests that a process of its own finds."""
    tests = str(Path(__file__).parent)
    text = _PRINT_ALL.format(folder=str(folder), tests=tests, module=module)
    env = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONDONTWRITEBYTECODE": "1"}
    line = [sys.executable, "-c", text]
    done = subprocess.run(line, env=env, capture_output=True, text=True, check=True, timeout=120)
    told: dict[str, str] = json.loads(done.stdout)
    return told


def test_digests_are_the_same_in_every_process_but_for_leaves_of_others(tmp_path: Path) -> None:
    (tmp_path / "outside.py").write_text(_OUTSIDE)
    (tmp_path / "outside_help.py").write_text("SIDE = 1.0\n")
    mine = {name: fingerprint(entry).digest for name, entry in ENTRIES.items()}
    assert digests(tmp_path, "json", "1") == mine
    first = digests(tmp_path, "outside", "2")
    (tmp_path / "outside_help.py").write_text("SIDE = 1.5\n")
    second = digests(tmp_path, "outside", "3")
    differ = {name for name in mine if len({mine[name], first[name], second[name]}) == 3}
    same = {name for name in mine if len({mine[name], first[name], second[name]}) == 1}
    assert {"pcsg.trace.batch.trace_batch", "pcsg.trace.blocks_batch.find_batch"} <= differ
    assert differ | same == set(mine)
    assert "pcsg.render.bsdf.scatter_batch" in same
