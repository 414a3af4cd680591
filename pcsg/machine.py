"""Machine code of kernels: compiled once, kept on disk, and called without numba.

Importing numba and its type system costs more than many a picture.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from threading import RLock
from typing import Any

from pcsg.codecache import opened
from pcsg.compilation import (
    address_in_numbas_way,
    compile_function,
    compile_in_numbas_way,
    compile_kernel,
    is_linkable,
)
from pcsg.objectcode import Code, bind, describe_kinds, flatten, link

_LOCK = RLock()


def _name(fingerprint: str, kinds: str) -> str:
    """Return the name of the file of a kernel, or function, for some types; empty for none."""
    return fingerprint and f"{fingerprint}-{hashlib.sha256(kinds.encode()).hexdigest()[:32]}.code"


def _keep(name: str, compile_now: Callable[[], Code]) -> Code | None:
    """Return what is kept under a name, or compile it; None where that is not possible."""
    if not name:
        return compile_now() if is_linkable() else None
    cache = opened()
    code = cache.read(name)
    if code is not None:
        return code
    with cache.hold(name):
        # Somebody else may have compiled it meanwhile.
        code = cache.read(name)
        if code is None and is_linkable():
            code = compile_now()
            cache.write(name, code)
    return code


def is_kept(fingerprint: str) -> bool:
    """Return whether a kernel was compiled before, and kept."""
    return bool(fingerprint) and opened().has(f"{fingerprint}-")


def load_function(fingerprint: str, signature: str, function: Any, options: dict[str, Any]) -> int:
    """Return the address of a function, compiled or loaded.

    It is called as numba does: the address of the result, one for what went wrong, the arguments.

    Parameters
    ----------
    fingerprint
        Of the function and all that is compiled into it; empty where nothing may be kept.
    signature
        As numba writes it.
    """
    name = _name(fingerprint, f"{signature} {options}")
    with _LOCK:
        code = _keep(name, lambda: compile_function(signature, function, options))
        if code is None:
            return address_in_numbas_way(signature, function, options)
        return link(code)


class Entry:
    """An outermost kernel as Python calls it: compiled or loaded once for each kind of arguments.

    Calls release the interpreter's lock.
    """

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._bound: dict[tuple[Any, ...], Callable[..., Any]] = {}
        self._plain: Any = None

    def __call__(self, *args: Any) -> Any:
        """Call it with arrays, numbers, None, and tuples of them."""
        if self._plain is not None:
            return self._plain(*args)
        kinds: list[Any] = []
        words: list[Any] = []
        for value in args:
            flatten(value, kinds, words)
        key = tuple(kinds)
        call = self._bound.get(key)
        if call is None:
            with _LOCK:
                call = self._bound.get(key) or self._bind(key, args)
        return self(*args) if call is None else call(*words)

    def _bind(self, key: tuple[Any, ...], args: Sequence[Any]) -> Callable[..., Any] | None:
        """Return what calls it; None where numba must."""
        name = _name(self._kernel.fingerprint, describe_kinds(key))
        code = _keep(name, lambda: compile_kernel(self._kernel, args))
        if code is None:
            kernel = self._kernel
            self._plain = compile_in_numbas_way(kernel.py_func, kernel.targetoptions, nogil=True)
            return None
        call = self._bound[key] = bind(self._kernel.__name__, code, args)
        return call
