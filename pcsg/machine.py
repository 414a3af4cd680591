"""Machine code of kernels: kept on disk, loaded by LLVM, called with arrays as they lie in memory.

numba compiles; what it has compiled is called without it. Its calling convention takes every
array apart: two pointers that are null here, number and size of the items, their address, and
shape and strides. The result is written to an address, a status comes back.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
import platformdirs

from pcsg.compilation import Code, compile_function, compile_kernel

_STALE_AFTER = 30 * 24 * 3600.0

_LAYOUT = 0x1 | 0x100 | 0x400
"""Of numpy's flags what compiled code depends on: contiguous, aligned, writeable."""

_WORDS = {"b": ctypes.c_int8, "i": ctypes.c_int64, "u": ctypes.c_uint64, "f": ctypes.c_double}

_LOCK = RLock()


@cache
def compiler() -> str:
    """Return a name of all that machine code depends on besides its source."""
    import llvmlite.binding as llvm

    spec = find_spec("numba")
    place = Path(spec.origin).parent.parent if spec and spec.origin else Path()
    release = sorted(path.name for path in place.glob("numba-*.dist-info"))
    features = llvm.get_host_cpu_features().flatten()
    # How code is made, and how it is called.
    files = (Path(__file__), Path(__file__).with_name("compilation.py"))
    convention = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    return f"{release} {sys.version} {llvm.get_host_cpu_name()} {features} {convention}"


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


def _read(path: Path) -> Code | None:
    """Return what is kept in a file, None if there is none or it is not whole."""
    try:
        head, _, content = path.read_bytes().partition(b"\n")
        about = json.loads(head)
    except (OSError, ValueError):
        return None
    if about.pop("digest", "") != hashlib.sha256(content).hexdigest():
        return None
    return Code(**about, content=content)


def _write(path: Path, code: Code) -> None:
    """Keep a compiled kernel; where that is not possible it is compiled again next time."""
    about = {**code._asdict(), "digest": hashlib.sha256(code.content).hexdigest()}
    del about["content"]
    try:
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(json.dumps(about).encode() + b"\n" + code.content)
        Path(name).replace(path)
    except OSError:
        pass


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


def load_function(fingerprint: str, signature: str, function: Any, options: dict[str, Any]) -> int:
    """Return the address of a function, compiled or loaded.

    It is called as numba does: the address of the result, one for what went wrong, the arguments.

    Parameters
    ----------
    fingerprint
        Of the function and all that is compiled into it.
    signature
        As numba writes it.
    """
    name = hashlib.sha256(signature.encode()).hexdigest()[:16]
    path = cache_folder(fingerprint) / f"{name}.code"
    with _LOCK:
        code = _read(path)
        if code is None:
            code = compile_function(signature, function, options)
            _write(path, code)
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
        kinds += (value.dtype.str, value.ndim, layout)
        address = value.__array_interface__["data"][0]
        words += (0, 0, value.size, value.itemsize, address, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        kinds += (type(value).__qualname__, len(value))
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


def _c_types(value: Any) -> list[Any]:
    """Return the types in C of the words that a value is passed as."""
    if isinstance(value, np.ndarray):
        return [ctypes.c_int64] * (5 + 2 * value.ndim)
    if isinstance(value, tuple):
        return [c for part in value for c in _c_types(part)]
    kinds: list[Any] = []
    flatten(value, kinds, [])
    return [_WORDS.get(kinds[0], ctypes.c_int64)]


class Entry:
    """An outermost kernel as Python calls it: compiled or loaded once for each kind of arguments.

    Calls release the interpreter's lock.
    """

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._bound: dict[tuple[Any, ...], Callable[..., Any]] = {}

    def __call__(self, *args: Any) -> Any:
        """Call it with arrays, numbers, None, and tuples of them."""
        kinds: list[Any] = []
        words: list[Any] = []
        for value in args:
            flatten(value, kinds, words)
        key = tuple(kinds)
        call = self._bound.get(key)
        if call is None:
            with _LOCK:
                call = self._bound.get(key) or self._bind(key, args)
                self._bound[key] = call
        return call(*words)

    def _bind(self, key: tuple[Any, ...], args: Sequence[Any]) -> Callable[..., Any]:
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        path = cache_folder(self._kernel.fingerprint) / f"{name}.code"
        code = _read(path)
        if code is None:
            code = compile_kernel(self._kernel, args)
            _write(path, code)
        address = _linker().link(code)
        pointer = ctypes.c_void_p
        types = [pointer, pointer, *(c for value in args for c in _c_types(value))]
        function = ctypes.CFUNCTYPE(ctypes.c_int32, *types)(address)
        is_tuple = code.is_tuple
        size = 8 * len(code.result)
        layout = "=" + code.result.replace("i", "q").replace("f", "d")

        def call(*words: Any) -> Any:
            # Room for the result, then for a pointer to what went wrong.
            room = ctypes.create_string_buffer(size + 8)
            at = ctypes.addressof(room)
            if function(at, at + size, *words) != 0:
                raise RuntimeError(f"{self._kernel.__name__} has failed")
            numbers = struct.unpack_from(layout, room)
            if is_tuple:
                return numbers
            return numbers[0] if numbers else None

        return call
