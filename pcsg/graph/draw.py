"""Drawing the cyclic graph as the paper's figs 3b and 5b do: SVG, PNG and Graphviz's DOT.

Selections are dark, with their selection function and the numbers of their rules below; what is
assigned is yellow, transformations blue, attributes rose, primitives green, operators round.
Red lines with arrowheads close the cycles, all other edges lead down.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

from PIL import Image

from pcsg.graph.diagram import (
    CHIP,
    COLUMN_GAP,
    LEADING,
    MINUS,
    NAME_SIZE,
    PAD,
    SIZE,
    SMALL,
    Diagram,
    NodeBox,
    Row,
    make_diagram,
    summary,
)
from pcsg.graph.display import (
    Curve,
    Label,
    Picture,
    Point,
    Rectangle,
    Shape,
    line_points,
    paint,
    rounded_points,
    text_width,
    write_svg,
)
from pcsg.graph.graph import Graph
from pcsg.graph.layout import Box, Layout, Route, find_back_edges, lay_out
from pcsg.graph.nodes import (
    Attribute,
    Calculation,
    Leaf,
    Node,
    Operation,
    Selection,
    Transformation,
)
from pcsg.graph.operators import DIFFERENCE, INTERSECTION, UNION

_INK = "#22303c"
_FAINT = "#6b7884"
_EDGE = "#8794a0"
_BACK = "#c8502e"
_WHITE = "#ffffff"

# Fill and outline of every kind of node.
_COLORS: dict[type[Node], tuple[str, str]] = {
    Selection: ("#2c4356", "#2c4356"),
    Calculation: ("#fdf3d9", "#d8b766"),
    Transformation: ("#e4eff8", "#8fb4d3"),
    Attribute: ("#f8e8ee", "#d29ab0"),
    Operation: ("#ffffff", "#3d5163"),
    Leaf: ("#e3f1e1", "#80b27a"),
}

_CIRCLE = 34.0
_STUB = 26.0
_ENTRY = 20.0


def draw_svg(graph: Graph, merge_chains: bool = True) -> str:
    """Return a drawing of a graph as an SVG document.

    Parameters
    ----------
    merge_chains
        Whether a chain of calculations, transformations and attributes becomes one box.
    """
    return write_svg(draw(graph, merge_chains))


def draw_png(graph: Graph, merge_chains: bool = True, scale: float = 2.0) -> Image.Image:
    """Return a drawing of a graph as an image.

    Parameters
    ----------
    merge_chains
        As in `draw_svg`.
    scale
        Pixels a point; very large drawings get fewer.

    Raises
    ------
    UsageError
        The graph is too large for an image.
    """
    return paint(draw(graph, merge_chains), scale)


def draw(graph: Graph, merge_chains: bool = True) -> Picture:
    """Return a drawing of a graph as shapes."""
    diagram = make_diagram(graph, merge_chains)
    sizes = [_size(box) for box in diagram.boxes]
    layout = lay_out(sizes, diagram.successors)
    shapes: list[Shape] = _edges(diagram, layout)
    for box, size, (x, y) in zip(diagram.boxes, sizes, layout.centres, strict=True):
        shapes += _box_shapes(box, size, x, y)
    shapes += _edge_labels(diagram, layout)
    x, y = layout.centres[0]
    entry = line_points([(x, y - _ENTRY), (x, y)])
    shapes.append(Curve(entry, _INK, 1.6, arrow=True))
    return Picture(layout.width, layout.height, tuple(shapes), summary(graph))


def draw_dot(graph: Graph, merge_chains: bool = True) -> str:
    """Return a graph in the language of Graphviz.

    Parameters
    ----------
    merge_chains
        As in `draw_svg`.
    """
    diagram = make_diagram(graph, merge_chains)
    back = find_back_edges(diagram.successors)
    out = [
        "digraph pcsg {",
        '  node [fontname="Helvetica", fontsize=11, style="filled,rounded", shape=box];',
        f'  edge [fontname="Helvetica", fontsize=10, color="{_EDGE}", arrowsize=0.6];',
    ]
    for k, box in enumerate(diagram.boxes):
        out.append(f"  n{k} [{_dot_style(box)}];")
    for k, box in enumerate(diagram.boxes):
        for i, (head, label) in enumerate(zip(diagram.successors[k], box.edge_labels, strict=True)):
            attributes = [f'label="{label}"'] if label else []
            if (k, i) in back:
                attributes += [f'color="{_BACK}"', "style=dashed", "constraint=false"]
            out.append(
                f"  n{k} -> n{head}" + f" [{', '.join(attributes)}]" * bool(attributes) + ";"
            )
    return "\n".join([*out, "}"]) + "\n"


def _dot_style(box: NodeBox) -> str:
    fill, outline = _COLORS[box.kind]
    lines = [line for row in box.rows for line in row.lines]
    style = f'fillcolor="{fill}", color="{outline}"'
    if isinstance(box.rows[0].node, Operation):
        lines = [box.rows[0].node.operator.symbols[-1]]
        style += ", shape=circle, style=filled"
    elif box.kind is Selection:
        style += f', fontcolor="{_WHITE}"'
    if box.caption:
        lines.insert(0, f"{box.caption} =")
    text = "\\n".join(line.replace("\\", "\\\\").replace('"', '\\"') for line in lines)
    return f'label="{text}", {style}'


def _size(box: NodeBox) -> Box:
    caption = text_width(box.caption, SMALL) + 6.0 if box.caption else 0.0
    gap = _port_gap(box)
    room = gap * len(box.edge_labels) + 12.0
    foot = _STUB if gap else 0.0
    if box.kind is Operation:
        # The caption stands to the right, so the sign keeps its place in the middle.
        width = _operator_width(box)
        span = width - _CIRCLE / 2 if gap else 0.0
        return Box(width + 2 * caption, _CIRCLE, foot, span, gap)
    widest = max(_row_width(row) for row in box.rows)
    head = LEADING - 2.0 if box.caption else 0.0
    height = head + sum(_row_height(row) for row in box.rows)
    width = max(widest + 2 * PAD, caption, room, 44.0)
    return Box(width, height, foot, width - 2 * CHIP if gap else 0.0, gap)


def _operator_width(box: NodeBox) -> float:
    return max(_CIRCLE, _port_gap(box) * len(box.edge_labels) + 12.0)


def _port_gap(box: NodeBox) -> float:
    """Return the least distance of edges with labels, 0 if there are none."""
    labels = [label for label in box.edge_labels if label]
    return max((_chip_width(label) + 6.0 for label in labels), default=0.0)


def _line_size(row: Row, k: int) -> float:
    return NAME_SIZE if isinstance(row.node, Selection) and k == 0 else SIZE


def _column_width(row: Row) -> float:
    return max(text_width(line, _line_size(row, k)) for k, line in enumerate(row.lines))


def _row_width(row: Row) -> float:
    return row.columns * _column_width(row) + (row.columns - 1) * COLUMN_GAP


def _row_height(row: Row) -> float:
    extra = 14.0 if isinstance(row.node, Selection) else 8.0
    return LEADING * row.column_length + extra


def _chip_width(label: str) -> float:
    return max(CHIP, text_width(label, SMALL) + 9.0)


def _box_shapes(box: NodeBox, size: Box, x: float, y: float) -> list[Shape]:
    if isinstance(box.rows[0].node, Operation):
        return _operation_shapes(box, box.rows[0].node, x, y)
    shapes: list[Shape] = []
    left = x - size.width / 2
    if box.caption:
        head = LEADING - 2.0
        shapes.append(Label(left + 2.0, y + head / 2 - 1.0, box.caption, SMALL, _FAINT))
        y += head
    heights = [_row_height(row) for row in box.rows]
    tops = [y, *(y + h for h in accumulate(heights))]
    radius = 7.0 if box.kind is not Leaf else heights[0] / 2
    # Of a stack, each row hides the lower corners of the one above.
    for k in reversed(range(len(box.rows))):
        fill, outline = _COLORS[type(box.rows[k].node)]
        over = radius * 2 if k else 0.0
        top = tops[k] - over
        shapes.append(
            Rectangle(left, top, size.width, heights[k] + over, radius, fill, outline, 1.2)
        )
    for row, top, height in zip(box.rows, tops, heights, strict=False):
        selection = isinstance(row.node, Selection)
        first = top + height / 2 - LEADING * (row.column_length - 1) / 2
        centred = selection or len(row.lines) == 1
        for k, line in enumerate(row.lines):
            color = _WHITE if selection and k == 0 else "#d5e0ea" if selection else _INK
            column, line_of = divmod(k, row.column_length)
            at = x if centred else left + PAD + column * (_column_width(row) + COLUMN_GAP)
            middle = first + line_of * LEADING - (1.5 if selection and k == 0 else 0.0)
            shapes.append(Label(at, middle, line, _line_size(row, k), color, centred))
    return shapes


def _operation_shapes(box: NodeBox, node: Operation, x: float, y: float) -> list[Shape]:
    fill, outline = _COLORS[Operation]
    width = _operator_width(box)
    middle = y + _CIRCLE / 2
    shapes: list[Shape] = [
        Rectangle(x - width / 2, y, width, _CIRCLE, _CIRCLE / 2, fill, outline, 1.5),
        _sign(node, x, middle, outline),
    ]
    if box.caption:
        shapes.append(Label(x + width / 2 + 5.0, middle, box.caption, SMALL, _FAINT))
    return shapes


def _sign(node: Operation, x: float, y: float, color: str) -> Curve:
    """Draw the operator's sign: the font has none of them."""
    a, b, k = 6.0, 7.0, 0.5523 * 6.0
    if node.operator is DIFFERENCE:
        return Curve(line_points([(x - 4.5, y - b), (x + 4.5, y + b)]), color, 2.2)
    f = {UNION: 1.0, INTERSECTION: -1.0}[node.operator]
    bowl = y + f * (b - a)
    points: list[Point] = list(line_points([(x - a, y - f * b), (x - a, bowl)]))
    points += [(x - a, bowl + f * k), (x - k, bowl + f * a), (x, bowl + f * a)]
    points += [(x + k, bowl + f * a), (x + a, bowl + f * k), (x + a, bowl)]
    points += line_points([(x + a, bowl), (x + a, y - f * b)])[1:]
    return Curve(tuple(points), color, 2.2)


