"""Kernels become object files: numba writes LLVM's code, and LLVM is asked once.

numba optimizes every function with all that it calls, and makes machine code of it, before its
callers are looked at; of a call tree that is most of the time. Here functions are only linked, and
the outermost one is optimized with everything in it. That takes parts of numba that are not
promised to stay; where one is missing, numba compiles in its own way.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from pcsg.objectcode import Code, bind, flatten

USED_OF_DISPATCHERS = ("get_call_template", "get_overload")
"""What `jit` replaces of numba's dispatchers."""


@cache
def _library_class() -> Any:
    """Return what numba shall collect the code of a function in."""
    from numba.core.codegen import JITCodeLibrary

    class LinkedLibrary(JITCodeLibrary):
        """Code that is linked into its callers' and never run by itself."""

        @property
        def codegen(self) -> Any:
            return self

        def set_env(self, _name: str, _environment: Any) -> None:
            """Do nothing: what Python would need of a function is not there."""

        def get_pointer_to_function(self, _name: str) -> int:
            return 0

        def finalize(self) -> None:
            for library in dict.fromkeys(self._linking_libraries):
                module = library._get_module_for_linking()
                self._final_module.link_in(module, preserve=True)
            self._finalized = True

    return LinkedLibrary


@contextmanager
def _linking() -> Iterator[None]:
    """Have numba link what it compiles, and no more."""
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    with global_compiler_lock:
        codegen = cpu_target.target_context.codegen()
        before = codegen._library_class
        codegen._library_class = _library_class()
        try:
            yield
        finally:
            codegen._library_class = before


def _is_known(symbol: str) -> bool:
    """Return whether a function is there in every process."""
    return sys.platform != "win32" and hasattr(ctypes.CDLL(None), symbol)


def compile_kernel(kernel: Any, args: Sequence[Any]) -> Code:
    """Compile a kernel for the types of some arguments."""
    import numba

    compile_with: Any = numba.njit
    kinds: Any = numba.core.types
    dispatcher = compile_with(**kernel.targetoptions, no_cpython_wrapper=True)(kernel.py_func)
    signature = tuple(numba.typeof(a) for a in args)
    with _linking():
        dispatcher.compile(signature)
    compiled = dispatcher.overloads[signature]
    returned = kinds.unliteral(compiled.signature.return_type)
    is_tuple = isinstance(returned, kinds.BaseTuple)
    letters = ""
    for kind in tuple(returned) if is_tuple else (returned,):
        if kind == kinds.none:
            continue
        letters += {kinds.int64: "i", kinds.float64: "f"}[kinds.unliteral(kind)]
    return _code(compiled.library, compiled.fndesc.llvm_func_name, letters, is_tuple)


def compile_function(signature: str, function: Any, options: dict[str, Any]) -> Code:
    """Compile a function for types as numba writes them."""
    import numba

    compile_with: Any = numba.njit
    with _linking():
        dispatcher = compile_with(signature, **options, no_cpython_wrapper=True)(function)
    (compiled,) = dispatcher.overloads.values()
    return _code(compiled.library, compiled.fndesc.llvm_func_name, "", False)


def _code(library: Any, entry: str, result: str, is_tuple: bool) -> Code:
    """Optimize the whole of a linked library, and return what is kept of it.

    numba numbers functions in the order of a process, so those of two processes may have the same
    name, and what is loaded first would serve for both. Here every object file keeps its functions
    to itself, and its entry is called by a digest.
    """
    library._ensure_finalized()
    library._optimize_final_module()
    module = library._final_module
    text = str(module)
    called = re.findall(r"declare [^@]*@\"?(?!llvm\.)([\w.]+)", text)
    symbol = f"pcsg_{hashlib.sha256(text.encode()).hexdigest()[:32]}"
    for function in module.functions:
        if function.name == entry:
            function.name = symbol
        elif not function.is_declaration:
            function.linkage = "internal"
    module.verify()
    return Code(
        symbol=symbol,
        result=result,
        is_tuple=is_tuple,
        needs_numba=not all(_is_known(name) for name in called),
        content=library._codegen._tm.emit_object(module),
    )


def _plain_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return of a kernel's options those that numba promises to know."""
    return {name: options[name] for name in ("error_model", "fastmath") if name in options}


def compile_in_numbas_way(function: Any, options: dict[str, Any], *, nogil: bool = False) -> Any:
    """Return numba's dispatcher for a function, made with nothing but what numba promises."""
    import numba

    compile_with: Any = numba.njit
    return compile_with(**_plain_options(options), nogil=nogil)(function)


_CALLBACKS: list[Any] = []
"""What addresses were given of: it must stay."""


def address_in_numbas_way(signature: str, function: Any, options: dict[str, Any]) -> int:
    """Return the address of a function that is called as one of `compile_function` is."""
    import numba

    compile_with: Any = numba.cfunc
    result, _, rest = signature.partition("(")
    names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
    scope = {"inner": compile_in_numbas_way(function, options)}
    exec(f"def adapt(result, nothing, {names}):\n result[0] = inner({names})\n return 0", scope)
    adapted = f"int32(CPointer({result}), CPointer(int8), {rest}"
    _CALLBACKS.append(compile_with(adapted, **_plain_options(options))(scope["adapt"]))
    return int(_CALLBACKS[-1].address)


class _Pair(NamedTuple):
    a: Any
    b: float


def _sample(pair: Any, k: int, out: Any) -> Any:
    for i in range(len(out)):
        out[i] = pair.a[i] + pair.b
    return k + 1, pair.b * k


class _Sample:
    """A kernel to try on."""

    py_func = staticmethod(_sample)
    targetoptions = MappingProxyType(
        {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "forceinline": False}
    )


@cache
def is_linkable() -> bool:
    """Return whether numba has all that is used here, as it is used: tried on a small kernel."""
    args = (_Pair(np.arange(3.0), 0.5), 7, np.zeros(3))
    kinds: list[Any] = []
    words: list[Any] = []
    for value in args:
        flatten(value, kinds, words)
    try:
        from numba.core.dispatcher import Dispatcher

        answer = bind("sample", compile_kernel(_Sample, args), args)(*words)
    except Exception:
        # Whatever it is that is missing: there is another way.
        return False
    is_right = answer == (8, 3.5) and args[2].tolist() == [0.5, 1.5, 2.5]
    return is_right and all(hasattr(Dispatcher, name) for name in USED_OF_DISPATCHERS)
