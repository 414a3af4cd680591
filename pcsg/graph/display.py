"""A picture as a list of shapes, and its two forms: SVG with text as text, and pixels.

Measures are in points from the top left corner. The font is the one that Pillow brings along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from xml.sax.saxutils import escape, quoteattr

from PIL import Image, ImageDraw, ImageFont

from pcsg.errors import UsageError

Point = tuple[float, float]
Color = str

FONT_FAMILY = "Aileron, 'Helvetica Neue', Helvetica, Arial, sans-serif"


@dataclass(frozen=True)
class Rectangle:
    """A filled rectangle with round corners."""

    x: float
    y: float
    width: float
    height: float
    radius: float
    fill: Color
    stroke: Color | None = None
    line: float = 1.0


@dataclass(frozen=True)
class Curve:
    """A smooth line.

    Attributes
    ----------
    points
        The first one, then three for every cubic piece, as in an SVG path.
    arrow
        Whether it ends in an arrowhead.
    """

    points: tuple[Point, ...]
    color: Color
    line: float = 1.4
    arrow: bool = False


@dataclass(frozen=True)
class Label:
    """A line of text; y is the middle of its height, x its middle or its left end."""

    x: float
    y: float
    text: str
    size: float
    color: Color
    centred: bool = False


Shape = Rectangle | Curve | Label


@dataclass(frozen=True)
class Picture:
    """Shapes from back to front on a white ground."""

    width: float
    height: float
    shapes: tuple[Shape, ...]
    title: str


@cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size=size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font


@cache
def text_width(text: str, size: float) -> float:
    """Return the width of a text in points."""
    return float(_font(size).getlength(text))


def line_points(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return straight pieces through points, as the points of a curve."""
    result = [points[0]]
    for a, b in pairwise(points):
        result += [_between(a, b, 1 / 3), _between(a, b, 2 / 3), b]
    return tuple(result)


def rounded_points(points: Sequence[Point], radius: float) -> tuple[Point, ...]:
    """Return straight pieces through points with round corners."""
    result = [points[0]]
    for k in range(1, len(points)):
        start, corner = result[-1], points[k]
        if k == len(points) - 1:
            result += line_points([start, corner])[1:]
            break
        after = points[k + 1]
        r = min(radius, math.dist(points[k - 1], corner) / 2, math.dist(corner, after) / 2)
        if r == 0.0:
            continue
        a = _between(corner, points[k - 1], r / math.dist(corner, points[k - 1]))
        b = _between(corner, after, r / math.dist(corner, after))
        result += line_points([start, a])[1:]
        result += [_between(a, corner, 0.55), _between(b, corner, 0.55), b]
    return tuple(result)


def _between(a: Point, b: Point, t: float) -> Point:
    return (a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t)


def _arrowhead(curve: Curve) -> list[Point]:
    """Return the triangle at the end of a curve."""
    end = curve.points[-1]
    start = next((p for p in reversed(curve.points) if math.dist(p, end) > 1e-6), end)
    length = math.dist(start, end) or 1.0
    dx, dy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    size = 3.0 + 3.0 * curve.line
    back = (end[0] - size * dx, end[1] - size * dy)
    half = 0.42 * size
    return [
        end,
        (back[0] - half * dy, back[1] + half * dx),
        (back[0] + half * dy, back[1] - half * dx),
    ]


def write_svg(picture: Picture) -> str:
    """Return a picture as an SVG document."""
    width, height = _number(picture.width), _number(picture.height)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family={quoteattr(FONT_FAMILY)}>',
        f"<title>{escape(picture.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for shape in picture.shapes:
        if isinstance(shape, Rectangle):
            out.append(_svg_rectangle(shape))
        elif isinstance(shape, Curve):
            out += _svg_curve(shape)
        else:
            out.append(_svg_label(shape))
    out.append("</svg>")
    return "\n".join(out) + "\n"


def _svg_rectangle(r: Rectangle) -> str:
    places = zip(
        ("x", "y", "width", "height", "rx"), (r.x, r.y, r.width, r.height, r.radius), strict=True
    )
    attributes = " ".join(f'{name}="{_number(value)}"' for name, value in places)
    stroke = f' stroke="{r.stroke}" stroke-width="{_number(r.line)}"' if r.stroke else ""
    return f'<rect {attributes} fill="{r.fill}"{stroke}/>'


