"""What the machine code of a kernel depends on, as one digest.

A kernel reaches functions, types and values: by globals, defaults and closures, through ladders
also kernels of leaves that are registered elsewhere, and through intrinsics plain functions that
run while it is compiled. Digested are the code and the values themselves, as they are in memory,
the source files of all modules that are met on the way, and the tools: compiler and processor.
Where something is of a kind that cannot be digested there is no digest, and nothing is kept.
"""

from __future__ import annotations

import dis
import enum
import functools
import hashlib
import os
import sys
import types
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

_RELEASED = sys.stdlib_module_names | {"numpy", "numba", "llvmlite"}
"""Packages whose code is told by their releases."""

_MAKERS = ("fingerprint", "jit", "machine", "compilation", "objectcode")
"""Modules that say how code is made, and how it is called."""

_IRRELEVANT = {"NUMBA_NUM_THREADS", "NUMBA_CACHE_DIR", "NUMBA_THREADING_LAYER"}

_SIMPLE = (type(None), type(...), bool, int, float, complex, str, bytes)

_CODE = (types.FunctionType, staticmethod, classmethod, property)

_DESCRIPTORS = (
    types.MemberDescriptorType,
    types.GetSetDescriptorType,
    type(vars(NamedTuple("_One", [("x", int)]))["x"]),
)
"""How a class finds its instances' values."""

_NO_MEMBERS = {
    *("__annotations__", "__annotate__", "__annotate_func__", "__annotations_cache__"),
    *("__dict__", "__doc__", "__firstlineno__", "__module__", "__orig_bases__", "__parameters__"),
    *("__static_attributes__", "__type_params__", "__weakref__", "__abstractmethods__"),
    *("_abc_impl", "__dataclass_fields__", "__dataclass_params__"),
}
"""What the language itself writes into a class."""

_OF_NAMED_TUPLES = {
    *("__new__", "_make", "_replace", "__replace__", "__repr__", "_asdict", "__getnewargs__"),
}
"""What is made there from the names of the fields."""

_IMPORT = dis.opmap["IMPORT_NAME"]


class Fingerprint(NamedTuple):
    """What was found of a kernel.

    Attributes
    ----------
    digest
        Hexadecimal; empty where something could not be digested.
    files
        Source files that it is taken over.
    unknown
        Kinds of values that could not be digested.
    """

    digest: str
    files: frozenset[Path]
    unknown: tuple[str, ...]


@cache
def toolchain() -> str:
    """Return a text about all that machine code depends on besides its source."""
    import llvmlite
    import llvmlite.binding as llvm

    digest = hashlib.sha256()
    # numba is not imported for its version: that takes longer than many a picture.
    spec = find_spec("numba")
    if spec is not None and spec.origin is not None:
        digest.update(_content(Path(spec.origin).with_name("_version.py")))
    digest.update(_content(Path(".numba_config.yaml")))
    options = {
        name: text
        for name, text in sorted(os.environ.items())
        if name.startswith("NUMBA_") and name not in _IRRELEVANT
    }
    told = (
        digest.hexdigest(),
        llvmlite.__version__,
        llvm.llvm_version_info,
        np.__version__,
        sys.version,
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
        options,
    )
    return repr(told)


