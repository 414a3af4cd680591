"""Arrays and functions at addresses: what is compiled once, for callers that know numbers only.

A tuple of arrays is passed as *words*: for every array its address and its length, for a number
itself. So a function with a hundred arrays has one argument, and is not compiled into its callers.
"""

from __future__ import annotations

import linecache
from collections.abc import Callable
from typing import Any, get_type_hints

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from pcsg.indices import wide
from pcsg.jit import Intrinsic, njit


def make_array(context: Any, builder: Any, kind: Any, data: Any, length: Any) -> Any:
    """Return an array of numba's at a pointer, while code is generated."""
    from numba.core import cgutils, types
    from numba.np.arrayobj import populate_array

    itemsize = context.get_constant(types.intp, kind.bitwidth // 8)
    array = context.make_array(types.Array(kind, 1, "C"))(context, builder)
    populate_array(
        array,
        data=data,
        shape=cgutils.pack_array(builder, [length]),
        strides=cgutils.pack_array(builder, [itemsize]),
        itemsize=itemsize,
        meminfo=None,
    )
    return array._getvalue()


def _view_at(item: str) -> Any:
    """Return an intrinsic for an array at an address."""

    def view_at(typing_context: Any, address: Any, length: Any) -> Any:
        from numba.core import types

        kind = getattr(types, item)

        def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
            number, count = (
                context.cast(builder, a, k, types.int64)
                for a, k in zip(args, given.args, strict=True)
            )
            data = builder.inttoptr(number, context.get_data_type(kind).as_pointer())
            return make_array(context, builder, kind, data, count)

        return types.Array(kind, 1, "C")(address, length), generate

    return Intrinsic(view_at)


_ITEMS = ("int8", "int32", "int64", "uint64", "float32", "float64")
_VIEWS: dict[str, Any] = {item: _view_at(item) for item in _ITEMS}


FAR = 1 << 60
"""The length of an array of which the pointer is all that is known."""


def _view(item: str) -> Any:
    """Return an intrinsic for an array of a length at a pointer."""

    def view(typing_context: Any, pointer: Any, length: Any) -> Any:
        from numba.core import types

        kind = getattr(types, item)

        def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
            count = context.cast(builder, args[1], given.args[1], types.intp)
            return make_array(context, builder, kind, args[0], count)

        return types.Array(kind, 1, "C")(pointer, length), generate

    return Intrinsic(view)


view_doubles, view_singles, view_ints = (_view(item) for item in ("float64", "float32", "int32"))
"""``(pointer, length) -> array``"""


def split_address(where: int) -> NDArray[np.int32]:
    """Return an address as two integers, as pools hold it: the upper half comes last."""
    return np.array([where], "<u8").view("<i4").astype(np.int32)


@njit
def join_address(lower: int, upper: int) -> int:
    """Return the address that was split."""
    return (wide(upper) << 32) | (wide(lower) & 0xFFFFFFFF)


def _call_with(typing_context: Any, where: Any, arguments: Any) -> Any:
    """Call a function at an address: tuples one by one, arrays as pointers, 64 bits each."""
    from numba.core import cgutils, types

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        def unfold(value: Any, kind: Any) -> list[Any]:
            if isinstance(kind, types.BaseTuple):
                parts = cgutils.unpack_tuple(builder, value, len(kind))
                pairs: Any = zip(parts, kind, strict=True)  # type: ignore[call-overload]
                return [x for part, its_kind in pairs for x in unfold(part, its_kind)]
            if isinstance(kind, types.Array):
                return [context.make_array(kind)(context, builder, value).data]
            wanted = types.float64 if isinstance(kind, types.Float) else types.int64
            return [context.cast(builder, value, kind, wanted)]

        # The result, and what went wrong, which is nothing: no kernel raises.
        number, nothing = ir.IntType(64), ir.IntType(8).as_pointer()
        result = cgutils.alloca_once(builder, number)
        values = [result, cgutils.alloca_once(builder, nothing)]
        values += unfold(args[1], given.args[1])
        shape = ir.FunctionType(ir.IntType(32), [v.type for v in values])
        at = context.cast(builder, args[0], given.args[0], types.int64)
        builder.call(builder.inttoptr(at, shape.as_pointer()), values)
        return builder.load(result)

    return types.int64(where, arguments), generate


call_with: Any = Intrinsic(_call_with)
"""``(address, arguments) -> int``: the caller knows the signature, nobody checks it."""


def write_words(value: Any, words: list[int]) -> None:
    """Append the words of an array, a whole number, or a tuple of them.

    The arrays must stay where they are as long as somebody has the words.
    """
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError("the array is not in one piece")
        words += (value.ctypes.data, value.size)
    elif isinstance(value, tuple):
        for part in value:
            write_words(part, words)
    else:
        words.append(int(value))


def build_reader(kind: type) -> Callable[[NDArray[np.int64]], Any]:
    """Return a kernel that makes a named tuple of its words."""
    scope: dict[str, Any] = {f"view_{item}": view for item, view in _VIEWS.items()}
    text, _ = _source_of(kind, 0, scope)
    name = f"read_{kind.__name__}"
    source = f"def {name}(words):\n    return {text}\n"
    filename = f"<pcsg reader {name}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(True), filename)
    exec(compile(source, filename, "exec"), scope)
    # Of what is not used nothing is read, but only where it is inlined.
    return njit(inline=True)(scope[name])  # type: ignore[no-any-return]


def _source_of(kind: Any, at: int, scope: dict[str, Any]) -> tuple[str, int]:
    """Return the source that makes a value of words from `at` on, and where they end."""
    if kind is int:
        return f"words[{at}]", at + 1
    if hasattr(kind, "_fields"):
        scope[kind.__name__] = kind
        hints = get_type_hints(kind)
        parts = []
        for field in kind._fields:
            part, at = _source_of(hints[field], at, scope)
            parts.append(part)
        return f"{kind.__name__}({', '.join(parts)})", at
    item = np.dtype(kind.__args__[1].__args__[0]).name
    return f"view_{item}(words[{at}], words[{at + 1}])", at + 2


def _call_at(typing_context: Any, where: Any, words: Any, number: Any) -> Any:
    """Call a function ``int64(CPointer(int64), int64)`` at an address; `words` is one, too."""
    from numba.core import cgutils, types

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        kinds = given.args
        at, first, second = (
            context.cast(builder, a, k, types.int64) for a, k in zip(args, kinds, strict=True)
        )
        whole, nothing = ir.IntType(64), ir.IntType(8).as_pointer()
        # The result, and what went wrong, which is nothing: no kernel raises.
        result = cgutils.alloca_once(builder, whole)
        pointer = builder.inttoptr(first, whole.as_pointer())
        values = [result, cgutils.alloca_once(builder, nothing), pointer, second]
        shape = ir.FunctionType(ir.IntType(32), [v.type for v in values])
        builder.call(builder.inttoptr(at, shape.as_pointer()), values)
        return builder.load(result)

    return types.int64(where, words, number), generate


call_at: Any = Intrinsic(_call_at)
"""``(address, words, number) -> int``"""

CALLED = "int64(CPointer(int64), int64)"
"""The signature of what `call_at` calls."""


def _view_words(typing_context: Any, pointer: Any) -> Any:
    """Return the words at a pointer as an array."""
    from numba.core import types

    def generate(context: Any, builder: Any, _given: Any, args: Any) -> Any:
        length = context.get_constant(types.intp, 1 << 20)
        return make_array(context, builder, types.int64, args[0], length)

    return types.Array(types.int64, 1, "C")(pointer), generate


view_words: Any = Intrinsic(_view_words)
