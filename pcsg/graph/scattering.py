"""A copy for each row of a table: `Scatter`, and the graph that it stands for.

Sixteen rows at a time stand in a rule of a module, which halves the range of them: so graphs are
small, states are few, and depth is logarithmic. Numbers of the table are `Lookup`s of the row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pcsg.errors import SourceSpan, UsageError
from pcsg.graph.columns import Column, Table, look_up
from pcsg.graph.expr import Expr, Number, P, if_
from pcsg.graph.expr import call as call_function
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import (
    Calculation,
    Combinable,
    Node,
    Selection,
    Transformation,
    as_node,
    combine,
    leaf_node,
)
from pcsg.graph.operators import UNION
from pcsg.graph.transforms import TRANSFORMS
from pcsg.graph.words import is_name, normal
from pcsg.leaf import LEAF_NAMES
from pcsg.tablefile import columns_of

ROW = "ROW"
"""Parameter: the number of a row, from 1."""

INDEX, COUNT = "scatter_index", "scatter_count"
"""Parameters of the module: the first chunk that is left, and how many."""

CHUNK = 16
"""Rows that stand in one rule."""

_TURNS = ("rotx", "roty", "rotz")
_NORMAL = ("nx", "ny", "nz")
_SCALES = ("sx", "sy", "sz")
_MATRIX = tuple(f"m{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3, 4))

PLACING = ("x", "y", "z", *_TURNS, *_NORMAL, "scale", *_SCALES, *_MATRIX)
"""Names of the columns that say where a row's copy stands; the others are parameters."""


@dataclass(eq=False, slots=True)
class Scatter(Calculation):
    """The union of a copy for each row of a table.

    Everything but text sees what it stands for.

    Attributes
    ----------
    table, body
        Whose rows, and what is copied.
    """

    table: Table = field(kw_only=True, repr=False)
    body: Node = field(kw_only=True, repr=False)

    @property
    def head(self) -> str:
        """What stands before the body in a grammar.

        Raises
        ------
        UsageError
            The table has no file.
        """
        if self.table.text is None:
            raise UsageError(
                "a grammar cannot hold the data of this `scatter`; save it to a CSV file, and"
                " name that"
            )
        words = "".join(f', {name} = "{words}"' for name, words in self.table.words.items())
        return f'scatter("{self.table.text}"{words})'


def scatter(
    solid: Combinable, table: Any, words: Mapping[str, str] | None = None, name: str = "SCATTER"
) -> Node:
    """Return the union of a copy of a solid for each row of a table.

    Parameters
    ----------
    solid
        Sees every other column of numbers as a parameter, and ``ROW``, the row's number from 1.
    table
        A dict of arrays (N,), a structured array, or a data frame. A row stands for
        ``move(x,y,z) rotx(rotx) roty(roty) rotz(rotz) scale(sx,sy,sz)``; missing columns are 0,
        scales 1; ``scale`` stands for all three. With ``nx ny nz`` it stands for
        ``move(x,y,z) align(nx,ny,nz) scale(sx,sy,sz)``, with ``m11 ... m34`` for a matrix. Angles
        are degrees.
    words
        For a column of words, what they are, parted by commas: the first is 1.
    name
        Of the module that is made; names in a graph differ.

    Raises
    ------
    UsageError
        The table makes no sense.
    """
    found = columns_of(table, "the table", PLACING)
    made = make_table(found.numbers, found.words, words or {}, None)
    return scatter_node(made, as_node(solid), name)


def make_table(
    numbers: Mapping[str, Any],
    texts: Mapping[str, list[str]],
    words: Mapping[str, str],
    text: str | None,
) -> Table:
    """Return a checked table.

    Parameters
    ----------
    numbers, texts
        Columns of numbers and of words, by name.
    words
        What the words of some columns are, parted by commas.
    text
        The name of its file.

    Raises
    ------
    UsageError
        The columns make no sense.
    """
    columns = {normal(name): Column(name, values) for name, values in numbers.items()}
    for name, listed in words.items():
        if name not in texts:
            what = "is one of numbers" if name in numbers else "is not there"
            raise UsageError(f"the column `{name}`, whose words are given, {what}")
        known = {word.strip(): k + 1.0 for k, word in enumerate(listed.split(","))}
        for row, word in enumerate(texts[name], 1):
            if word not in known:
                raise UsageError(f"row {row}, column `{name}`: `{word}` is none of: {listed}")
        columns[normal(name)] = Column(name, [known[word] for word in texts[name]])  # type: ignore[arg-type]
    table = Table(columns, words, text)
    if not columns:
        raise UsageError("the table has no column of numbers")
    _check_placing(columns)
    return table


