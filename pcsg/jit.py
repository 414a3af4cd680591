"""The one place where functions become machine code.

Kernels are compiled strictly (IEEE, no contraction) unless they say ``contract=True``, which only
intersection code may. Only the outermost kernels (``entry=True``) are kept on disk, as machine code
(`machine`); what they call is compiled into them. numba is imported when something is compiled,
and not before: that takes longer than many a picture.
"""

from __future__ import annotations

import dis
import linecache
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, update_wrapper
from types import MappingProxyType
from typing import Any, TypeVar, overload

from pcsg.compilation import compile_in_numbas_way, is_linkable
from pcsg.fingerprint import fingerprint
from pcsg.machine import Entry, is_kept, load_function

F = TypeVar("F", bound=Callable[..., Any])


def is_cached(entry: Any) -> bool:
    """Return whether an entry has been compiled before, so that it will start at once."""
    return is_kept(entry.fingerprint)


def _make_inner(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return a dispatcher for a function that other kernels call.

    These calls go to a second dispatcher without the wrapper that Python needs, and calls with
    constants share one version with calls of any value. Together that halves the time to compile.
    """
    if not is_linkable():
        return compile_in_numbas_way(function, options)
    import numba

    unliteral: Any = numba.core.types.unliteral
    compile_with: Any = numba.njit
    outer: Any = compile_with(**options)(function)
    inner: Any = compile_with(**options, no_cpython_wrapper=True)(function)

    def get_call_template(args: Sequence[Any], kws: dict[str, Any]) -> Any:
        return inner.get_call_template(
            tuple(unliteral(a) for a in args),
            {name: unliteral(a) for name, a in kws.items()},
        )

    outer.get_call_template = get_call_template
    outer.get_overload = inner.get_overload
    return outer


class Kernel:
    """A function that becomes machine code when it is first called.

    Parameters
    ----------
    function
        Its source, `py_func`.
    options
        For numba.
    entry
        Whether it is an outermost kernel.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], entry: bool) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = options
        self.entry = Entry(self) if entry else None

    def __call__(self, *args: Any) -> Any:
        """Run it; an entry takes positional arguments only, see `machine`."""
        return self.dispatcher(*args) if self.entry is None else self.entry(*args)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that its machine code depends on; empty where there is none."""
        return fingerprint(self).digest

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of it."""
        return _make_inner(self.py_func, self.targetoptions)

    @property
    def _numba_type_(self) -> Any:
        """The type that numba asks for where another kernel calls this one."""
        from numba.core import types as kinds

        return kinds.Dispatcher(self.dispatcher)


class Intrinsic:
    """A function that writes the compiler's own code where a kernel calls it; see `numba`."""

    def __init__(self, definition: Callable[..., Any]) -> None:
        self._defn = definition

    @cached_property
    def _numba_type_(self) -> Any:
        from numba.core.registry import cpu_target
        from numba.extending import intrinsic

        context = cpu_target.typing_context
        made = intrinsic(self._defn)
        context.refresh()
        return context.resolve_value_type(made)


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
        return Kernel(plain, options, entry)

    return compile_lazily if function is None else compile_lazily(function)


def function_address(signature: str, function: Callable[..., Any]) -> int:
    """Return where a function is, compiled for types as numba writes them; kept on disk.

    Kernels may call it through its address, so that they need not be compiled with it; see
    `load_function`.
    """
    options = {
        "error_model": "numpy",
        "_nrt": False,
        "fastmath": {"contract"},
        "no_cfunc_wrapper": True,
    }
    return load_function(fingerprint(function).digest, signature, function, options)


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
    known: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
    contract: bool = False,
    inline: bool = False,
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
    known
        Kernels that `default` calls, by their names there.
    contract, inline
        As for `njit`.
    """
    inner = ", ".join(arguments)
    lines = [f"def {name}({selector}, {inner}):"]
    scope: dict[str, Any] = dict(known)
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
    return njit(contract=contract, inline=inline)(scope[name])  # type: ignore[no-any-return]