@cache
def _content(path: Path) -> bytes:
    """Return a digest of a file, empty where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except OSError:
        return b""


def fingerprint(kernel: Any) -> Fingerprint:
    """Digest all that the machine code of a kernel, or of a function, depends on."""
    digest = hashlib.sha256(toolchain().encode())
    numbers: dict[int, int] = {}
    files = {Path(__file__).with_name(f"{name}.py") for name in _MAKERS}
    unknown: list[str] = []
    todo: list[Any] = [kernel]
    while todo:
        item = todo.pop()
        if _has_identity(item):
            if id(item) in numbers:
                digest.update(b"again %d;" % numbers[id(item)])
                continue
            numbers[id(item)] = len(numbers)
        part = _describe(item)
        digest.update(b"%d:" % len(part.content) + part.content)
        todo += part.reached
        unknown += part.unknown
        files |= part.files
    for path in sorted(files):
        digest.update(path.name.encode() + _content(path))
        if not _content(path):
            unknown.append(f"source of {path}")
    told = "" if unknown else digest.hexdigest()[:32]
    return Fingerprint(told, frozenset(files), tuple(unknown))


def _has_identity(item: Any) -> bool:
    """Return whether it matters that this very thing is met twice; equal constants may be one."""
    return not isinstance(item, (*_SIMPLE, tuple, frozenset, np.generic))


class _Part(NamedTuple):
    """What one thing brings in by itself, and what else it reaches."""

    content: bytes
    reached: tuple[Any, ...] = ()
    files: frozenset[Path] = frozenset()
    unknown: tuple[str, ...] = ()


def _describe(item: Any) -> _Part:
    if isinstance(item, types.FunctionType):
        return _describe_function(item)
    if isinstance(item, _SIMPLE):
        return _Part(f"{type(item).__name__} {item!r}".encode())
    if hasattr(item, "py_func"):
        return _Part(f"kernel {getattr(item, 'targetoptions', None)!r}".encode(), (item.py_func,))
    if isinstance(item, type):
        return _describe_class(item)
    if hasattr(item, "_defn"):
        return _Part(b"intrinsic", (item._defn,))
    return _describe_value(item)


def _describe_value(item: Any) -> _Part:
    """Describe an object that is neither code nor a type."""
    kind = type(item)
    name = f"{kind.__module__}.{kind.__qualname__}".encode()
    if isinstance(item, enum.Enum):
        return _Part(name + item.name.encode(), (kind, item.value))
    if isinstance(item, np.generic):
        return _Part(name + item.dtype.str.encode() + item.tobytes())
    if isinstance(item, np.ndarray) and not item.dtype.hasobject:
        about = f"{item.dtype.descr} {item.shape} {item.strides} {item.flags.num}"
        return _Part(name + about.encode() + item.tobytes())
    if isinstance(item, (tuple, list)):
        return _Part(name + b"%d" % len(item), (*(() if kind in (tuple, list) else (kind,)), *item))
    if isinstance(item, dict):
        return _Part(name + b"%d" % len(item), (*item.keys(), *item.values()))
    if isinstance(item, (set, frozenset)) and all(isinstance(x, _SIMPLE) for x in item):
        return _Part(name + repr(sorted(map(repr, item))).encode())
    if isinstance(item, functools.partial):
        return _Part(name, (item.func, item.args, item.keywords))
    if isinstance(item, (staticmethod, classmethod)):
        return _Part(name, (item.__func__,))
    if isinstance(item, property):
        return _Part(name, (item.fget, item.fset, item.fdel))
    if isinstance(item, types.MethodType):
        return _Part(name, (item.__func__, item.__self__))
    if hasattr(item, "__wrapped__"):
        return _Part(name, (item.__wrapped__,))
    if _is_told_by_name(item):
        return _Part(name + f"{item.__module__}.{item.__qualname__}".encode())
    if _is_told_by_text(kind):
        return _Part(name + repr(item).encode() + str(item).encode())
    return _Part(name, unknown=(name.decode(),))


def _is_released(module: str | None) -> bool:
    return module is not None and module.partition(".")[0] in _RELEASED


def _is_told_by_name(item: Any) -> bool:
    """Return whether something is a function of a released package, such as a ufunc."""
    owner = getattr(item, "__self__", None)
    return (
        isinstance(item, (types.BuiltinFunctionType, np.ufunc))
        and (owner is None or isinstance(owner, types.ModuleType))
        and _is_released(getattr(item, "__module__", None))
    )


def _is_told_by_text(kind: type) -> bool:
    """Return whether objects of a type are equal where they are written alike."""
    if kind.__module__.startswith(("llvmlite.ir.types", "numba.core.types")):
        return True
    return kind.__module__ == "typing" or kind in (
        types.GenericAlias,
        types.UnionType,
        np.dtype,
        range,
        slice,
    )


def _describe_class(item: type) -> _Part:
    name = f"class {item.__module__}.{item.__qualname__}"
    if _is_released(item.__module__):
        return _Part(name.encode())
    fields = getattr(item, "_fields", ())
    if issubclass(item, enum.Enum):
        fields = [member.name for member in item]
        members = [member.value for member in item]
        members += [value for value in vars(item).values() if isinstance(value, _CODE)]
    else:
        members = [
            value
            for key, value in vars(item).items()
            if key not in _NO_MEMBERS
            and not (fields and key in _OF_NAMED_TUPLES)
            and not isinstance(value, _DESCRIPTORS)
        ]
    bases = [base for base in item.__mro__[1:] if not _is_released(base.__module__)]
    return _Part(f"{name} {fields}".encode(), (*bases, *members), _files_of(item.__module__))


@cache  # many kernels reach the same ones
def _describe_function(item: types.FunctionType) -> _Part:
    module = item.__globals__.get("__name__")
    about = f"function {module}.{item.__qualname__}"
    if _is_released(module):
        return _Part(about.encode())
    content = [about]
    names: dict[str, None] = {}
    unknown: list[str] = []
    constants: list[Any] = []
    codes = [item.__code__]
    while codes:
        code = codes.pop()
        content.append(repr(_code_facts(code)))
        names.update(dict.fromkeys(code.co_names))
        for constant in code.co_consts:
            (codes if isinstance(constant, types.CodeType) else constants).append(constant)
        unknown += [f"import {name}" for name in _imports(code) if not _is_released(name)]
    reached: list[Any] = [*constants, item.__defaults__, item.__kwdefaults__]
    for cell in item.__closure__ or ():
        try:
            reached.append(cell.cell_contents)
        except ValueError:
            content.append("empty cell")
    files = _files_of(module)
    for name in names:
        if name not in item.__globals__:
            content.append(name)
            continue
        content.append(f"{name} is global")
        value = item.__globals__[name]
        for thing, path in _attributes(value, names):
            if isinstance(thing, types.ModuleType):
                content.append(f"{path} module {thing.__name__}")
                files |= _files_of(thing.__name__)
            else:
                content.append(path)
                reached.append(thing)
    return _Part("\n".join(content).encode(), tuple(reached), files, tuple(unknown))


def _attributes(value: Any, names: dict[str, None]) -> Iterator[tuple[Any, str]]:
    """Yield a global; of a module that is not released, all that code with these names may take."""
    todo = [(value, "")]
    seen: set[int] = set()
    while todo:
        thing, path = todo.pop()
        yield thing, path
        if not isinstance(thing, types.ModuleType) or _is_released(thing.__name__):
            continue
        if id(thing) not in seen:
            seen.add(id(thing))
            todo += [(vars(thing)[name], f"{path}.{name}") for name in names if name in vars(thing)]


def _code_facts(code: types.CodeType) -> tuple[Any, ...]:
    """Return what code does, and nothing about where it stands."""
    return (
        code.co_code,
        code.co_exceptiontable,
        code.co_flags,
        code.co_argcount,
        code.co_posonlyargcount,
        code.co_kwonlyargcount,
        code.co_varnames,
        code.co_freevars,
        code.co_cellvars,
        code.co_names,
    )


def _imports(code: types.CodeType) -> list[str]:
    """Return the modules that code imports when it runs."""
    # Bytes that are arguments may look like the instruction; then `dis` finds none.
    if _IMPORT not in code.co_code[::2]:
        return []
    return [str(i.argval) for i in dis.get_instructions(code) if i.opcode == _IMPORT]


_path = cache(Path)


def _files_of(module: str | None) -> frozenset[Path]:
    """Return the source file of a module, if there is one that is not released."""
    file = getattr(sys.modules.get(module or ""), "__file__", None)
    return frozenset([_path(file)]) if file and not _is_released(module) else frozenset()
