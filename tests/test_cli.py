import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import pcsg
from pcsg.cli import app
from pcsg.commands import guard as guarding
from pcsg.commands.options import (
    parse_assignments,
    parse_memory,
    parse_setting,
    parse_size,
)
from pcsg.errors import EnvironmentFault, UsageError

BALL = "sphere\n"
PYTHON = [sys.executable, "-m", "pcsg"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.pcsg").write_text(BALL)

    def call(*arguments):
        result = CliRunner().invoke(app, list(arguments))
        assert result.exception is None or isinstance(result.exception, SystemExit)
        assert "Traceback" not in result.output
        return result

    return call


def test_version(run):
    result = run("--version")
    assert result.exit_code == 0
    assert result.stdout.startswith("pcsg 0.")


@pytest.mark.parametrize("verb", ["render", "check", "stats", "graph"])
def test_every_verb_has_help(run, verb):
    result = run(verb, "--help")
    assert result.exit_code == 0
    assert "FILE" in result.stdout


def test_nothing_heavy_is_loaded_for_help():
    code = (
        "import sys, pcsg.cli;"
        "heavy = {'numpy', 'numba', 'lark', 'PIL', 'rich.progress'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["ball.pcsg", "--size", "0x5"], "size"),
        (["ball.pcsg", "--size", "-4x5"], "size"),
        (["ball.pcsg", "--size", "big"], "800x600"),
        (["ball.pcsg", "--samples", "0"], "samples"),
        (["ball.pcsg", "--threads", "0"], "threads"),
        (["ball.pcsg", "--threads", "many"], "threads"),
        (["ball.pcsg", "--max-memory", "lots"], "4G"),
        (["ball.pcsg", "-D", "cnt"], "NAME=VALUE"),
        (["ball.pcsg", "-D", "cnt=few"], "few"),
        (["ball.pcsg", "--camera", "eie=1,2,3"], "did you mean `eye`"),
        (["ball.pcsg", "--camera", "eye=1,2"], "1,2,3"),
        (["ball.pcsg", "--sky", "kind=blue"], "gradient"),
        (["ball.pcsg", "--sun", "strength=-1"], "between"),
        (["ball.pcsg", "--sun", "strength=nan"], "nan"),
        (["ball.pcsg", "--aov", "deepth"], "deepth"),
        (["ball.pcsg", "-o", "."], "folder"),
        (["ball.pcsg", "-o", "ball.gif"], ".png"),
        (["ball.pcsg", "-o", "none/ball.png"], "no folder"),
        ([], "FILE"),
        (["ball.pcsg", "--unknown"], "unknown"),
    ],
)
def test_wrong_arguments_of_render(run, tmp_path, arguments, word):
    result = run("render", *arguments)
    assert result.exit_code == 2
    assert word in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["ball.pcsg"]


def test_a_picture_that_does_not_fit_is_refused_at_once(run):
    result = run("render", "ball.pcsg", "--size", "1000000000x1000000000")
    assert result.exit_code == 1
    assert "memory" in result.output


def test_sizes():
    assert parse_size("800x600") == (800, 600)
    assert parse_size(" 1 X 2 ") == (1, 2)
    assert parse_size("3\u00d74") == (3, 4)


@pytest.mark.parametrize(
    ("text", "value"),
    [("4G", 4 << 30), ("512M", 512 << 20), ("1.5gb", 3 << 29), ("100", 100), ("2 GiB", 2 << 30)],
)
def test_memory(text, value):
    assert parse_memory(text) == value
    assert parse_memory(None) is None


def test_assignments_and_settings():
    assert parse_assignments(["a=1", "b = -2.5e3", "a=3"]) == {"a": 3.0, "b": -2500.0}
    assert parse_setting("camera", "eye=1,2,3 target=auto fov=20") == {
        "eye": (1.0, 2.0, 3.0),
        "target": None,
        "fov": 20.0,
    }
    assert parse_setting("ground", "material=grass z=-1") == {"material": "grass", "z": -1.0}
    assert parse_setting("sky", "kind=none") == {"kind": "none"}


