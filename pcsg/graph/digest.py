"""What tells a graph from others, in a few characters."""

from __future__ import annotations

import hashlib

from pcsg.graph.expr import Number, signature
from pcsg.graph.graph import Graph, content, setting_content
from pcsg.graph.nodes import Attribute, Leaf, Node, Transformation
from pcsg.graph.text import Braced
from pcsg.leaf.registry import Constant


def digest_of(graph: Graph) -> str:
    """Return a digest in hexadecimal, equal for graphs that are equal and have equal data."""
    lines = [repr([setting_content(s) for s in graph.settings])]
    for node, below in zip(graph.nodes, graph.successors, strict=True):
        lines.append(f"{_written(node)} {below}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def _written(node: Node) -> str:
    """Return everything a node is but its successors."""
    if isinstance(node, Transformation):
        name = node.transform.name
    elif isinstance(node, Leaf):
        name = " ".join([node.solid.name, *map(_constant, node.constants)])
    elif isinstance(node, Attribute):
        name = f"{node.kind.name}/{node.reference}"
    else:
        return repr(content(node))
    numbers = [a.value for a in node.args if isinstance(a, Number)]
    if len(numbers) == len(node.args):  # most are
        return f"{name} {numbers}"
    return f"{name} {[signature(a) for a in node.args]}"


def _constant(constant: Constant) -> str:
    """Return what is written of a constant argument, and what tells its data from others."""
    braced = repr(constant.braced) if isinstance(constant, Braced) else ""
    return f"{constant.text!r} {constant.digest} {braced}"
