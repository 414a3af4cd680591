"""Solids that are compiled apart: engines and oracle agree, and size changes no bit."""

from __future__ import annotations

import math

import numpy as np
import oracle
import pytest

import pcsg
from pcsg.grammar import load_text

TEXTS = (
    r"{} (rotx(20) superellipsoid(0.3,1.5) \ uscale(0.7) superellipsoid(1,0.2))",
    "{} ((superellipsoid(0.3,1.5) & move(0.3,0,0) sphere) | move(2,0,0) rotx(30) capsule(0.4))",
    r"{} ((box & infcone(0.3)) \ rotx(90) uscale(.4) infcylinder)",
    "{n=3} A\nA if(n>0,2,1)\n1: A -> superellipsoid(0.5,n+0.5)\n"
    "2: A -> {n=n-1} (move(2,0,0) uscale(0.6) A | capsule(n/2))",
)
RAYS = 40


@pytest.mark.parametrize("text", TEXTS)
def test_engines_and_oracle_agree(text: str) -> None:
    rng = np.random.default_rng(1)
    graph = load_text(text)
    states, walked = (pcsg.loads(text, engine=name) for name in ("states", "cyclic"))
    low, high = np.array(states.bounds)
    origins = rng.uniform(low - 1.0, high + 1.0, (RAYS, 3))
    directions = rng.uniform(low, high, (RAYS, 3)) - origins
    spans, others = states.spans(origins, directions), walked.spans(origins, directions)
    np.testing.assert_array_equal(spans.offsets, others.offsets)
    assert len(spans.t_in) > RAYS // 4
    np.testing.assert_allclose(spans.t_in, others.t_in, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(spans.t_out, others.t_out, rtol=0.0, atol=1e-13)
    for k in range(RAYS):
        own = slice(spans.offsets[k], spans.offsets[k + 1])
        events = oracle.events(graph, tuple(origins[k]), tuple(directions[k]))
        expected = sorted(e.t for e in events if math.isfinite(e.t))
        found = np.sort(np.concatenate([spans.t_in[own], spans.t_out[own]]))
        np.testing.assert_allclose(found[np.isfinite(found)], expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("text", TEXTS[:3])
def test_size_changes_no_bit(text: str) -> None:
    rng = np.random.default_rng(2)
    plain, large = pcsg.loads(text), pcsg.loads(text.replace("{}", "{} uscale(2^30)", 1))
    low, high = np.array(plain.bounds)
    origins = rng.uniform(low - 1.0, high + 1.0, (400, 3))
    directions = rng.uniform(low, high, (400, 3)) - origins
    expected = plain.intersect(origins, directions)
    found = large.intersect(origins * 2.0**30, directions * 2.0**30)
    np.testing.assert_array_equal(found.t, expected.t)
    np.testing.assert_array_equal(found.normal, expected.normal)
