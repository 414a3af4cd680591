"""A layered layout of a cyclic graph.

After Sugiyama, Tagawa and Toda 1981: edges that close cycles are set aside, boxes get layers, the
order in each layer is improved by sweeps, places follow (`placement`). All edges that lead back
to one box share a *trunk*, a lane beside its descendants that rises to the box's side.
Measures are in points, y downwards.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from pcsg.graph.placement import place

Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A box to be placed.

    Attributes
    ----------
    width, height
        Its size.
    foot
        Room kept free below it for labels of its edges, which leave it straight down.
    port_span, port_gap
        Width about its middle where edges leave it, and their least distance; 0 if all leave at
        the middle.
    """

    width: float
    height: float
    foot: float = 0.0
    port_span: float = 0.0
    port_gap: float = 0.0


@dataclass(frozen=True)
class Route:
    """The way of one edge.

    Attributes
    ----------
    back
        Whether it closes a cycle.
    points
        Corners from tail to head. Forward edges are vertical in all of them; back edges run
        along the axes.
    """

    back: bool
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Layout:
    """Where everything is.

    Attributes
    ----------
    centres
        Middle of every box's top edge.
    layers
        Layer of every box, from 0 at the top.
    routes
        One for every edge, in the order given.
    width, height
        Of the whole, which begins at (0, 0).
    """

    centres: tuple[Point, ...]
    layers: tuple[int, ...]
    routes: tuple[Route, ...]
    width: float
    height: float


BOX_GAP = 26.0
LANE_GAP = 16.0
LAYER_GAP = 34.0
TRACK = 12.0
MARGIN = 20.0
HEADROOM = 12.0

_MOST_BENDS = 60_000
_WORK = 400_000


def find_back_edges(successors: Sequence[Sequence[int]]) -> set[tuple[int, int]]:
    """Return the edges (tail, k-th successor) that close cycles in a walk from vertex 0.

    They are those that lead to a vertex on the path to their tail, depth first.
    """
    back: set[tuple[int, int]] = set()
    state = [0] * len(successors)
    for start in range(len(successors)):
        if state[start]:
            continue
        state[start] = 1
        stack = [(start, 0)]
        while stack:
            v, k = stack.pop()
            if k == len(successors[v]):
                state[v] = 2
                continue
            stack.append((v, k + 1))
            w = successors[v][k]
            if state[w] == 1:
                back.add((v, k))
            elif state[w] == 0:
                state[w] = 1
                stack.append((w, 0))
    return back


def lay_out(boxes: Sequence[Box], successors: Sequence[Sequence[int]]) -> Layout:
    """Place boxes and find the ways of their edges.

    Parameters
    ----------
    boxes
        The first one is the root.
    successors
        Heads of every box's edges, in order; the routes come in the same order, box by box.
    """
    return _Layered(boxes, successors).finish()


@dataclass
class _Edge:
    tail: int
    head: int
    back: bool
    bends: list[int] = field(default_factory=list)
    direct: bool = False


