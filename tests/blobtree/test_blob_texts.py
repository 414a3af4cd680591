"""Blobs written back as text: reading it gives an equal graph, and the same field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from blob_models import random_model
from hypothesis import given
from hypothesis import strategies as st

from pcsg import Scene, blob
from pcsg import blobtree as b
from pcsg.blobtree.model import Model
from pcsg.errors import UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph.graph import Graph
from pcsg.graph.nodes import Leaf, combine
from pcsg.graph.operators import UNION
from pcsg.graph.text import to_pcsg
from pcsg.leaf.blob import BlobSource

GRAMMARS = Path(__file__).parent.parent.parent / "grammars"
WITH_BLOBS = sorted(p for p in GRAMMARS.rglob("*.pcsg") if "blob {" in p.read_text("utf-8"))
POINTS = np.random.default_rng(2).uniform(-1.5, 2.5, (400, 3))

WHOLE = """{n = 2; r = 0.4} (blob { %s } | move(9,0,0) blob { A + L(1, r) })

A if(n > 0, 2, 1)
1: A -> point(r)
2: A -> knob + move(0.7,0,0) {n = n-1; r = 0.9*r} A
one: L(c, d) : c > 1 -> segment(d, 0.3) + rotx(20) L(c-1, d)
two: L(c, d) : else -> knob
knob = label(3) point(0.5)
unused = sphere
"""


def assert_comes_back(graph: Graph) -> str:
    text = to_pcsg(graph)
    again = load_text(text)
    assert again == graph, text
    assert to_pcsg(again) == text
    return text


def sources(graph: Graph) -> list[BlobSource]:
    constants = [c for node in graph.nodes if isinstance(node, Leaf) for c in node.constants]
    return [c for c in constants if isinstance(c, BlobSource)]


numbers = st.sampled_from(["0.5", "r", "0.3+r/2", "0.8", "if(n > 1, 0.6, 0.5)"])
leaves = st.one_of(
    st.sampled_from(["A", "knob", "L(2, 0.5)", "L(n, r)", "A"]),
    numbers.map("point({})".format),
    st.builds("cone({}, {}, 0.2)".format, numbers, numbers),
    numbers.map("disc({}, 0.2)".format),
)
prefixes = st.sampled_from(
    [
        "move(0.3, 0, r)",
        "rotz(40) uscale(0.9)",
        "{n = 1}",
        "{r = 0.3; n = n-1}",
        "weight(0.7)",
        "bend(2)",
        "twist(10) taper(1, 0.8)",
        "color(r, 0, 0)",
        "label(2)",
        "flipxz",
    ]
)
expressions = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.builds("{} {}".format, prefixes, inner),
        st.builds("{} ({})".format, prefixes, inner),
        st.builds("({}) {} ({})".format, inner, st.sampled_from("+|&\\"), inner),
        st.builds("{} {} {}".format, inner, st.sampled_from("+|&\\"), inner),
        st.builds(
            "{} {{ {} , {} }}".format,
            st.sampled_from(["pcm", "pcm(0.3, r/5)", "ricci(2)", "controlled", "r_union"]),
            inner,
            inner,
        ),
        st.builds("gbb {{ {} }} {{ {} }} {{ {} }}".format, inner, inner, inner),
    ),
    max_leaves=8,
)


@given(expressions)
def test_any_blob_comes_back(text: str) -> None:
    graph = load_text(WHOLE % text)
    again = load_text(assert_comes_back(graph))
    for one, other in zip(sources(graph), sources(again), strict=True):
        assert one.parameters == other.parameters
        values = [{"n": 2.0, "r": 0.4}[name] for name in one.parameters]
        fields = [Model(source.build(values)).field(POINTS) for source in (one, other)]
        np.testing.assert_array_equal(*fields)


@pytest.mark.parametrize("path", WITH_BLOBS, ids=lambda path: path.stem)
def test_grammars_with_blobs_come_back(path: Path) -> None:
    assert_comes_back(load_file(path))


def test_text_is_laid_out() -> None:
    text = (
        "{n = 3} blob { BR }\n"
        "\n"
        "BR if(n > 0, 2, 1)\n"
        "1: BR -> cone(1, 0.3, 0.1)\n"
        "2: BR -> foot + move(0, 0, 1.2) {n = n - 1} pcm { rotz(100) BR , rotz(-100) BR }\n"
        "\n"
        "foot = cone(1.2, 0.36, 0.3)\n"
    )
    assert to_pcsg(load_text(text)) == text


def test_other_blobs_are_not_equal() -> None:
    text = "{} blob { A }\n1: A -> point(1) + move(1,0,0) B\nB = point(0.5)"
    graph = load_text(text)
    for old, new in (("+", "|"), ("0.5", "0.6"), ("move(1", "move(2")):
        other = load_text(text.replace(old, new))
        assert other != graph
        assert Scene(other).source_hash != Scene(graph).source_hash
    assert load_text(text.replace(" + ", "   +   ")) == graph


def test_blobs_of_two_texts_must_not_share_names() -> None:
    one, other = (load_text(f"{{}} blob {{ A }}\n1: A -> point({r})") for r in (1, 2))
    with pytest.raises(UsageError, match="two things are called `A`"):
        to_pcsg(Graph(combine(UNION, (one.root, other.root))))
    twice = Graph(combine(UNION, (one.root, load_text(to_pcsg(one)).root)))
    assert to_pcsg(twice).count("1: A") == 1


def test_generated_names_keep_clear_of_a_blobs() -> None:
    text = "{part_2 = 1} (blob { part_1 } | sphere)\npart_1 = point(part_2)"
    shared = load_text(text).root
    written = assert_comes_back(Graph(combine(UNION, (shared, shared))))
    assert "part_3 = {part_2 = 1}" in written


def test_a_field_of_python_has_no_text_but_a_digest() -> None:
    fields = [random_model(np.random.default_rng(seed)) for seed in (5, 5, 6)]
    with pytest.raises(UsageError, match="data of this `blob`; write the field in"):
        to_pcsg(Scene(blob(fields[0])).graph)
    same, again, other = (Scene(blob(field)).source_hash for field in fields)
    assert same == again != other
    shared = b.point(1.0)
    assert Scene(blob(shared + shared)).source_hash != Scene(blob(shared + b.point(1))).source_hash
