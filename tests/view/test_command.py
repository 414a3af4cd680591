from pathlib import Path

import pytest

from pcsg.commands.view import ViewArguments, find_file, run
from pcsg.errors import EnvironmentFault, UsageError

ARGUMENTS = {
    "file": "ball.pcsg",
    "port": 0,
    "host": "127.0.0.1",
    "insecure": False,
    "certificate": None,
    "key": None,
    "browser": False,
    "assignments": (),
    "seed": None,
    "time": None,
    "threads": None,
    "include": (),
    "max_memory": None,
    "block_memory": None,
    "engine": "auto",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    (tmp_path / "ball.pcsg").write_text("sphere\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_files_come_before_names_of_ours(folder):
    assert find_file("ball.pcsg") == (Path("ball.pcsg"), False)
    path, shipped = find_file("tree")
    assert path.name == "tree.pcsg" and shipped
    path, shipped = find_file("populus")
    assert path.name == "populus.json" and shipped
    (folder / "tree").write_text("box\n")
    assert find_file("tree") == (Path("tree"), False)


@pytest.mark.parametrize("name", ["nothing.pcsg", ".", "bal"])
def test_what_is_no_file_is_told(name):
    with pytest.raises(UsageError):
        find_file(name)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"host": "0.0.0.0"}, "ssh -L"),
        ({"port": 70_000}, "--port"),
        ({"assignments": ("n",)}, "-D"),
        ({"max_memory": "much"}, "--max-memory"),
    ],
)
def test_wrong_options_are_told_before_anything_starts(wrong, told):
    with pytest.raises(UsageError, match=told):
        run(ViewArguments(**{**ARGUMENTS, **wrong}))


def test_a_certificate_that_is_none_is_told(folder):
    (folder / "no.pem").write_text("no certificate\n")
    for name in ("no.pem", "missing.pem"):
        with pytest.raises(EnvironmentFault, match=name):
            run(ViewArguments(**{**ARGUMENTS, "certificate": Path(name)}))
