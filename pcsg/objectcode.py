"""Object files of kernels: put into memory by LLVM, called with arrays as they lie there.

numba's calling convention takes every array apart: two pointers that are null here, number and
size of the items, their address, and shape and strides. The result is written to an address, a
status comes back.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

_LAYOUT = 0x1 | 0x100 | 0x400
"""Of numpy's flags what compiled code depends on: contiguous, aligned, writeable."""

_WORDS = {"b": ctypes.c_int8, "i": ctypes.c_int64, "u": ctypes.c_uint64, "f": ctypes.c_double}


class Code(NamedTuple):
    """A compiled kernel as it is kept.

    Attributes
    ----------
    symbol
        Its name in the object file.
    result
        Letters of the numbers that it returns, ``i`` or ``f``; several for a tuple.
    is_tuple
        Whether they are one.
    needs_numba
        Whether it calls what numba provides.
    content
        The object file.
    """

    symbol: str
    result: str
    is_tuple: bool
    needs_numba: bool
    content: bytes


class _Linker:
    """Puts object files into memory; they stay there."""

    def __init__(self) -> None:
        import llvmlite.binding as llvm

        self._llvm = llvm
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        target = llvm.Target.from_default_triple().create_target_machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)

    def link(self, code: Code) -> int:
        """Return the address of a kernel."""
        if code.needs_numba:
            from numba.core.registry import cpu_target

            # What it provides is known to LLVM once the target is there.
            _ = cpu_target.target_context
        self._engine.add_object_file(self._llvm.ObjectFileRef.from_data(code.content))
        self._engine.finalize_object()
        return int(self._engine.get_function_address(code.symbol))


_linker = cache(_Linker)


def link(code: Code) -> int:
    """Put a kernel into memory and return its address."""
    return _linker().link(code)


def flatten(value: Any, kinds: list[Any], words: list[Any]) -> None:
    """Append what compiled code depends on of a value's type, and the words that it is passed as.

    Raises
    ------
    TypeError
        Kernels cannot take it.
    """
    if isinstance(value, np.ndarray):
        flags = value.flags.num
        layout = flags & _LAYOUT | (0 if flags & 1 else flags & 2)
        kinds += (value.dtype, value.ndim, layout)
        address = value.__array_interface__["data"][0]
        words += (0, 0, value.size, value.itemsize, address, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        kinds += (type(value), len(value))
        for part in value:
            flatten(part, kinds, words)
    elif value is None:
        kinds.append("none")
        words.append(0)
    elif isinstance(value, (bool, np.bool_)):
        kinds.append("b")
        words.append(bool(value))
    elif isinstance(value, (int, np.int64)):
        kinds.append("i")
        words.append(int(value))
    elif isinstance(value, float):
        kinds.append("f")
        words.append(float(value))
    elif isinstance(value, np.uint64):
        kinds.append("u")
        words.append(int(value))
    else:
        raise TypeError(f"kernels do not take {type(value).__name__}")


def describe_kinds(kinds: Sequence[Any]) -> str:
    """Return a text that is equal, in every process, for what is compiled alike.

    A named tuple is told by its fields: kernels take them by name.
    """
    told: list[Any] = []
    for kind in kinds:
        if isinstance(kind, type):
            told += (kind.__module__, kind.__qualname__, getattr(kind, "_fields", ()))
        elif isinstance(kind, np.dtype):
            told.append(kind.descr if kind.fields else kind.str)
        else:
            told.append(kind)
    return repr(told)


def _c_types(value: Any) -> list[Any]:
    """Return the types in C of the words that a value is passed as."""
    if isinstance(value, np.ndarray):
        return [ctypes.c_int64] * (5 + 2 * value.ndim)
    if isinstance(value, tuple):
        return [c for part in value for c in _c_types(part)]
    kinds: list[Any] = []
    flatten(value, kinds, [])
    return [_WORDS.get(kinds[0], ctypes.c_int64)]


def bind(name: str, code: Code, args: Sequence[Any]) -> Callable[..., Any]:
    """Return what calls a kernel with the words of arguments like these.

    Parameters
    ----------
    name
        For the error that it raises where the kernel fails.
    """
    pointer = ctypes.c_void_p
    types = [pointer, pointer, *(c for value in args for c in _c_types(value))]
    function = ctypes.CFUNCTYPE(ctypes.c_int32, *types)(link(code))
    is_tuple = code.is_tuple
    size = 8 * len(code.result)
    layout = "=" + code.result.replace("i", "q").replace("f", "d")

    def call(*words: Any) -> Any:
        # Room for the result, then for a pointer to what went wrong.
        room = ctypes.create_string_buffer(size + 8)
        at = ctypes.addressof(room)
        if function(at, at + size, *words) != 0:
            raise RuntimeError(f"{name} has failed")
        numbers = struct.unpack_from(layout, room)
        if is_tuple:
            return numbers
        return numbers[0] if numbers else None

    return call
