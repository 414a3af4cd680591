"""Deep derivations: what is deep is traced, what never ends is told with its path."""

from __future__ import annotations

import numpy as np
import pytest

import pcsg
from pcsg.errors import EnvironmentFault, EvaluationFault, GrammarError
from pcsg.grammar import load_text
from pcsg.graph.graph import GLOBALS
from pcsg.graph.unroll import enumerate_states
from pcsg.trace.expand import expansion
from pcsg.trace.expand.expansion import Expansion
from pcsg.trace.pool import make_pool
from pcsg.trace.walker import Walker

CHAIN = """{{i = {n}}} LOOP
LOOP if(i > 0, 2, 1)
1: LOOP -> empty
2: LOOP -> {{i = i - 1}} (move(20*rand(i,1), 20*rand(i,2), 5*rand(i,3)) sphere | {inner} LOOP)
"""


def chain(n: int, inner: str = "move(0, 0, 0.001)") -> str:
    return CHAIN.format(n=n, inner=inner)


ENDLESS = """{i = 0} LOOP
LOOP if(i >= 0, 2, 1)
1: LOOP -> empty
2: LOOP -> {i = i + 1} (sphere | move(0, 0, 0.001) LOOP)
"""


def expand(text: str) -> Expansion:
    graph = load_text(text)
    return Expansion(graph, GLOBALS, make_pool(graph), 1 << 30)


def test_a_chain_deeper_than_ten_thousand_is_the_same_for_both_engines() -> None:
    rng = np.random.default_rng(1)
    origins, directions = rng.uniform(-5, 25, (40, 3)), rng.normal(size=(40, 3))
    ours, theirs = (
        pcsg.loads(chain(15_000), engine=engine).intersect(origins, directions)  # type: ignore[arg-type]
        for engine in ("states", "cyclic")
    )
    assert ours.mask.sum() > 10
    np.testing.assert_allclose(ours.t, theirs.t, rtol=1e-9)


def test_two_million_selections_are_the_walkers_limit() -> None:
    # Without a box that the frames leave: every ray goes all the way down.
    walker = Walker(load_text(ENDLESS), threads=1)
    with pytest.raises(EvaluationFault, match="2000000 selections on one path") as caught:
        walker.intersect([[5, 0, -9]], [[0, 0, -1]])
    assert "axiom > LOOP:2 (2000000 times)" in str(caught.value)
    assert "i = 2000000" in str(caught.value)


def test_a_walk_that_needs_more_memory_than_it_may_says_so() -> None:
    walker = Walker(load_text(ENDLESS), threads=1, max_bytes=10 << 20)
    with pytest.raises(EnvironmentFault, match=r"more than 10 MB .* depth of the recursion"):
        walker.intersect([[5, 0, -9]], [[0, 0, -1]])


@pytest.mark.parametrize("n", [2_000, 5_000])
def test_a_table_has_the_same_limit(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expansion, "MOST_SELECTIONS", 3_000)
    found = expand(chain(n))
    if n < 3_000:
        assert not found.diagnostics
        return
    (told,) = found.diagnostics
    assert told.code == "depth-limit" and "more than 3000 modules" in told.message
    assert told.notes[0][0] == "derivation: axiom > LOOP:2 (3001 times)"
    assert "i = 2000" in told.notes[1][0]


def test_a_table_that_never_ends_is_told_while_it_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expansion, "MOST_SELECTIONS", 3_000)
    found = expand(ENDLESS)
    assert found.n_states < 100_000
    assert "derivation: axiom > LOOP:2 (3001 times)" in str(found.diagnostics[0].notes)


def test_the_longest_path_counts_not_the_one_that_was_found_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(expansion, "MOST_SELECTIONS", 3_000)
    # Every state is met first from above, with one step less: by twos, then by ones.
    text = """{i = 4000} A
    A if(i > 0, 2, 1)
    1: A -> sphere
    2: A -> {i = max(0, i - 2)} move(1, 0, 0) A | {i = i - 1} move(0, 1, 0) A
    """
    (told,) = expand(text).diagnostics
    assert told.notes[0][0] == "derivation: axiom > A:2 (3001 times)"


def test_frames_that_shrink_end_a_table_without_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expansion, "MOST_SELECTIONS", 3_000)
    assert not expand(chain(5_000, inner="uscale(0.9) move(1, 0, 0)")).diagnostics


@pytest.mark.parametrize(("inner", "faults"), [("move(1, 0, 0)", 1), ("uscale(0.999)", 0)])
def test_states_that_contain_themselves_are_told_unless_they_shrink(
    inner: str, faults: int
) -> None:
    text = f"""{{c = 0}} A
    A if(c >= 0, 2, 1)
    1: A -> box
    2: A -> {{c = 1 - c}} (sphere | {inner} A)
    """
    found = enumerate_states(load_text(text)).diagnostics
    assert len(found) == faults
    if faults:
        assert "A:2 (2000001 times)" in str(found[0].notes)
        with pytest.raises(GrammarError, match="more than 2000000 modules"):
            pcsg.loads(text)


def test_a_ray_that_looks_at_too_many_modules_is_told() -> None:
    """Instead of minutes in which nothing is heard, and no interrupt either."""
    walker = pcsg.loads("for(i, 0, 999) move(3*i, 0, 0) box", engine="cyclic").tracer
    assert isinstance(walker, Walker)
    along = [-9.0, 0.0, 0.0], [1.0, 0.0, 0.0]
    assert walker.intersect(*along).t[0] == 8.0
    walker.tables = walker.tables._replace(visit_limit=500)
    with pytest.raises(EvaluationFault, match=r"long-ray.*more than 500 modules"):
        walker.spans(*along)
    assert walker.occluded([-9.0, 4.0, 0.0], [1.0, 0.0, 0.0]).tolist() == [False]