@pytest.mark.parametrize(
    "text",
    [
        "eye=6,-8,4 target=auto fov=30",
        "eye = (6, -8, 4); target = auto; fov = 30;",
        "{ eye = ( 6, -8, 4 ), target = auto, fov = 30 }",
        "eye = 6, -8, 4, target = auto, fov = 30",
        "eye=6,-8,4;target=auto;fov=30",
    ],
)
def test_settings_are_spelled_alike_in_grammars_and_commands(text):
    expected = {"eye": (6.0, -8.0, 4.0), "target": None, "fov": 30.0}
    assert parse_setting("camera", text) == expected
    if ";" in text or ", t" in text:
        block = text if text.startswith("{") else f"{{ {text} }}"
        (camera,) = pcsg.loads(f"sphere camera {block}").setting_values("camera")
        assert {key: camera[key] for key in expected} == expected


@pytest.mark.parametrize("name", ["a = b,c.hdr", "sky (1);2.hdr"])
def test_texts_in_quotes_are_taken_as_they_are(name):
    assert parse_setting("sky", f'file="{name}" kind=image') == {"file": name, "kind": "image"}
    assert parse_setting("sky", "file=a,b;(1).hdr") == {"file": "a,b;(1).hdr"}


@pytest.mark.parametrize(
    "text", ["eye=1,2", "eye=1,2,3,4", "eye=(1,2", "eye", "fov=", "= 3", "; x"]
)
def test_settings_that_are_none_are_refused(text):
    with pytest.raises(UsageError, match="--camera"):
        parse_setting("camera", text)
    with pytest.raises(UsageError, match="takes a number"):
        parse_assignments(["a=inf"])


@pytest.mark.parametrize(
    ("error", "status", "word"),
    [
        (UsageError("so not"), 2, "error: so not"),
        (EnvironmentFault("no disk"), 1, "error: no disk"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "memory"),
        (OSError(28, "No space left on device", "x.png"), 1, "x.png: No space left"),
        (RecursionError(), 2, "nested"),
        (RuntimeError("can't start new thread"), 1, "fewer --threads"),
        (ZeroDivisionError("division"), 1, "mistake in pcsg"),
    ],
)
def test_errors_become_messages_and_statuses(capsys, error, status, word):
    @guarding.guard
    def verb() -> None:
        raise error

    with pytest.raises(guarding.typer.Exit) as caught:
        verb()
    assert caught.value.exit_code == status
    assert word in capsys.readouterr().err


def test_a_picture(run, tmp_path):
    result = run("render", "ball.pcsg", "--size", "40x30", "--samples", "4", "--aov", "depth")
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    assert "ball.png: 40x30" in result.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "ball.depth.npy",
        "ball.pcsg",
        "ball.png",
    ]


def test_a_picture_in_json(run):
    result = run("render", "ball.pcsg", "--size", "40x30", "--seed", "7", "--json", "-o", "b.png")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["files"] == ["b.png"]
    assert told["size"] == [40, 30]
    assert told["seed"] == "7"
    assert told["rays"] > 1200


def test_the_same_command_makes_the_same_file(run, tmp_path):
    for name, threads in (("a.png", "1"), ("b.png", "3")):
        arguments = ["--size", "60x40", "--threads", threads, "-o", name, "-q"]
        assert run("render", "ball.pcsg", *arguments).output == ""

    def pixels(name):
        return (tmp_path / name).read_bytes().split(b"IDAT", 1)[1]

    assert pixels("a.png") == pixels("b.png")


@pytest.mark.parametrize("verb", ["render", "check", "stats"])
def test_missing_files_and_folders(run, tmp_path, verb):
    result = run(verb, "missing.pcsg")
    assert result.exit_code in (1, 2)
    assert "missing.pcsg" in result.output
    (tmp_path / "folder.pcsg").mkdir()
    result = run(verb, "folder.pcsg")
    assert result.exit_code in (1, 2)
    assert "folder.pcsg" in result.output


def test_check(run, tmp_path):
    assert run("check", "ball.pcsg").exit_code == 0
    (tmp_path / "bad.pcsg").write_text("cilinder | spere\n")
    result = run("check", "bad.pcsg")
    assert result.exit_code == 2
    assert "cylinder" in result.stdout
    assert "sphere" in result.stdout
    lines = run("check", "bad.pcsg", "--json").stdout.splitlines()
    assert len(lines) == 2
    assert all(json.loads(line)["severity"] == "error" for line in lines)


