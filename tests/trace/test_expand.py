"""Expansion in compiled code: states, hierarchies and their boxes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import strategies as cases
from agreement import make_expanded, make_states, make_suspended
from consistency import opened
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import pcsg
from pcsg.errors import GrammarError
from pcsg.grammar import load_text
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import Selection
from pcsg.graph.operators import OPERATORS
from pcsg.graph.states import Combine, LeafItem, StateItem
from pcsg.graph.unroll import enumerate_states
from pcsg.leaf import LEAVES
from pcsg.leaf.registry import Solid
from pcsg.simd import WIDTH
from pcsg.trace.blocks import Blocks
from pcsg.trace.expand.expansion import Expansion, TooLarge
from pcsg.trace.expand.pack import pack_expansion
from pcsg.trace.expand.table import LEAF, STATE
from pcsg.trace.groups import BLOCK, EMPTY, INSTANCE
from pcsg.trace.groups import LEAF as LEAF_REF
from pcsg.trace.pool import make_pool
from pcsg.trace.walker import Walker
from pcsg.vec import Vec3

HALVES = """
HALF if(n > 1, 2, 1)
1: HALF -> {thing}
2: HALF -> {{n = floor(n/2)}} HALF | {{a = a + floor(n/2); n = n - floor(n/2)}} HALF
"""
BALL = "move(100*rand(a,1), 100*rand(a,2), 100*rand(a,3)) uscale(2 + 3*rand(a,4)) sphere"


def scatter(n: int, thing: str = BALL, around: str = "HALF") -> str:
    """Return a grammar of n things that all differ."""
    halves = HALVES.format(thing=thing).replace("{{", "{").replace("}}", "}")
    return f"{{a = 0; n = {n}}} ({around})\n{halves}"


def expand(graph: Graph, memory: int = 1 << 30) -> Expansion:
    return Expansion(graph, GLOBALS, make_pool(graph), memory)


def contents(found: Expansion) -> dict[tuple[object, ...], list[tuple[object, ...]]]:
    """Return the items of every state, in the order of the text, by what the state is."""
    table, graph = found.table, found.graph
    keys: list[tuple[object, ...]] = [(0, 0, b"")]
    for s in range(1, found.n_states):
        node, rule, _ = found._writer.link_of(int(table.module[s]), int(table.program[s]))
        values = table.values[table.values_at[s] : table.values_at[s + 1]]
        keys.append(
            (node, rule if isinstance(graph.nodes[node], Selection) else 0, values.tobytes())
        )
    out: dict[tuple[object, ...], list[tuple[object, ...]]] = {}
    for s, key in enumerate(keys):
        items: list[tuple[object, ...]] = []
        for i in range(table.first[s], table.last[s]):
            m = int(table.matrix[i])
            matrix = b"" if m < 0 else table.matrices[12 * m : 12 * m + 12].tobytes()
            target = int(table.target[i])
            if table.kind[i] == LEAF:
                items.append(("leaf", found._writer.leaf_nodes[target], matrix))
            elif table.kind[i] == STATE:
                items.append(("state", keys[target], matrix))
            else:
                items.append(("operation", target))
        out[key] = items
    return out


def reference(graph: Graph) -> dict[tuple[object, ...], list[tuple[object, ...]]]:
    """Return the same of the reference in Python."""
    states = enumerate_states(graph, GLOBALS)
    keys: list[tuple[object, ...]] = []
    for k, s in enumerate(states.states):
        selects = k > 0 and isinstance(graph.nodes[s.node], Selection)
        values = np.array(s.values, np.float64).tobytes() if k else b""
        node = graph.nodes[s.node]
        # Where there is no choice the reference numbers the rule by its place in the text.
        rule = s.rule if selects and isinstance(node, Selection) else 0
        keys.append((s.node if k else 0, rule, values))
    found: dict[tuple[object, ...], list[tuple[object, ...]]] = {}
    for key, s in zip(keys, states.states, strict=True):
        stack: list[list[tuple[object, ...]]] = []
        for item in s.content or ():
            if isinstance(item, Combine):
                at = len(stack) - item.arity
                operands = stack[at:]
                del stack[at:]
                head = ("operation", item.operator.kind)
                stack.append([head, *(x for operand in operands for x in operand)])
            elif isinstance(item, LeafItem):
                stack.append([("leaf", item.node, _bits(item.state_from_leaf))])
            else:
                assert isinstance(item, StateItem)
                stack.append([("state", keys[item.state], _bits(item.state_from_child))])
        found[key] = stack[-1]
    return found


def _bits(matrix: tuple[float, ...]) -> bytes:
    array = np.array(matrix)
    return b"" if (array == np.eye(4)[:3].ravel()).all() else array.tobytes()


def _without_identities(
    found: dict[tuple[object, ...], list[tuple[object, ...]]],
) -> dict[tuple[object, ...], list[tuple[object, ...]]]:
    identity = np.eye(4)[:3].ravel()

    def plain(item: tuple[object, ...]) -> tuple[object, ...]:
        if item[0] == "operation" or not isinstance(item[2], bytes):
            return item
        same = item[2] and (np.frombuffer(item[2]) == identity).all()
        return (*item[:2], b"" if same else item[2])

    return {key: [plain(item) for item in items] for key, items in found.items()}


@given(data=st.data())
def test_states_are_those_of_the_reference_bit_for_bit(data: st.DataObject) -> None:
    graph = data.draw(cases.graphs())
    assert _without_identities(contents(expand(graph))) == reference(graph)


def leaves_below(blocks: Blocks, block: int) -> list[int]:
    """Return the references of a hierarchy, instances and all, each as often as it stands there."""
    found, todo = [], [block]
    while todo:
        at = WIDTH * todo.pop()
        for code in blocks.refs[at : at + WIDTH].tolist():
            if code & 7 == BLOCK:
                todo.append(code >> 3)
            elif code & 7 != EMPTY:
                found.append(code >> 3)
    return found


@pytest.mark.parametrize("n", [1, 2, 16, 17, 100, 1_000, 5_000])
def test_every_reference_stands_in_the_hierarchy_once(n: int) -> None:
    packed = pack_expansion(expand(load_text(scatter(n))))
    assert sorted(leaves_below(packed.blocks, packed.blocks.root)) == list(range(n))
    assert packed.leaves == n


def test_boxes_contain_what_is_below() -> None:
    blocks = pack_expansion(expand(load_text(scatter(3_000)))).blocks
    planes = blocks.boxes.reshape(-1, 6, WIDTH).astype(np.float64)
    codes = blocks.refs.reshape(-1, WIDTH)
    for block in range(len(codes)):
        for k, code in enumerate(codes[block].tolist()):
            if code & 7 == BLOCK:
                inner = planes[code >> 3]
                assert (planes[block, :3, k] <= inner[:3].min(axis=1)).all()
                assert (planes[block, 3:, k] >= inner[3:].max(axis=1)).all()


def test_boxes_of_balls_are_exact() -> None:
    graph = load_text(scatter(500, "move(a, rand(a,2), 0) rotx(40*a) scale(1,2,3) sphere"))
    packed = pack_expansion(expand(graph))
    inverses = packed.blocks.inverses.reshape(-1, 3, 4)
    forward = np.linalg.inv(inverses[:, :, :3])
    reach = np.sqrt(np.square(forward).sum(axis=2))
    middle = -np.einsum("nij,nj->ni", forward, inverses[:, :, 3])
    planes = packed.blocks.boxes.reshape(-1, 6, WIDTH).transpose(0, 2, 1).reshape(-1, 6)
    balls = packed.blocks.refs & 7 == LEAF_REF
    boxes = np.empty((500, 6))
    boxes[packed.blocks.refs[balls] >> 3] = planes[balls]
    np.testing.assert_allclose(boxes[:, :3], middle - reach, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(boxes[:, 3:], middle + reach, rtol=1e-5, atol=1e-4)


PLANT = """
{a = 0; n = 150} HALF
HALF if(n > 1, 2, 1)
1: HALF -> move(500*rand(a,1), 500*rand(a,2), 0) rotz(360*rand(a,3)) {c = 9} TREE
2: HALF -> {n = floor(n/2)} HALF | {a = a + floor(n/2); n = n - floor(n/2)} HALF
TREE if(c > 0, 2, 1)
1: TREE -> uscale(0.4) sphere
2: TREE -> scale(0.1, 0.1, 1) cylinder
         | {c = c - 1} move(0,0,1) (rotx(35) uscale(0.7) TREE | rotx(-30) rotz(80) uscale(0.8) TREE)
