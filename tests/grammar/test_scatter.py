"""`scatter`: a copy for each row of a table, in grammars and in Python."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import oracle
import pytest
from consistency import check_engines, rays_through

import pcsg
from pcsg.errors import GrammarError, PcsgError, UsageError
from pcsg.grammar import load_file, load_text
from pcsg.graph.graph import Graph
from pcsg.graph.text import to_pcsg

TREES = """x,y,z,rotz,scale,age,kind
0,0,0,0,1,3,oak
3,0,0,30,0.5,4,birch
0,3,0,60,2,5,oak
"""


def load(folder: Path, text: str, table: str = TREES, name: str = "trees.csv") -> Graph:
    (folder / name).write_text(table, encoding="utf-8")
    (folder / "stand.pcsg").write_text(text, encoding="utf-8")
    return load_file(folder / "stand.pcsg")


def placed(graph: Graph) -> list[tuple[object, ...]]:
    """Return the places of all leaves, in the order of the text."""
    leaves = oracle.leaves(graph)
    return [(leaf.name, *(x for row in leaf.frame for x in row), *leaf.args) for leaf in leaves]


def test_a_row_is_placed_and_gives_parameters(tmp_path: Path) -> None:
    graph = load(tmp_path, 'scatter("trees.csv") scale(1, ROW, age) box')
    written = pcsg.loads(
        "move(0,0,0) rotz(0) uscale(1) scale(1,1,3) box"
        " | move(3,0,0) rotz(30) uscale(0.5) scale(1,2,4) box"
        " | move(0,3,0) rotz(60) uscale(2) scale(1,3,5) box"
    )
    assert placed(graph) == placed(written.graph)


def test_words_are_numbered_in_the_order_that_is_given(tmp_path: Path) -> None:
    text = """scatter("trees.csv", kind = "birch, oak") TREE
TREE kind
1: TREE -> box
2: TREE -> sphere
"""
    assert [p[0] for p in placed(load(tmp_path, text))] == ["sphere", "box", "sphere"]


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 32, 100, 1000])
def test_every_row_has_one_copy_in_its_order(count: int) -> None:
    table = {"x": np.arange(count) + 0.5, "h": 2.0 ** -np.arange(count)}
    graph = Graph(pcsg.scatter(pcsg.scale(1, 1, pcsg.P.h) * pcsg.box, table))
    shown = [p for p in placed(graph) if p[0] != "empty"]
    assert [p[4] for p in shown] == table["x"].tolist()
    assert [p[11] for p in shown] == table["h"].tolist()


@pytest.mark.parametrize(
    ("names", "text"),
    [
        ("x y z nx ny nz sx sy sz", "move(1,2,3) align(4,5,6) scale(7,8,9)"),
        ("x rotx roty", "move(1,0,0) rotx(2) roty(3)"),
        ("rotz sy", "rotz(1) scale(1,2,1)"),
        (
            "m11 m12 m13 m14 m21 m22 m23 m24 m31 m32 m33 m34",
            "matrix(1,2,3,4,5,6,7,8,9,10,12,12)",
        ),
    ],
)
def test_columns_stand_for_transformations(names: str, text: str) -> None:
    values = {name: np.array([k + 1.0]) for k, name in enumerate(names.split())}
    if "m33" in values:
        values["m33"] += 1.0
    graph = Graph(pcsg.scatter(pcsg.sphere, values))
    assert placed(graph) == placed(pcsg.loads(f"{text} sphere").graph)


def test_text_reads_back_to_an_equal_graph(tmp_path: Path) -> None:
    text = """{n = 2} (scatter("trees.csv", kind = "oak,birch") TREE
    | for(i, 1, 3) scatter("trees.csv") move(0, 0, 5 * i) uscale(ROW) disc | TREE)