def _svg_curve(c: Curve) -> list[str]:
    pairs = [f"{_number(x)},{_number(y)}" for x, y in c.points]
    pieces = [f"C{' '.join(pairs[k : k + 3])}" for k in range(1, len(pairs), 3)]
    out = [
        f'<path d="M{pairs[0]} {" ".join(pieces)}" fill="none" stroke="{c.color}" '
        f'stroke-width="{_number(c.line)}" stroke-linecap="round"/>'
    ]
    if c.arrow:
        corners = " ".join(f"{_number(x)},{_number(y)}" for x, y in _arrowhead(c))
        out.append(f'<polygon points="{corners}" fill="{c.color}"/>')
    return out


def _svg_label(t: Label) -> str:
    # The length holds the text inside its box where the viewer lacks the font.
    length = text_width(t.text, t.size)
    x = t.x - length / 2 if t.centred else t.x
    return (
        f'<text x="{_number(x)}" y="{_number(t.y + 0.35 * t.size)}" '
        f'font-size="{_number(t.size)}" fill="{t.color}" xml:space="preserve" '
        f'textLength="{_number(length)}" lengthAdjust="spacingAndGlyphs">{escape(t.text)}</text>'
    )


def _number(x: float) -> str:
    return f"{x:.2f}".rstrip("0").rstrip(".")


_MOST_PIXELS = 60_000_000
_FINER = 2


def paint(picture: Picture, scale: float = 2.0) -> Image.Image:
    """Return a picture as pixels, drawn at twice the size and reduced.

    Parameters
    ----------
    scale
        Pixels a point; less for pictures that would have more than fifteen million pixels.

    Raises
    ------
    UsageError
        The picture is too large to be read at any such size.
    """
    most = math.sqrt(_MOST_PIXELS / (picture.width * picture.height)) / _FINER
    scale = min(scale, most, 30_000 / max(picture.width, picture.height))
    if scale < 0.2:
        raise UsageError("the graph is too large for a picture of pixels; write SVG instead")
    zoom = scale * _FINER
    size = (math.ceil(picture.width * scale), math.ceil(picture.height * scale))
    image = Image.new("RGB", (size[0] * _FINER, size[1] * _FINER), "#ffffff")
    draw = ImageDraw.Draw(image)
    for shape in picture.shapes:
        if isinstance(shape, Rectangle):
            _paint_rectangle(draw, shape, zoom)
        elif isinstance(shape, Curve):
            _paint_curve(draw, shape, zoom)
        else:
            at = (shape.x * zoom, shape.y * zoom + 0.35 * shape.size * zoom)
            anchor = "ms" if shape.centred else "ls"
            draw.text(at, shape.text, shape.color, _font(shape.size * zoom), anchor=anchor)
    return image.resize(size, Image.Resampling.BOX)


def _paint_rectangle(draw: ImageDraw.ImageDraw, r: Rectangle, zoom: float) -> None:
    grow = r.line / 2 if r.stroke else 0.0
    corners = [(r.x - grow) * zoom, (r.y - grow) * zoom]
    corners += [(r.x + r.width + grow) * zoom - 1, (r.y + r.height + grow) * zoom - 1]
    radius = min(r.radius + grow, r.height / 2 + grow) * zoom
    line = max(1, round(r.line * zoom)) if r.stroke else 0
    draw.rounded_rectangle(corners, radius, r.fill, r.stroke, line)


def _paint_curve(draw: ImageDraw.ImageDraw, c: Curve, zoom: float) -> None:
    points = [(x * zoom, y * zoom) for x, y in _flatten(c.points)]
    width = max(1, round(c.line * zoom))
    draw.line(points, c.color, width, joint="curve")
    for x, y in (points[0], points[-1]):
        r = width / 2 - 0.5
        draw.ellipse([x - r, y - r, x + r, y + r], c.color)
    if c.arrow:
        draw.polygon([(x * zoom, y * zoom) for x, y in _arrowhead(c)], c.color)


def _flatten(points: Sequence[Point]) -> list[Point]:
    """Return a curve as short straight pieces."""
    out = [points[0]]
    for k in range(1, len(points), 3):
        a, b, c, d = out[-1], *points[k : k + 3]
        if a[0] == b[0] == c[0] == d[0] or a[1] == b[1] == c[1] == d[1]:
            out.append(d)
            continue
        count = max(1, min(48, int(math.dist(a, d) / 1.5)))
        for i in range(1, count + 1):
            t = i / count
            s = 1 - t
            w = (s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t)
            out.append(
                (
                    w[0] * a[0] + w[1] * b[0] + w[2] * c[0] + w[3] * d[0],
                    w[0] * a[1] + w[1] * b[1] + w[2] * c[1] + w[3] * d[1],
                )
            )
    return out