class _Layered:
    """The layered graph: boxes first, then bends of long edges and trunks."""

    def __init__(self, boxes: Sequence[Box], successors: Sequence[Sequence[int]]) -> None:
        self.boxes = boxes
        back = find_back_edges(successors)
        self.edges = [
            _Edge(v, w, (v, k) in back)
            for v, heads in enumerate(successors)
            for k, w in enumerate(heads)
        ]
        self.layer = self._rank()
        self.up: list[list[int]] = [[] for _ in boxes]
        self.down: list[list[int]] = [[] for _ in boxes]
        # Edges that pull on the order, but bend in any case.
        self.pulls: set[tuple[int, int]] = set()
        self.trunks: dict[int, dict[int, int]] = {}
        self._add_bends()
        self._add_trunks()
        self.heads = {trunk[self.layer[box]]: box for box, trunk in self.trunks.items()}
        self.side_of = {box: head for head, box in self.heads.items()}
        self.order = self._first_order()
        self._reduce_crossings()
        bend = [v >= len(boxes) for v in range(len(self.layer))]
        up = [[u for u in us if (u, v) not in self.pulls] for v, us in enumerate(self.up)]
        down = [[w for w in ws if (v, w) not in self.pulls] for v, ws in enumerate(self.down)]
        self.x = place(self.order, up, down, bend, self._distance)

    def _rank(self) -> list[int]:
        """Return layers: longest paths from above, then boxes drawn down to their successors."""
        n = len(self.boxes)
        down: list[list[int]] = [[] for _ in range(n)]
        above = [0] * n
        for e in self.edges:
            if not e.back:
                down[e.tail].append(e.head)
                above[e.head] += 1
        waiting = above[:]
        order = [v for v in range(n) if not waiting[v]]
        layer = [0] * n
        for v in order:
            for w in down[v]:
                layer[w] = max(layer[w], layer[v] + 1)
                waiting[w] -= 1
                if not waiting[w]:
                    order.append(w)
        for v in reversed(order):
            if len(down[v]) > above[v] > 0:
                layer[v] = min(layer[w] for w in down[v]) - 1
        return layer

    def _new_vertex(self, layer: int) -> int:
        self.layer.append(layer)
        self.up.append([])
        self.down.append([])
        return len(self.layer) - 1

    def _connect(self, upper: int, lower: int) -> None:
        self.down[upper].append(lower)
        self.up[lower].append(upper)

    def _add_bends(self) -> None:
        forward = [e for e in self.edges if not e.back]
        room = _MOST_BENDS
        for e in sorted(forward, key=lambda e: self.layer[e.head] - self.layer[e.tail]):
            room -= self.layer[e.head] - self.layer[e.tail] - 1
            e.direct = room < 0
        for e in forward:
            if e.direct:
                continue
            above = e.tail
            for layer in range(self.layer[e.tail] + 1, self.layer[e.head]):
                v = self._new_vertex(layer)
                e.bends.append(v)
                self._connect(above, v)
                above = v
            self._connect(above, e.head)

    def _add_trunks(self) -> None:
        lowest: dict[int, int] = {}
        for e in self.edges:
            if e.back:
                lowest[e.head] = max(lowest.get(e.head, 0), self.layer[e.tail] + 1)
        room = _MOST_BENDS
        bottom = max(self.layer) + 1
        for box, last in sorted(lowest.items(), key=lambda item: item[1] - self.layer[item[0]]):
            room -= last - self.layer[box]
            if room < 0:
                break
            # One layer more than needed draws the sources towards the trunk, where there is one.
            last = min(last, bottom - 1)
            trunk = {k: self._new_vertex(k) for k in range(self.layer[box], last + 1)}
            for k in range(self.layer[box], last):
                # Twice, because a crossing of a trunk or a bend in it is worse than another.
                self._connect(trunk[k], trunk[k + 1])
                self._connect(trunk[k], trunk[k + 1])
            self.trunks[box] = trunk
        for e in self.edges:
            if e.back and e.head in self.trunks:
                below = self.trunks[e.head].get(self.layer[e.tail] + 1)
                if below is not None:
                    self._connect(e.tail, below)
                    self.pulls.add((e.tail, below))
            elif e.back:
                e.direct = True

    def _first_order(self) -> list[list[int]]:
        """Return layers in the order of a walk, every trunk to the right of what is below."""
        order: list[list[int]] = [[] for _ in range(max(self.layer) + 1)]
        seen = [False] * len(self.layer)
        starts = [v for v in range(len(self.boxes)) if not self.up[v]]
        stack = starts[::-1]
        while stack:
            v = stack.pop()
            if seen[v]:
                continue
            seen[v] = True
            order[self.layer[v]].append(v)
            if v in self.side_of:
                stack.append(self.side_of[v])
            stack.extend(reversed(self.down[v]))
        return [self._with_heads(row) for row in order]

    def _with_heads(self, row: Sequence[int]) -> list[int]:
        """Put the top of every trunk beside its box, on the side where the trunk is below."""
        position = {v: k for k, v in enumerate(row)}
        result: list[int] = []
        for v in row:
            if v in self.heads:
                continue
            head = self.side_of.get(v)
            if head is None:
                result.append(v)
            elif position.get(head, len(row)) < position[v]:
                result += [head, v]
            else:
                result += [v, head]
        return result

    def _reduce_crossings(self) -> None:
        """Sort layers by the mean places of neighbours, down and up in turn; keep the best.

        What costs most is a crossing, then successors that do not stand in the order of the text.
        """
        size = len(self.layer) + sum(map(len, self.down))
        small = size < 3000
        if small:
            self._exchange_neighbours()
        best = [list(row) for row in self.order]
        least = self._cost()
        idle = 0
        for sweep in range(max(2, min(24, _WORK // size))):
            if least == 0 or idle == 6:
                break
            downwards = sweep % 2 == 0
            near = self.up if downwards else self.down
            rows = range(1, len(self.order))
            for k in rows if downwards else reversed(range(len(self.order) - 1)):
                self._sort_layer(k, near, self.order[k - 1 if downwards else k + 1])
            if small:
                self._exchange_neighbours()
            cost = self._cost()
            idle += 1
            if cost < least:
                least, idle = cost, 0
                best = [list(row) for row in self.order]
        self.order = best

    def _cost(self) -> int:
        """Return twice the crossings, and the pairs of successors out of order."""
        crossings = disorder = 0
        for upper, lower in zip(self.order, self.order[1:], strict=False):
            place_of = {v: i for i, v in enumerate(lower)}
            ends: list[int] = []
            for v in upper:
                places = [place_of[w] for w in self.down[v]]
                disorder += sum(p > q for p, q in pairwise(places))
                for p in sorted(places):
                    crossings += len(ends) - bisect_left(ends, p + 1)
                    insort(ends, p)
        return 2 * crossings + disorder

    def _sort_layer(self, k: int, near: Sequence[Sequence[int]], fixed: Sequence[int]) -> None:
        place_of = {v: i for i, v in enumerate(fixed)}
        scale = len(fixed) / max(1, len(self.order[k]))
        key: dict[int, float] = {}
        for i, v in enumerate(self.order[k]):
            places = [place_of[u] for u in near[v]]
            key[v] = sum(places) / len(places) if places else i * scale
        self.order[k] = self._with_heads(sorted(self.order[k], key=key.__getitem__))

    def _exchange_neighbours(self) -> None:
        """Swap vertices side by side where that takes crossings away."""
        for k, row in enumerate(self.order):
            above = {v: i for i, v in enumerate(self.order[k - 1])} if k else {}
            below = (
                {v: i for i, v in enumerate(self.order[k + 1])} if k + 1 < len(self.order) else {}
            )
            for _ in range(4):
                swapped = False
                for i in range(len(row) - 1):
                    a, b = row[i], row[i + 1]
                    if self._bound(a) or self._bound(b):
                        continue
                    gain = 0
                    for near, places in ((self.up, above), (self.down, below)):
                        left = [places[u] for u in near[a]]
                        right = [places[u] for u in near[b]]
                        gain += 2 * sum((p > q) - (p < q) for p in left for q in right)
                    gain += self._disorder(a, b)
                    if gain > 0:
                        row[i], row[i + 1] = b, a
                        swapped = True
                if not swapped:
                    break

    def _disorder(self, a: int, b: int) -> int:
        """Return 1 if a, left of b, comes after it in the text, -1 if before it, else 0."""
        for u in set(self.up[a]) & set(self.up[b]):
            return 1 if self.down[u].index(a) > self.down[u].index(b) else -1
        return 0

    def _bound(self, v: int) -> bool:
        """Return whether a vertex and its neighbour in the layer must stay together."""
        return v in self.heads or v in self.side_of

    def _distance(self, a: int, b: int) -> float:
        gap = BOX_GAP if a < len(self.boxes) and b < len(self.boxes) else LANE_GAP
        return (self._width(a) + self._width(b)) / 2 + gap

    def _width(self, v: int) -> float:
        return self.boxes[v].width if v < len(self.boxes) else 2.0

    def finish(self) -> Layout:
        """Return places and routes."""
        n = len(self.boxes)
        left = min(self.x[v] - self._width(v) / 2 for v in range(len(self.x)))
        self.x = [round(2 * (x - left + MARGIN)) / 2 for x in self.x]
        ports = self._ports()
        tracks = self._tracks()
        self._stack_layers(tracks, ports)
        routes = []
        for e, port in zip(self.edges, ports, strict=True):
            points = self._back(e, port, tracks) if e.back else self._forward(e, port)
            routes.append(Route(e.back, tuple(points)))
        width = max(self.x[v] + self._width(v) / 2 for v in range(len(self.x))) + MARGIN
        return Layout(
            tuple((self.x[v], self.top[self.layer[v]]) for v in range(n)),
            tuple(self.layer[:n]),
            tuple(routes),
            width,
            self.bottom[-1] + len(tracks[-1]) * TRACK + MARGIN,
        )

    def _ports(self) -> list[float]:
        """Return where every edge leaves its box: near the next point, in the order of these."""
        leaving: dict[int, list[int]] = {}
        for k, e in enumerate(self.edges):
            leaving.setdefault(e.tail, []).append(k)
        ports = [0.0] * len(self.edges)
        for v, ks in leaving.items():
            box = self.boxes[v]
            reach = box.port_span / 2 if len(ks) > 1 else 0.0
            aims = {k: self._aim(self.edges[k]) for k in ks}
            ks.sort(key=aims.__getitem__)
            low = self.x[v] - reach
            xs: list[float] = []
            for k in ks:
                xs.append(max(low, min(aims[k], self.x[v] + reach)))
                low = xs[-1] + (box.port_gap if reach else 0.0)
            high = self.x[v] + reach
            for i in reversed(range(len(xs))):
                xs[i] = min(xs[i], high)
                high = xs[i] - (box.port_gap if reach else 0.0)
            for k, x in zip(ks, xs, strict=True):
                ports[k] = x
        return ports

    def _aim(self, e: _Edge) -> float:
        if e.bends:
            return self.x[e.bends[0]]
        if e.back and not e.direct:
            return self.x[self.trunks[e.head][self.layer[e.tail]]]
        return self.x[e.head]

    def _tracks(self) -> list[dict[int, int]]:
        """Return for every gap below a layer the trunks that edges turn into, and their lanes."""
        tracks: list[dict[int, int]] = [{} for _ in self.order]
        for e in self.edges:
            if e.back and not e.direct:
                lanes = tracks[self.layer[e.tail]]
                lanes.setdefault(e.head, len(lanes))
        return tracks

    def _stack_layers(self, tracks: Sequence[dict[int, int]], ports: Sequence[float]) -> None:
        """Set top and bottom of every layer; gaps grow with what has to turn in them."""
        reach = [0.0] * len(self.order)
        for e, port in zip(self.edges, ports, strict=True):
            if not e.back and not e.direct:
                xs = [port, *(self.x[v] for v in e.bends), self.x[e.head]]
                for k, (a, b) in enumerate(pairwise(xs), self.layer[e.tail]):
                    reach[k] = max(reach[k], abs(a - b))
        self.top: list[float] = []
        self.bottom: list[float] = []
        y = MARGIN + HEADROOM
        for k, row in enumerate(self.order):
            shown = [self.boxes[v] for v in row if v < len(self.boxes)]
            self.top.append(y)
            y += max((b.height + b.foot for b in shown), default=0.0)
            self.bottom.append(y)
            y += LAYER_GAP + min(90.0, 0.17 * reach[k]) + TRACK * len(tracks[k])

    def _forward(self, e: _Edge, port: float) -> list[Point]:
        layer = self.layer[e.tail]
        points = [(port, self.top[layer] + self.boxes[e.tail].height), (port, self.bottom[layer])]
        for v in e.bends:
            k = self.layer[v]
            points += [(self.x[v], self.top[k]), (self.x[v], self.bottom[k])]
        return [*points, (self.x[e.head], self.top[self.layer[e.head]])]

    def _back(self, e: _Edge, port: float, tracks: Sequence[dict[int, int]]) -> list[Point]:
        layer, head = self.layer[e.tail], self.layer[e.head]
        start = (port, self.top[layer] + self.boxes[e.tail].height)
        middle = self.top[head] + min(self.boxes[e.head].height / 2, 18.0)
        half = self.boxes[e.head].width / 2
        if e.direct:
            # Too many to keep apart: straight up beside the box it returns to.
            x = self.x[e.head] + half + LANE_GAP
            y = self.bottom[layer] + TRACK
            return [start, (port, y), (x, y), (x, middle), (self.x[e.head] + half, middle)]
        y = self.bottom[layer] + TRACK * (1 + tracks[layer][e.head])
        points = [start, (port, y)]
        trunk = self.trunks[e.head]
        for k in range(layer, head - 1, -1):
            x = self.x[trunk[k]]
            if x != points[-1][0]:
                points.append((x, y))
            # Trunks change their lane just below a layer, each at its own height.
            y = self.bottom[k - 1] + TRACK * 0.5 if k > head else middle
            points.append((x, y))
        side = -half if points[-1][0] < self.x[e.head] else half
        return [*points, (self.x[e.head] + side, middle)]
