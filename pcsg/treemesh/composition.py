"""New trees of the subtrees of others, after a template (Zhu, Jin, You 2015, section 6.2).

The paper names the rules for radii of Xu, Gossett, Chen 2007 without repeating them; those below
are ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pcsg.arguments import whole
from pcsg.errors import UsageError
from pcsg.treemesh.editing import detach, rotation, subtree
from pcsg.treemesh.library import Entry, Library, frame, longest_path
from pcsg.treemesh.pruning import branch_orders
from pcsg.treemesh.skeleton import Floats, Ints, Skeleton


@dataclass(frozen=True)
class CompositionOptions:
    """How trees are composed.

    Attributes
    ----------
    depth
        How often replacements are made within replacements.
    p_replace
        Probability that a child of a joint is replaced.
    turn
        Largest turn about the bearer's axis, in degrees.
    stretch
        Length over that of the child that is replaced: least and largest.
    share
        Largest base radius over the joint's.
    gamma
        Exponent of the rule that children are no thicker together than their joint.
    thinnest
        Least radius over the joint's.
    tries
        Turns that are tried where the subtree would run into another limb.
    """

    depth: int = 2
    p_replace: float = 0.7
    turn: float = 30.0
    stretch: tuple[float, float] = (0.85, 1.15)
    share: float = 0.85
    gamma: float = 2.5
    thinnest: float = 0.02
    tries: int = 8


def compose(
    template: Skeleton,
    library: Library,
    seed: int = 0,
    options: CompositionOptions | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Skeleton:
    """Return a tree made after a template from the subtrees of a library.

    Walks the joints from the root; a child is replaced by a random subtree of about its order,
    turned about its bearer, as long as the child was up to a factor, and thinned so that the joint
    bears it. A subtree that would run into another limb is turned elsewhere, or not taken.

    Parameters
    ----------
    seed
        The same seed gives the same tree.
    report
        Called with the number of nodes that are done, and of those that there are by now.

    Raises
    ------
    UsageError
        The template has loops or no joint, or the library is empty.
    """
    o = options or CompositionOptions()
    if template.loops:
        raise UsageError("a template is a tree, and the skeleton has a loop")
    if not len(template.joints):
        raise UsageError("the template has no joint, so there is nothing to replace")
    if not library.entries:
        raise UsageError("the library of subtrees is empty")
    if not (0.0 <= o.p_replace <= 1.0 and o.depth >= 1):
        raise UsageError("p_replace must lie between 0 and 1, depth must be at least 1")
    rng = np.random.default_rng(whole(seed, "seed", 0))
    skel = template.replaced(mapping=None)
    # Nodes keep their places in a queue by a number of their own, which edits carry along.
    ident = np.arange(skel.n_nodes)
    skel = skel.replaced(tags={"order": branch_orders(skel)})
    depth_of = {skel.root: o.depth}
    next_ident = skel.n_nodes
    todo = [skel.root]
    done = 0
    while todo:
        done += 1
        if report is not None:
            report(done, max(done + len(todo), skel.n_nodes))
        node = int(np.flatnonzero(ident == todo.pop(0))[0])
        left = depth_of[int(ident[node])]
        for child in _children(skel, ident, node):
            at = int(np.flatnonzero(ident == child)[0])
            place = int(np.flatnonzero(ident == ident[node])[0])
            depth_of[child] = left
            is_joint = skel.degree[place] >= 3 and skel.parents[0][place] >= 0
            if not is_joint or left <= 0 or rng.random() >= o.p_replace:
                todo.append(child)
                continue
            made = _replace(skel, ident, at, library, rng, o, next_ident)
            if made is None:
                todo.append(child)
                continue
            node_ident = int(ident[place])
            skel, ident, first = made
            next_ident = int(ident.max()) + 1
            depth_of[first] = left - 1
            todo.append(first)
            node = int(np.flatnonzero(ident == node_ident)[0])
    skel = skel.replaced(tags={"order": branch_orders(skel)})
    skel.check()
    return skel


def _children(skel: Skeleton, ident: np.ndarray, node: int) -> list[int]:
    """Return the numbers of the nodes that a node bears."""
    return [int(k) for k in ident[skel.parents[0] == node]]


def _replace(
    skel: Skeleton,
    ident: np.ndarray,
    child: int,
    library: Library,
    rng: np.random.Generator,
    o: CompositionOptions,
    next_ident: int,
) -> tuple[Skeleton, np.ndarray, int] | None:
    """Put a random subtree in the place of a child; None if none fits there."""
    parent, up, _ = skel.parents
    joint, edge = int(parent[child]), int(up[child])
    gone, lost = subtree(skel, edge)
    order = int(skel.tags["order"][edge])
    choice = library.like(order, len(lost) + 1)
    if not choice or skel.n_edges == len(lost) + 1:
        return None
    entry = choice[int(rng.integers(len(choice)))]
    rest, old = detach(skel, edge)
    kept = np.setdiff1d(np.arange(skel.n_nodes), gone)
    ident = ident[kept]
    at = int(np.flatnonzero(kept == joint)[0])
    bearer = skel.pos[joint] - skel.pos[parent[joint]]
    length = longest_path(old) * rng.uniform(*o.stretch)
    direction = skel.pos[child] - skel.pos[joint]
    turns = rng.uniform(-o.turn, o.turn, size=o.tries)
    for degrees in turns.tolist():
        way = rotation(bearer, degrees) @ direction
        part = _placed(entry, skel.pos[joint], frame(way, bearer), length)
        part = part.replaced(radius=_radii(part, rest, at, o))
        if not collides(rest, at, part):
            break
    else:
        return None
    fresh = next_ident + np.arange(part.n_nodes - 1)
    nodes = np.arange(part.n_nodes) != part.root
    number = np.empty(part.n_nodes, dtype=np.int64)
    number[nodes] = rest.n_nodes + np.arange(part.n_nodes - 1)
    number[part.root] = at
    joined = Skeleton(
        np.concatenate([rest.pos, part.pos[nodes]]),
        np.concatenate([rest.radius, part.radius[nodes]]),
        np.concatenate([rest.edges, number[part.edges]]),
        rest.root,
        None,
        {"order": np.concatenate([rest.tags["order"], order + branch_orders(part)])},
    )
    ptr, others, _ = part.incidence
    first = int(number[others[ptr[part.root]]])
    numbers = np.concatenate([ident, fresh])
    return joined, numbers, int(numbers[first])


def _placed(entry: Entry, origin: Floats, axes: Floats, length: float) -> Skeleton:
    """Return an entry at a place, with a length."""
    skel = entry.skeleton
    return skel.replaced(
        pos=origin + length * skel.pos @ axes.T, radius=length * skel.radius, tags={}
    )


def _radii(part: Skeleton, rest: Skeleton, at: int, o: CompositionOptions) -> Floats:
    """Return the radii of a subtree so that its joint bears it.

    (a) they grow with its length; (b) its base has at most a share of the joint's radius; (c) the
    sum of the children's radii to the power gamma does not exceed the joint's; (d) one factor for
    all, with a least radius.
    """
    ptr, others, _ = part.incidence
    base = float(part.radius[others[ptr[part.root]]])
    joint = float(rest.radius[at])
    parent, _, _ = rest.parents
    siblings = rest.radius[parent == at]
    free = joint**o.gamma - float((siblings**o.gamma).sum())
    most = min(o.share * joint, max(free, 0.0) ** (1.0 / o.gamma))
    # Siblings that use the joint up leave room for a twig.
    most = max(most, o.thinnest * joint)
    thin = part.radius * min(1.0, most / base)
    return np.asarray(np.maximum(thin, o.thinnest * joint))


def collides(rest: Skeleton, at: int, part: Skeleton) -> bool:
    """Return whether a subtree at a node runs into limbs that do not meet at that node."""
    far = ~(rest.edges == at).any(axis=1)
    if not far.any():
        return False
    edges = rest.edges[far]
    thick = rest.radius[edges].max(axis=1)
    # The first segment begins inside its joint, as thick as it ends.
    own = np.minimum(part.radius[part.edges].max(axis=1), _outer(part))
    ends, others = rest.pos[edges], part.pos[part.edges]
    k, j = _near_pairs(_boxes(ends, thick), _boxes(others, own))
    distance = segment_distances(ends[k, 0], ends[k, 1], others[j, 0], others[j, 1])
    return bool((distance < thick[k] + own[j]).any())


def _boxes(ends: Floats, radius: Floats) -> tuple[Floats, Floats]:
    """Return lower and upper corners (n, 3) of the boxes of limbs with ends (n, 2, 3)."""
    r = (1.0 + 1e-9) * radius[:, None]
    return ends.min(axis=1) - r, ends.max(axis=1) + r


def _near_pairs(a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> tuple[Ints, Ints]:
    """Return the numbers of all pairs of boxes that touch: only these limbs can touch."""
    near = np.flatnonzero(((a[0] <= b[1].max(axis=0)) & (b[0].min(axis=0) <= a[1])).all(axis=1))
    touch = np.ones((len(near), len(b[0])), np.bool_)
    for axis in range(3):
        low, high = a[0][near, axis, None], a[1][near, axis, None]
        touch &= (low <= b[1][:, axis]) & (b[0][:, axis] <= high)
    k, j = np.nonzero(touch)
    return near[k], j


def _outer(part: Skeleton) -> Floats:
    """Return for every edge the radius of the end away from the root."""
    _, up, order = part.parents
    found = np.empty(part.n_edges)
    nodes = order[1:]
    found[up[nodes]] = part.radius[nodes]
    return found


def segment_distances(p0: Floats, p1: Floats, q0: Floats, q1: Floats) -> Floats:
    """Return the distances (n,) of segments p and q, each of ends (n, 3) (Ericson 2005, 5.1.9)."""
    d1, d2, r = p1 - p0, q1 - q0, p0 - q0
    a = np.maximum((d1 * d1).sum(-1), 1e-300)
    e = np.maximum((d2 * d2).sum(-1), 1e-300)
    f, c, b = (d2 * r).sum(-1), (d1 * r).sum(-1), (d1 * d2).sum(-1)
    denominator = a * e - b * b
    s = np.where(denominator > 1e-12 * a * e, (b * f - c * e) / np.maximum(denominator, 1e-300), 0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    gap = r + s[:, None] * d1 - t[:, None] * d2
    return np.asarray(np.linalg.norm(gap, axis=-1))
