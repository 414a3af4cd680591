"""The one place where functions become machine code.

Kernels are compiled strictly (IEEE, no contraction) unless they say ``contract=True``, which only
intersection code may. Only the outermost kernels (``entry=True``) are cached on disk; what they
call is compiled into them. numba's own key knows neither globals nor functions of other files, so
the cache of an entry lies in a folder named by a hash of everything that is compiled into it.
"""

from __future__ import annotations

import dis
import hashlib
import linecache
import shutil
import sys
import tempfile
import time
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
import numpy as np
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])

# numba's own types leave out options.
_config: Any = numba.config
_numba_njit: Any = numba.njit
_unliteral: Any = numba.core.types.unliteral


def fingerprint(kernel: Any) -> str:
    """Return a hash of the code and the constants that are compiled into a kernel."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    todo: list[Any] = [kernel]
    seen: set[int] = set()
    while todo:
        item = todo.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        digest.update(repr(getattr(item, "targetoptions", "")).encode())
        function: types.FunctionType = getattr(item, "py_func", getattr(item, "_defn", item))
        codes = [function.__code__]
        names: list[str] = []
        while codes:
            code = codes.pop()
            digest.update(code.co_code)
            names += code.co_names
            for constant in code.co_consts:
                if isinstance(constant, types.CodeType):
                    codes.append(constant)
                elif not isinstance(constant, str):
                    digest.update(repr(constant).encode())
        for name in names:
            value = function.__globals__.get(name)
            digest.update(name.encode())
            if hasattr(value, "py_func") or hasattr(value, "_defn"):
                todo.append(value)
            elif isinstance(value, type):
                digest.update(repr(getattr(value, "__annotations__", value.__name__)).encode())
            elif isinstance(value, (bool, int, float, str, tuple, np.generic)):
                digest.update(repr(value).encode())
    return digest.hexdigest()[:16]


_STALE_AFTER = 30 * 24 * 3600.0


@cache
def cache_folder(name: str) -> Path:
    """Return the folder of compiled kernels with a fingerprint; old ones are cleared away."""
    root = Path(platformdirs.user_cache_dir("pcsg"))
    folder = root / f"kernels-{name}"
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for other in root.glob("kernels-*") if is_new else ():
            if time.time() - other.stat().st_mtime > _STALE_AFTER:
                shutil.rmtree(other, ignore_errors=True)
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix=f"pcsg-kernels-{name}-"))
    return folder


def is_cached(entry: Any) -> bool:
    """Return whether an entry has been compiled before, so that it will start at once."""
    return any(cache_folder(fingerprint(entry.py_func)).rglob("*.nbi"))


@contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """Let numba place caches in a folder, without changing it for the user's own functions."""
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        _config.CACHE_DIR = before


def _make_inner(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return a dispatcher for a function that other kernels call.

    These calls go to a second dispatcher without the wrapper that Python needs, and calls with
    constants share one version with calls of any value. Together that halves the time to compile.
    """
    outer: Any = _numba_njit(**options)(function)
    inner: Any = _numba_njit(**options, no_cpython_wrapper=True)(function)

    def get_call_template(args: Sequence[Any], kws: dict[str, Any]) -> Any:
        return inner.get_call_template(
            tuple(_unliteral(a) for a in args),
            {name: _unliteral(a) for name, a in kws.items()},
        )

    outer.get_call_template = get_call_template
    outer.get_overload = inner.get_overload
    return outer


@overload
def njit(function: F, /) -> F: ...
@overload
def njit(
    *, contract: bool = False, inline: bool = False, entry: bool = False
) -> Callable[[F], F]: ...
def njit(
    function: Any = None, /, *, contract: bool = False, inline: bool = False, entry: bool = False
) -> Any:
    """Compile a function on its first call.

    Parameters
    ----------
    contract
        Allow fused multiply-add. For intersection code only: arithmetic of grammars is strict.
    inline
        Ask LLVM to inline every call. For short leaf functions.
    entry
        An outermost kernel: cached on disk, and releases the GIL.
    """

    def compile_lazily(plain: Callable[..., Any]) -> Any:
        options: dict[str, Any] = {
            "error_model": "numpy",
            # Kernels allocate nothing, so nothing needs counting; counting costs half the time.
            "_nrt": False,
            "fastmath": {"contract"} if contract else False,
            # Nobody calls kernels from C.
            "no_cfunc_wrapper": True,
            # Said also where it is false: functions inherit what their callers say.
            "forceinline": inline,
        }
        if not entry:
            return _make_inner(plain, options)
        with _cache_in(cache_folder(fingerprint(plain))):
            return _numba_njit(nogil=True, cache=True, **options)(plain)

    return compile_lazily if function is None else compile_lazily(function)


@cache
def plain(kernel: Any) -> Callable[..., Any]:
    """Return the Python twin of a kernel.

    It runs the same source and calls twins only, so that evaluating in Python compiles nothing.
    """
    function: types.FunctionType = getattr(kernel, "py_func", kernel)
    scope = dict(function.__globals__)
    # Not `co_names`: these have attributes too, such as the `sin` of `math.sin`.
    names = {i.argval for i in dis.get_instructions(function) if i.opname == "LOAD_GLOBAL"}
    for name in names:
        if hasattr(scope.get(name), "py_func"):
            scope[name] = plain(scope[name])
    return types.FunctionType(
        function.__code__,
        scope,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )


def build_ladder(
    name: str,
    selector: str,
    arguments: Sequence[str],
    cases: Sequence[Callable[..., Any] | None],
    default: str,
    *,
    calls: Sequence[str] | None = None,
    contract: bool = False,
) -> Callable[..., Any]:
    """Return a kernel that calls ``cases[selector](*arguments)``.

    numba has no fast first-class functions, so the source of an ``if`` ladder is generated and
    registered with `linecache`, where tracebacks and debuggers find it.

    Parameters
    ----------
    cases
        Kernels in the order of the selector's values; None where a value has no kernel.
    default
        Source of the expression that is returned for any other value.
    calls
        Source of the arguments of every case, where they differ from `arguments`.
    """
    inner = ", ".join(arguments)
    lines = [f"def {name}({selector}, {inner}):"]
    scope: dict[str, Any] = {}
    for value, case in enumerate(cases):
        if case is not None:
            scope[f"case_{value}"] = case
            lines.append(f"    if {selector} == {value}:")
            lines.append(f"        return case_{value}({calls[value] if calls else inner})")
    lines.append(f"    return {default}")
    source = "\n".join(lines) + "\n"
    filename = f"<pcsg ladder {name}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(True), filename)
    exec(compile(source, filename, "exec"), scope)
    return njit(contract=contract)(scope[name])  # type: ignore[no-any-return]
