"""Points that lie on surfaces, in corners and near them."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from agreement import ENGINES

from pcsg.grammar import load_text

FAR = "move(9,0,0) sphere | move(0,9,0) box | move(0,0,9) sphere | move(9,9,0) sphere"
SCENES = {
    "cone": "cone",
    "small difference": r"cone \ move(0,0,-3) sphere",
    "small intersection": "cone & uscale(2) box",
    "large difference": rf"{{}} (((cone | move(5,0,0) cone) \ ({FAR} | move(0,0,-3) sphere)))",
    "large intersection": f"{{}} ((({FAR} | cone) & ({FAR} | uscale(2) sphere)))",
    "nested": rf"{{}} (((({FAR} | cone) & uscale(2) sphere) \ ({FAR} | uscale(0.3) box)))",
    "with a sheet": r"{} (((cone | tri1 | move(0,0,1) tri1) \ (move(0,0,-3) sphere)))",
}
TIP, FOOT, BELOW, ABOVE = (0, 0, 1), (1, 0, 0), (0, 0, 0), (0, 0, 1.001)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", ENGINES)
def test_tips_rims_and_faces_belong_to_the_solid(name: str, engine: str) -> None:
    graph = load_text(SCENES[name])
    lattice = np.stack(np.meshgrid(*[np.arange(-4, 5) / 4] * 3), -1).reshape(-1, 3)
    points = np.concatenate([[TIP, FOOT, BELOW, ABOVE], lattice])
    found = ENGINES[engine](graph).contains(points)
    assert found[0]
    assert not found[3]
    assert found.tolist() == [oracle.contains(graph, p) for p in points.tolist()]
