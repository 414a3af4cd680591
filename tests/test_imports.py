"""Imports point one way through the house, and ``import pcsg`` is instant."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "pcsg"

# What each room may use besides itself: everything of the lower floors, nothing of its own floor.
FLOORS: list[set[str]] = [
    {
        "addresses",
        "arguments",
        "errors",
        "catalogue",
        "machine",
        "compilation",
        "objectcode",
        "codecache",
        "collector",
        "fingerprint",
        "geometry",
        "jit",
        "vec",
        "indices",
        "inputs",
        "memory",
        "simd",
        "slabs",
        "meshfile",
        "outputs",
        "skeletonfile",
        "tablefile",
        "marching",
    },
    {"blobtree"},
    {"leaf"},
    {"graph"},
    {"growth", "treemesh"},
    {"grammar", "trace"},
    {"render", "contouring"},
    {"scene"},
    {"light"},
    {"lidar"},
    {"export"},
    {"cli", "commands", "editors", "view", "__main__"},
]
# The lowest floor and the highest are one thing each.
NEIGHBOURS = [FLOORS[0], FLOORS[-1]]
# A grammar that names a growing tree needs the leaf that growth registers; its axes are a skeleton.
ALSO = {("grammar", "growth"), ("growth", "treemesh")}
# Nobody but these may reach growth and treemesh, which are loaded when asked for.
ASKED_FOR = {"growth", "treemesh"}

FLOOR_OF = {room: k for k, floor in enumerate(FLOORS) for room in floor}


def room_of(path: Path) -> str:
    """Return the package or the module directly below pcsg."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(path: Path) -> Iterator[tuple[str, int]]:
    """Yield every module that a file imports anywhere, and the line."""
    package = ("pcsg", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                yield f"{module}.{alias.name}", node.lineno


def may_import(user: str, used: str) -> bool:
    if user == used or (user, used) in ALSO:
        return True
    if any({user, used} <= floor for floor in NEIGHBOURS):
        return True
    if used in ASKED_FOR and user not in {
        "scene",
        "export",
        "cli",
        "commands",
        "editors",
        "view",
        "__main__",
    }:
        return False
    return FLOOR_OF[used] < FLOOR_OF[user]


FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def test_every_room_has_its_floor() -> None:
    assert FILES
    assert {room_of(p) for p in FILES} <= set(FLOOR_OF)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_imports_point_one_way(path: Path) -> None:
    wrong = []
    for name, line in imports_of(path):
        parts = name.split(".")
        if parts[0] != "pcsg" or len(parts) < 2 or parts[1] not in FLOOR_OF:
            continue
        if not may_import(room_of(path), parts[1]):
            wrong.append(f"line {line}: {room_of(path)} imports {name}")
    assert not wrong


def test_the_rule_can_fail() -> None:
    assert not may_import("leaf", "graph")
    assert not may_import("trace", "grammar")
    assert not may_import("graph", "growth")
    assert may_import("graph", "leaf")


@pytest.mark.parametrize(
    "statement",
    ["import pcsg", "import pcsg; pcsg.__version__", "from pcsg import errors, outputs"],
)
def test_import_pcsg_loads_nothing_heavy(statement: str) -> None:
    code = f"{statement}; import sys; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "pcsg" in loaded
    assert not loaded & {"numba", "numpy", "lark", "llvmlite", "PIL", "typer", "rich"}