def _check_placing(columns: Mapping[str, Column]) -> None:
    turns = [name for name in _TURNS if name in columns]
    normals = [name for name in _NORMAL if name in columns]
    matrix = [name for name in _MATRIX if name in columns]
    scales = [name for name in _SCALES if name in columns]
    if normals and turns:
        raise UsageError(f"a row is turned by `{turns[0]}` or by `{normals[0]}`, not by both")
    if scales and "scale" in columns:
        raise UsageError(f"a row is scaled by `scale` or by `{scales[0]}`, not by both")
    for found, wanted in ((normals, _NORMAL), (matrix, _MATRIX)):
        missing = [name for name in wanted if found and name not in columns]
        if missing:
            raise UsageError(f"the column `{missing[0]}` is missing beside `{found[0]}`")
    others = [name for name in PLACING if name not in _MATRIX and name in columns]
    if matrix and others:
        raise UsageError(f"a row is placed by a matrix or by `{others[0]}`, not by both")


def scatter_node(table: Table, body: Node, name: str, span: SourceSpan | None = None) -> Scatter:
    """Return the node of a table and a body.

    Parameters
    ----------
    name
        Of the module, where there are many rows.
    """
    chunks, rest = divmod(table.count, CHUNK)
    parts: list[Node] = []
    if chunks:
        select = if_(P.scatter_count < 1.5, 1.0, 2.0)
        module = Selection(name, select, hidden=True, span=span)
        rows = [CHUNK * P.scatter_index + (k + 1.0) for k in range(CHUNK)]
        module.rules[1] = combine(UNION, [_copy(table, body, row, span) for row in rows], span)
        half = call_function("floor", P.scatter_count / 2.0)
        first = Calculation(((COUNT, half),), module, span=span)
        others = ((INDEX, P.scatter_index + half), (COUNT, P.scatter_count - half))
        module.rules[2] = combine(UNION, (first, Calculation(others, module, span=span)), span)
        begin = ((INDEX, Number(0.0)), (COUNT, Number(float(chunks))))
        parts.append(Calculation(begin, module, span=span))
    first_left = CHUNK * chunks + 1
    parts += [
        _copy(table, body, Number(float(k)), span) for k in range(first_left, first_left + rest)
    ]
    if not parts:
        parts.append(leaf_node(LEAF_NAMES["empty"], ()))
    inner = parts[0] if len(parts) == 1 else combine(UNION, parts, span)
    return Scatter((), inner, span=span, table=table, body=body)


def _copy(table: Table, body: Node, row: Expr, span: SourceSpan | None) -> Node:
    """Return what a row stands for."""
    columns = table.columns
    node = body
    for transform, names, missing in _placements(columns):
        args = tuple(
            look_up(columns[name], P.ROW, span) if name in columns else Number(missing)
            for name in names
        )
        node = Transformation(TRANSFORMS[transform], args, node, span=span)
    others = [name for name in columns if name not in PLACING and _is_parameter(name)]
    pairs = [(name, look_up(columns[name], P.ROW, span)) for name in others]
    return Calculation(((ROW, row), *pairs), node, span=span)


def _is_parameter(name: str) -> bool:
    """Return whether expressions can name a column."""
    return is_name(name) and name not in (ROW, *GLOBALS)


def _placements(columns: Mapping[str, Column]) -> list[tuple[str, tuple[str, ...], float]]:
    """Return the transformations of a row, innermost first: name, columns, value where missing."""
    if _MATRIX[0] in columns:
        return [("matrix", _MATRIX, 0.0)]
    found: list[tuple[str, tuple[str, ...], float]] = []
    if "scale" in columns:
        found.append(("uscale", ("scale",), 1.0))
    elif any(name in columns for name in _SCALES):
        found.append(("scale", _SCALES, 1.0))
    if _NORMAL[0] in columns:
        found.append(("align", _NORMAL, 0.0))
    found += [(name, (name,), 0.0) for name in reversed(_TURNS) if name in columns]
    if any(name in columns for name in ("x", "y", "z")):
        found.append(("move", ("x", "y", "z"), 0.0))
    return found


def written_below(node: Node) -> Sequence[Node]:
    """Return the nodes that stand in a node's text: its successors, of a `scatter` its body."""
    return (node.body,) if isinstance(node, Scatter) else node.successors


def written_nodes(graph: Graph) -> list[Node]:
    """Return the nodes that text says, in the order of the graph."""
    reached, work = {graph.root}, [graph.root]
    while work:
        new = [node for node in written_below(work.pop()) if node not in reached]
        reached.update(new)
        work += new
    return [node for node in graph.nodes if node in reached]
