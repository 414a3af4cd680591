"""What the drawing of a graph shows: boxes with their texts, and the edges between them.

A box shows one node, or a chain of unary nodes that nothing else leads into with the leaf at its
end, a row for each.
"""

from __future__ import annotations

from dataclasses import dataclass

from pcsg.graph.display import text_width
from pcsg.graph.exprtext import expr_text
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.operators import DIFFERENCE
from pcsg.graph.text import assignment_texts, node_text

SIZE = 13.0
NAME_SIZE = 17.0
SMALL = 11.0
LEADING = 17.0
PAD = 11.0
CHIP = 16.0
MINUS = "-"
COLUMN_GAP = 20.0

_WIDEST = 250.0
_MOST_LINES = 24
_MOST_ROWS = 16
_TALL = 8


@dataclass(frozen=True)
class Row:
    """What a box says about one node.

    Attributes
    ----------
    node
        The node.
    lines
        Its text; lines that go on are indented.
    """

    node: Node
    lines: tuple[str, ...]

    @property
    def columns(self) -> int:
        """As many as keep a long list of short assignments compact."""
        short = all(text_width(line, SIZE) <= _WIDEST / 2 for line in self.lines)
        return min(3, -(-len(self.lines) // _TALL)) if short else 1

    @property
    def column_length(self) -> int:
        """Lines in a column."""
        return -(-len(self.lines) // self.columns)


@dataclass(frozen=True)
class NodeBox:
    """A box of the drawing.

    Attributes
    ----------
    rows
        From top to bottom; the last node's successors are the box's.
    caption
        The name of a definition that begins here.
    edge_labels
        For every successor of the last node: a rule's number, a minus for what is subtracted.
    """

    rows: tuple[Row, ...]
    caption: str | None
    edge_labels: tuple[str | None, ...]

    @property
    def kind(self) -> type[Node]:
        """The class of its first node."""
        return type(self.rows[0].node)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The nodes it shows."""
        return tuple(row.node for row in self.rows)


@dataclass(frozen=True)
class Diagram:
    """Boxes, the first of which is the axiom, and the numbers of every box's successors."""

    boxes: tuple[NodeBox, ...]
    successors: tuple[tuple[int, ...], ...]


def make_diagram(graph: Graph, merge_chains: bool = True) -> Diagram:
    """Return the boxes and edges that show a graph.

    Parameters
    ----------
    merge_chains
        Whether a chain of calculations, transformations and attributes becomes one box.
    """
    places = dict.fromkeys(graph.nodes, 0)
    places[graph.root] = 1
    for node in graph.nodes:
        for successor in node.successors:
            places[successor] += 1
    boxes: list[NodeBox] = []
    box_of: dict[Node, int] = {}
    for node in graph.nodes:
        if node in box_of:
            continue
        chain = [node]
        while merge_chains and isinstance(chain[-1], _UNARY) and len(chain) < _MOST_ROWS:
            below = chain[-1].successor
            mergeable = isinstance(below, (*_UNARY, Leaf))
            if not mergeable or places[below] > 1 or below.definition is not None:
                break
            chain.append(below)
        box_of.update(dict.fromkeys(chain, len(boxes)))
        rows = tuple(Row(n, _lines(n)) for n in chain)
        boxes.append(NodeBox(rows, node.definition, _edge_labels(chain[-1])))
    successors = tuple(
        tuple(box_of[below] for below in box.rows[-1].node.successors) for box in boxes
    )
    return Diagram(tuple(boxes), successors)


_UNARY = (Calculation, Transformation, Attribute)


def _edge_labels(node: Node) -> tuple[str | None, ...]:
    if isinstance(node, Selection):
        return tuple(str(k) for k in sorted(node.rules))
    if isinstance(node, Operation) and node.operator is DIFFERENCE:
        return (None, *(MINUS for _ in node.operands[1:]))
    return (None,) * len(node.successors)


def _lines(node: Node) -> tuple[str, ...]:
    """Return the text of a node as lines of readable length."""
    if isinstance(node, Selection):
        texts = _selection_texts(node)
    elif isinstance(node, Calculation) and not node.call:
        texts = assignment_texts(node) or ["{}"]
    elif isinstance(node, Operation):
        texts = []
    elif isinstance(node, Calculation) and isinstance(node.successor, Selection):
        form = node.successor.attributed
        names = form.formals if form else tuple(name for name, _ in node.assignments)
        values = [expr_text(e) for _, e in node.assignments]
        texts = [f"({', '.join(names)}) = ({', '.join(values)})"]
    else:
        texts = [node_text(node)]
    lines = [line for text in texts for line in _wrap(text)]
    if len(lines) > _MOST_LINES:
        rest = len(lines) - _MOST_LINES + 1
        lines = [*lines[: _MOST_LINES - 1], f"... {rest} more lines"]
    return tuple(lines)


def _selection_texts(node: Selection) -> list[str]:
    form = node.attributed
    if form is not None:
        conditions = ["else" if c is None else expr_text(c) for c in form.conditions]
        if len(conditions) == 1 and form.conditions[0] is None:
            conditions = [""]
        pairs = zip(form.labels, conditions, strict=True)
        rules = [f"{label}: {text}".rstrip(": ") for label, text in pairs]
        return [f"{node.name}({', '.join(form.formals)})", *rules]
    return [node.name] + ([expr_text(node.select)] if node.select is not None else [])


def _wrap(text: str) -> list[str]:
    """Break a text at blanks, or anywhere if it has none, and indent what goes on."""
    lines: list[str] = []
    line = ""
    for word in text.split(" "):
        while True:
            longer = f"{line} {word}" if line.strip() else line + word
            if text_width(longer, SIZE) <= _WIDEST:
                line = longer
                break
            if line.strip():
                lines.append(line)
                line = "    "
                continue
            count = max(1, int(len(word) * _WIDEST / text_width(word, SIZE)) - 6)
            lines.append(line + word[:count])
            word = word[count:]
            line = "    "
        if len(lines) > _MOST_LINES:
            return [*lines[:_MOST_LINES], "    ..."]
    return [*lines, line]


def summary(graph: Graph) -> str:
    """Return a line that counts the nodes of a graph by kind."""
    names = {
        Selection: "selection",
        Calculation: "calculation",
        Transformation: "transformation",
        Operation: "operator",
        Attribute: "attribute",
        Leaf: "leaf",
    }
    counts = {name: sum(isinstance(n, kind) for n in graph.nodes) for kind, name in names.items()}
    return "CSG graph: " + ", ".join(f"{n} {name}" for name, n in counts.items() if n) + " nodes"