TREE kind
1: TREE -> uscale(age) leaf
2: TREE -> leaf
leaf = cone | scatter("trees.csv") cone
"""
    graph = load(tmp_path, "{kind = 1; age = 2} (" + text.replace("\nTREE kind", ")\nTREE kind"))
    again = load(tmp_path, to_pcsg(graph))
    assert again == graph
    assert to_pcsg(again) == to_pcsg(graph)
    other = load(tmp_path, to_pcsg(graph), TREES.replace("0.5", "0.25"))
    assert other != graph


def test_both_engines_agree_with_many_rows() -> None:
    rng = np.random.default_rng(3)
    n = 400
    places, normals = rng.uniform(-4, 4, (n, 3)), rng.normal(size=(n, 3))
    table = dict(zip(("x", "y", "z"), places.T, strict=True))
    table |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    table["size"] = rng.uniform(0.2, 0.6, n)
    body = pcsg.uscale(pcsg.P.size) * (
        pcsg.scale(1, 1, 0.2) * pcsg.sphere() | pcsg.move(0, 0, 1) * pcsg.uscale(0.3) * pcsg.box()
    )
    graph = Graph(pcsg.scatter(body, table))
    assert check_engines(graph, rays_through(graph, rng, 300)) > 100


def test_a_structured_array_and_files_of_numpy_are_tables(tmp_path: Path) -> None:
    rows = np.array([(1.0, 2.0), (3.0, 4.0)], [("x", "f8"), ("age", "f8")])
    np.save(tmp_path / "rows.npy", rows)
    np.savez(tmp_path / "rows.npz", x=rows["x"], age=rows["age"])
    expected = placed(Graph(pcsg.scatter(pcsg.uscale(pcsg.P.age) * pcsg.box, rows)))
    assert [p[4] for p in expected] == [1.0, 3.0]
    for name in ("rows.npy", "rows.npz"):
        (tmp_path / "stand.pcsg").write_text(f'scatter("{name}") uscale(age) box')
        assert placed(load_file(tmp_path / "stand.pcsg")) == expected


def test_graphs_with_tables_are_copied_and_pickled() -> None:
    graph = Graph(pcsg.scatter(pcsg.sphere, {"x": np.arange(40.0)}))
    assert pickle.loads(pickle.dumps(graph)) == graph
    assert copy.deepcopy(graph) == graph


def test_a_table_without_a_file_cannot_be_written() -> None:
    graph = Graph(pcsg.scatter(pcsg.sphere, {"x": np.arange(40.0)}))
    with pytest.raises(UsageError, match="save it to a CSV file"):
        to_pcsg(graph)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_any_delimiter_and_line_end_is_read(
    tmp_path: Path, delimiter: str, end: str, mark: str
) -> None:
    table = mark + end.join(["x,y", "1,2", " 3 ,4e0", "", "-5,.5"]).replace(",", delimiter)
    (tmp_path / "t.csv").write_bytes(table.encode())
    (tmp_path / "stand.pcsg").write_text('scatter("t.csv") box')
    found = placed(load_file(tmp_path / "stand.pcsg"))
    assert [(p[4], p[8]) for p in found] == [(1, 2), (3, 4), (-5, 0.5)]


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("x,y\n1,2\n3,four\n", "line 3, column `y`: `four` is no number"),
        ("x,y\n1,2\n3,\n", "line 3, column `y`: there is no number"),
        ("x,age\n1,2\n3,nan\n", "line 3, column `age` is nan"),
        ("x,age\n1,2\n3,1e999\n", "line 3, column `age` is inf"),
        ("x,y\n1,2\n3\n4,5,6\n", "line 3 has 1 cells, the first line names 2 columns"),
        ("x,x\n1,2\n", "two columns are called `x`"),
        ("x,\n1,2\n", "column 2 has no name"),
        ("1,2\n3,4\n", "line 1 is all numbers"),
        ("", "it is empty"),
        ("x,nx\n1,2\n", "the column `ny` is missing beside `nx`"),
        ("rotx,nx,ny,nz\n1,2,3,4\n", "not by both"),
        ("scale,sx\n1,2\n", "not by both"),
        ("kind\noak\n", "no column of numbers"),
    ],
)
def test_a_mistake_in_a_table_is_told_with_its_place(tmp_path: Path, table: str, says: str) -> None:
    with pytest.raises(GrammarError, match="bad-file") as error:
        load(tmp_path, 'scatter("trees.csv") box', table)
    assert says in str(error.value)


def test_words_that_are_not_listed_are_told(tmp_path: Path) -> None:
    with pytest.raises(GrammarError, match="row 2, column `kind`: `birch` is none of: oak, elm"):
        load(tmp_path, 'scatter("trees.csv", kind = "oak, elm") box')


def test_a_column_of_words_is_told_only_if_it_is_read(tmp_path: Path) -> None:
    load(tmp_path, 'scatter("trees.csv") box')
    with pytest.raises(PcsgError, match="`kind`"):
        pcsg.Scene(load(tmp_path, 'scatter("trees.csv") uscale(kind) box')).intersect(
            [[0, 0, 9]], [[0, 0, -1]]
        )


def test_a_file_outside_is_refused(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "trees.csv").write_text(TREES)
    (tmp_path / "inner" / "stand.pcsg").write_text('scatter("../trees.csv") box')
    with pytest.raises(GrammarError, match="outside the folder"):
        load_file(tmp_path / "inner" / "stand.pcsg")


def test_scatter_is_a_name_elsewhere() -> None:
    for text in ("scatter | box\nscatter = sphere", "{scatter = 2} uscale(scatter) box"):
        assert load_text(text) is not None


@pytest.mark.parametrize(
    "table", [{"x": [1.0, np.nan]}, {"x": [1.0], "y": [1.0, 2.0]}, 3, {"x": 1}]
)
def test_a_table_that_makes_no_sense_is_told(table: object) -> None:
    with pytest.raises(UsageError):
        pcsg.scatter(pcsg.sphere, table)
