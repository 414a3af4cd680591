"""The one place where functions become machine code.

Kernels are compiled strictly (IEEE, no contraction) unless they say ``contract=True``, which only
intersection code may. Only the outermost kernels (``entry=True``) are cached on disk; what they
call is compiled into them. The cache lies in a folder named by a hash of the package's sources,
because numba's own key knows neither globals nor functions of other files.
"""

from __future__ import annotations

import dis
import hashlib
import linecache
import tempfile
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])

_config: Any = numba.config


@cache
def cache_folder() -> Path:
    """Return the folder of the compiled kernels of exactly these sources."""
    digest = hashlib.sha256(numba.__version__.encode())
    package = Path(__file__).parent
    for file in sorted(package.rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    folder = Path(platformdirs.user_cache_dir("pcsg")) / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix=f"pcsg-{name}-"))
    return folder


@contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """Let numba place caches in a folder, without changing it for the user's own functions."""
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        _config.CACHE_DIR = before


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
            "fastmath": {"contract"} if contract else False,
        }
        if inline:
            options["forceinline"] = True
        if not entry:
            return numba.njit(**options)(plain)
        with _cache_in(cache_folder()):
            return numba.njit(nogil=True, cache=True, **options)(plain)

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