"""


def test_what_stands_in_many_places_is_a_cluster_in_a_tight_box() -> None:
    graph = load_text(PLANT)
    packed = pack_expansion(expand(graph))
    blocks = packed.blocks
    instances = [r >> 3 for r in blocks.refs.tolist() if r & 7 == INSTANCE]
    assert packed.leaves == 150 * 1023 and packed.clusters > 1
    assert len(blocks.targets) < 20_000 and instances
    # The whole scene again, without clusters: every leaf by itself.
    lower, upper = _expanded_hull(graph)
    size = upper - lower
    assert (packed.bounded[0] <= lower + 1e-6).all() and (packed.bounded[1] >= upper - 1e-6).all()
    assert (np.abs(packed.bounded - [lower, upper]) <= 0.02 * size.max()).all()


def _expanded_hull(graph: Graph) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    scene = pcsg.Scene(graph, threads=1)
    box = scene.boxes.scene_box
    return np.array(box.lower), np.array(box.upper)


ROUND = [name for name, solid in LEAVES.items() if solid.support is not Solid.support]


@pytest.mark.parametrize("name", ROUND)
def test_supports_touch_the_boxes(name: str) -> None:
    solid = LEAVES[name]
    args = (0.4,) * len(solid.parameters)
    box = solid.bounds_of(args)
    for axis in range(3):
        unit = Vec3(*(1.0 if k == axis else 0.0 for k in range(3)))
        assert solid.support_of(unit, args) == pytest.approx(box.upper[axis], abs=1e-15)


def rays_into(graph: Graph, n: int = 300) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(7)
    return rng.uniform(-20, 120, (n, 3)), rng.normal(size=(n, 3))


VILLAGE = """move(100*rand(a,1), 100*rand(a,2), 0) color(rand(a,5), 0.5, 0.4) label(a)
  {{w = 1 + rand(a,3)}}
  (scale(w, 2*w, 3) sphere \\ move(0, -w, 0) uscale(w) box | uscale(w) cone)"""


@pytest.mark.parametrize(
    "text",
    [
        scatter(2_500),
        scatter(2_500, around="move(50,50,50) uscale(50) box \\ HALF"),
        scatter(2_500, around="move(50,50,50) uscale(45) box & HALF"),
        scatter(2_500, VILLAGE),
    ],
    ids=["scattered", "cut out", "cut off", "village"],
)
def test_scenes_of_many_states_are_those_of_the_graph(text: str) -> None:
    graph = load_text(text)
    scene = pcsg.Scene(graph, threads=1)
    assert scene.engine == "states" and not scene.states.finite
    origins, directions = rays_into(graph)
    ours = scene.intersect(origins, directions)
    theirs = Walker(graph, scene.values).intersect(origins, directions)
    assert (ours.leaf == theirs.leaf).all()
    np.testing.assert_allclose(ours.t, theirs.t, rtol=1e-9)
    np.testing.assert_allclose(ours.normal, theirs.normal, atol=1e-6)
    assert (ours.color == theirs.color).all() and (ours.label == theirs.label).all()
    assert (scene.occluded(origins, directions) == (theirs.leaf >= 0)).all()


def test_answers_are_the_same_bits_on_any_number_of_threads() -> None:
    origins, directions = rays_into(load_text(scatter(2_500)), 40_000)
    one, two = (pcsg.loads(scatter(2_500), threads=k) for k in (1, 2))
    assert (one.intersect(origins, directions).t == two.intersect(origins, directions).t).all()


def test_a_chain_is_as_good_as_a_tree() -> None:
    chain = f"""{{a = 5000}} LOOP
    LOOP if(a > 0, 2, 1)
    1: LOOP -> empty
    2: LOOP -> {{a = a - 1}} ({BALL} | LOOP)
    """
    a, b = pcsg.loads(chain), pcsg.loads(scatter(5_000))
    origins, directions = rays_into(a.graph)
    assert (a.intersect(origins, directions).t == b.intersect(origins, directions).t).all()


def test_a_fault_is_told_with_its_place_and_values() -> None:
    text = scatter(3_000, "move(a, 0, 0) scale(a - 2717, 1, 1) sphere")
    with pytest.raises(GrammarError) as caught:
        pcsg.loads(text)
    assert caught.value.diagnostics[0].code == "singular-matrix"
    assert "a = 2717" in str(caught.value) and "HALF:2 (" in str(caught.value)


def test_leaves_with_data_may_depend_on_the_place() -> None:
    text = scatter(3_000, "move(3*a, 0, 0) {{r = 0.5 + floor(3*rand(a))/10}} blob {{ point(r) }}")
    graph = load_text(text)
    scene, walker = pcsg.Scene(graph, threads=1), Walker(graph, GLOBALS)
    origins = np.array([[3.0 * k, 0.01, 5.0] for k in range(0, 3_000, 301)])
    directions = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
    ours, theirs = (s.intersect(origins, directions) for s in (scene, walker))
    assert np.isfinite(ours.t).all()
    np.testing.assert_allclose(ours.t, theirs.t, rtol=1e-9)


def test_models_are_limited() -> None:
    text = scatter(3_000, "move(3*a, 0, 0) blob {{ point(0.5 + rand(a)) }}")
    with pytest.raises(GrammarError, match="too many models"):
        pcsg.loads(text)


def test_memory_bounds_the_table() -> None:
    with pytest.raises(TooLarge):
        expand(load_text(scatter(100_000)), 1 << 20)
    assert pcsg.loads(scatter(3_000), block_memory=1 << 16).stats()["suspended"] > 50


def test_blocks_tell_what_they_consist_of() -> None:
    text = "{} A | move(9,0,0) A | (box \\ sphere)\n1: A -> sphere | move(2,0,0) box"
    whole = make_states(load_text(text)).counts
    assert (whole["clusters"], whole["instances"], whole["flattened_leaves"]) == (0, 0, 6)
    with opened(0, 0):
        closed = make_states(load_text(text)).counts
    assert (closed["clusters"], closed["instances"], closed["flattened_leaves"]) == (1, 2, 4)
    assert whole["suspended"] == closed["suspended"] == 0
    assert make_suspended(load_text(text)).counts["suspended"] > 0


def test_what_is_empty_meets_nothing() -> None:
    tracer = make_expanded(load_text("{} empty \\ sphere"))
    assert math.isinf(tracer.intersect([[0, 0, 5]], [[0, 0, -1]]).t[0])


def test_operators_have_the_kinds_that_items_keep() -> None:
    assert [operator.kind for operator in OPERATORS] == [0, 1, 2]


def test_a_grammar_from_a_file_is_expanded_too(tmp_path: Path) -> None:
    path = tmp_path / "balls.pcsg"
    path.write_text(scatter(2_100), encoding="utf-8")
    assert pcsg.load(path).stats()["engine"] == "states"


@pytest.mark.parametrize("around", ["HALF", "move(50,50,50) uscale(50) box \\ HALF"])
def test_points_and_spans_are_those_of_the_graph(around: str) -> None:
    graph = load_text(scatter(2_500, BALL.replace("uscale", "label(a) uscale"), around))
    scene, walker = pcsg.Scene(graph, threads=1), Walker(graph, GLOBALS)
    origins, directions = rays_into(graph, 200)
    assert (scene.contains(origins) == walker.contains(origins)).all()
    ours, theirs = scene.spans(origins, directions), walker.spans(origins, directions)
    assert len(ours.t_in) > 100 and (ours.offsets == theirs.offsets).all()
    for name in ("t_in", "t_out"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9)
    for name in ("leaf_in", "leaf_out", "label_in", "label_out"):
        assert (getattr(ours, name) == getattr(theirs, name)).all()


def test_points_on_surfaces_and_sheets_are_left_to_the_walker() -> None:
    scene = pcsg.loads("{} (box \\ move(1,1,1) sphere) | move(0,0,3) tri1", threads=1)
    walker = Walker(scene.graph, scene.values)
    points = np.array([[1.0, 0, 0], [0, 0, 1.0], [1, 1, 1], [0, 0, 0], [0.2, 0.2, 3.0], [5, 5, 5]])
    assert (scene.contains(points) == walker.contains(points)).all()
    spans = scene.spans([[0.2, 0.2, 5.0]], [[0, 0, -1.0]])
    assert spans.t_in.tolist() == [2.0, 4.0] and spans.t_out.tolist() == [2.0, 6.0]


def test_no_rays_have_no_spans() -> None:
    spans = pcsg.loads(scatter(2_100)).spans(np.zeros((0, 3)), np.zeros((0, 3)))
    assert spans.offsets.tolist() == [0] and len(spans.t_in) == 0


@pytest.mark.parametrize("thing", [BALL, VILLAGE], ids=["balls", "village"])
def test_a_primitive_takes_no_more_than_it_may(thing: str) -> None:
    packed = pack_expansion(expand(load_text(scatter(4_000, thing))))
    assert packed.blocks.nbytes <= 256 * packed.leaves