def _edges(diagram: Diagram, layout: Layout) -> list[Shape]:
    forward: list[Shape] = []
    back: list[Shape] = []
    for route in layout.routes:
        if route.back:
            curve = rounded_points(route.points, 9.0)
            back.append(Curve(curve, _BACK, 1.6, arrow=True))
        else:
            forward.append(Curve(_smooth(route.points), _EDGE, 1.4))
    return [*forward, *back]


def _smooth(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return a curve that is vertical in all points."""
    out = [points[0]]
    for (x0, y0), (x1, y1) in pairwise(points):
        bend = (y1 - y0) * 0.5
        out += [(x0, y0 + bend), (x1, y1 - bend), (x1, y1)]
    return tuple(out)


def _edge_labels(diagram: Diagram, layout: Layout) -> list[Shape]:
    shapes: list[Shape] = []
    routes = iter(layout.routes)
    for box in diagram.boxes:
        for label in box.edge_labels:
            route = next(routes)
            if label:
                shapes += _chip(label, route)
    return shapes


def _chip(label: str, route: Route) -> list[Shape]:
    x, y = route.points[0]
    width = _chip_width(label)
    color = _BACK if route.back else _COLORS[Selection][0]
    top = y + (_STUB - CHIP) / 2 - 1.0
    middle = top + CHIP / 2
    # The font's hyphen is too short for a minus.
    sign: Shape = (
        Curve(line_points([(x - 3.5, middle), (x + 3.5, middle)]), color, 1.6)
        if label == MINUS
        else Label(x, middle, label, SMALL, color, centred=True)
    )
    return [Rectangle(x - width / 2, top, width, CHIP, CHIP / 2, _WHITE, color, 1.0), sign]