def test_check_finds_what_a_picture_would_refuse_all_at_once(run, tmp_path):
    (tmp_path / "bad.pcsg").write_text(
        "{n = -2} sphere\n"
        "camera { up = (0,0,0); fov = 200; eye = (1,1,1); target = (1,1,1) }\n"
        "sun { direction = (0,0,0) }\n"
        "light { radius = n }\n"
        'sky { kind = image; file = "none.hdr" }\n'
        "texture bark { kind = normals }\n"
        "ground { z = 1/0 }\n"
    )
    result = run("check", "bad.pcsg", "--json")
    assert result.exit_code == 2
    found = [json.loads(line) for line in result.stdout.splitlines()]
    assert [d["line"] for d in found] == [2, 2, 2, 3, 4, 5, 6, 7]
    assert [d["message"] for d in found[:6]] == [
        "`up` of `camera` is the zero vector",
        "`eye` and `target` are the same point",
        "the `fov` of a camera is 200, with `projection = perspective`",
        "`direction` of `sun` is the zero vector",
        "`radius` of `light` is -2",
        "there is no file `none.hdr`",
    ]
    # A value of the command line may be what is right.
    assert run("stats", "bad.pcsg").exit_code == 0


def test_stats(run):
    result = run("stats", "ball.pcsg", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["primitives"] == 1
    told = run("stats", "ball.pcsg").stdout
    for what in ("primitives", "clusters", "instances", "flattened leaves", "suspended"):
        assert what in told
    assert {"bytes", "blocks", "expansions"} <= set(json.loads(result.stdout))


def test_stats_tell_where_a_mesh_is_open_and_what_was_mended(run, tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "open.obj").write_text(corners + "f 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (tmp_path / "turned.obj").write_text(corners + "f 1 2 3\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (tmp_path / "two.pcsg").write_text('mesh("open.obj") | mesh("turned.obj")\n')
    result = run("stats", "two.pcsg")
    assert result.exit_code == 0
    assert "open.obj: 3 triangles, a sheet, 3 open edges, one from (0, 0, 0)" in result.stdout
    assert "turned.obj: 4 triangles, closed; turned round: facets (1 of 4)" in result.stdout
    assert 'warning[file-mended]: mesh("turned.obj"): turned round' in result.stderr


def test_stats_of_anything_are_json(run, tmp_path):
    (tmp_path / "half.pcsg").write_text("halfspace\n")
    result = run("stats", "half.pcsg", "--json")
    assert result.exit_code == 0, result.output
    assert "Infinity" not in result.stdout
    json.loads(result.stdout)
    (tmp_path / "deep.pcsg").write_text(
        "{n=9000} S\nS if(n > 0, 2, 1)\n1: S -> sphere\n2: S -> {n=n-1} (S | S | S | S)\n"
    )
    result = run("stats", "deep.pcsg")
    assert result.exit_code == 0, result.output
    assert max(map(len, result.stdout.splitlines())) > 5000


@pytest.mark.parametrize(
    ("ending", "start"), [("svg", b"<"), ("dot", b"digraph"), ("png", b"\x89PNG")]
)
def test_graph(run, tmp_path, ending, start):
    result = run("graph", "ball.pcsg", "-o", f"g.{ending}")
    assert result.exit_code == 0, result.output
    assert (tmp_path / f"g.{ending}").read_bytes().startswith(start)
    assert run("graph", "ball.pcsg", "-o", "g.gif").exit_code == 2


@pytest.mark.skipif(os.name == "nt", reason="signals differ there")
def test_an_interrupt_keeps_the_partial_picture(tmp_path):
    (tmp_path / "ball.pcsg").write_text(BALL)
    arguments = ["render", "ball.pcsg", "--size", "3000x2000", "--samples", "1024", "-v"]
    # Kernels are compiled beforehand, so that the interrupt meets the rendering.
    warm = [*PYTHON, "render", "ball.pcsg", "--size", "8x8", "-q", "-o", "warm.png"]
    subprocess.run(warm, cwd=tmp_path, check=True, timeout=300)
    # Shells let what runs in the background ignore interrupts, and with it all that this starts.
    process = subprocess.Popen(
        [*PYTHON, *arguments],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    assert process.stderr is not None
    while not process.stderr.readline().startswith("--camera"):
        assert process.poll() is None
    time.sleep(4)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "ball.png" in said
    assert (tmp_path / "ball.png").read_bytes().startswith(b"\x89PNG")


ENDLESS_RAY = """
import typer

import pcsg
from pcsg.commands.guard import guard
from pcsg.commands.interrupts import heard_interrupts

CROWD = '''{n = 40} S
S if(n > 0, 2, 1)
1: S -> sphere
2: S -> {n = n-1} (uscale(0.9999) S | uscale(0.9998) S)'''

@guard
def run():
    # Within all boxes, but beside all balls.
    rays = [[0.9, 0.9, 9]] * COUNT, [[0, 0, -1]] * COUNT
    scene = pcsg.loads(CROWD.replace("40", "4"), threads=THREADS)
    scene.intersect(*rays)
    scene = pcsg.loads(CROWD, threads=THREADS)
    scene.tracer
    print("tracing", flush=True)
    scene.intersect(*rays)

with heard_interrupts():
    try:
        run()
    except typer.Exit as end:
        raise SystemExit(end.exit_code)
"""


@pytest.mark.skipif(os.name == "nt", reason="signals differ there")
@pytest.mark.parametrize(("threads", "count"), [(1, 1), (2, 8_192)])
def test_an_interrupt_ends_a_ray_that_does_not_end(tmp_path, threads, count):
    text = ENDLESS_RAY.replace("THREADS", str(threads)).replace("COUNT", str(count))
    with subprocess.Popen(
        [sys.executable, "-c", text],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "tracing\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=30) == 130
        finally:
            process.kill()


def test_warmup_tells_what_it_has_compiled(run):
    took = json.loads(run("warmup", "--json").output)
    assert {"recursion that ends", "many states", "states on demand"} <= set(took)
    assert all(seconds >= 0.0 for seconds in took.values())
    assert "s\n" in run("warmup").output


def test_a_profile_tells_what_rays_visit(run):
    result = run("render", "ball.pcsg", "--size", "16x16", "--profile")
    assert result.exit_code == 0
    assert "rays; on average a ray visits" in result.output
    assert "of 1 blocks, 0 clusters, 0 instances, 1 flattened leaves, 0 suspended" in result.output
    walked = run("render", "ball.pcsg", "--size", "16x16", "--profile", "--engine", "cyclic")
    assert "keeps no profile" in walked.output


def test_a_package_that_is_missing_is_named_with_its_extra(capsys):
    @guarding.guard
    def verb():
        raise ModuleNotFoundError("No module named 'scipy'", name="scipy.sparse")

    with pytest.raises(typer.Exit) as ended:
        verb()
    assert ended.value.exit_code == 1
    told = "this needs SciPy; in the folder of pcsg's source: pip install '.[mesh]'"
    assert told in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="the shell is that of POSIX")
@pytest.mark.parametrize(
    "words",
    [
        "stats ball.pcsg >&-",
        "gallery >&-",
        "render ball.pcsg --size 6x4 --samples 1 2>&-",
        "animate ball.pcsg --size 6x4 --samples 1 --frames 0..1 --jobs 2 >&- 2>&- <&-",
    ],
)
def test_files_of_the_terminal_may_be_closed(tmp_path, words):
    (tmp_path / "ball.pcsg").write_text(BALL)
    root = os.pathsep.join([str(Path.cwd()), *sys.path])
    done = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m pcsg {words}"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr


def test_signs_that_a_terminal_lacks_are_spelled_out(tmp_path):
    (tmp_path / "ball.pcsg").write_text("sphere \u2603", encoding="utf-8")
    done = subprocess.run(
        [*PYTHON, "check", str(tmp_path / "ball.pcsg")],
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
        capture_output=True,
        timeout=300,
    )
    assert done.returncode == 2
    assert rb"stray character `\u2603`" in done.stdout, done.stderr
