from pathlib import Path

import pytest

from pcsg.view.answering import answers
from pcsg.view.opening import Limits, Prepared, open_grammar
from pcsg.view.wants import Question, Want

TEXT = """{n = 2} S
S if(n > 0, 1, 2)
1: S -> material(clay) box | {n = n-1} move(3, 0, 0) S
2: S -> sphere
material clay { color = (0.5, 0.2, 0.1) }
ground { z = -1 }
camera { eye = (0, -20, 0); target = (0, 0, 0) }
"""


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    file = tmp_path_factory.mktemp("answers") / "a.pcsg"
    file.write_text(TEXT)
    return Prepared.make(open_grammar(Path(file), ()), {}, Limits(), (40, 30))


def ask(prepared, x, y):
    return list(answers(prepared, Question(Want(size=(40, 30)), (x, y))))


def test_a_solid_is_told_with_its_line_and_then_its_derivation(prepared):
    first, last = ask(prepared, 0.5, 0.5)
    assert first["partial"]
    assert {name: last[name] for name in ("what", "file", "line", "material")} == {
        "what": "box",
        "file": "a.pcsg",
        "line": 3,
        "material": "clay",
    }
    assert last["source"].startswith("1: S -> material(clay) box")
    assert last["derivation"] == "axiom > S:1"
    assert last["values"] == {"n": 2.0}
    assert last["position"] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert last["distance"] == pytest.approx(19.0)


def test_sky_and_ground_are_told(prepared):
    assert ask(prepared, 0.5, 0.0) == [{"type": "answer", "hit": False}]
    (found,) = ask(prepared, 0.1, 0.95)
    assert found["what"] == "the ground"
    assert found["position"][2] == pytest.approx(-1.0)
