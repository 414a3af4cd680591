"""``make compat``: the oldest and newest numba that is admitted, with every Python that is there.

Each pair in a fresh environment: what `pip` installs, a picture, about a hundred tests. NumPy and
llvmlite are what that numba takes.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]

PYTHONS = ("3.11", "3.12", "3.13")

TESTS = (
    "tests/test_machine.py",
    "tests/trace/test_hits.py",
    "tests/trace/test_questions.py",
    "tests/trace/test_suspended.py",
    "tests/trace/test_meshes.py",
    "tests/blobtree/test_blob_grammars.py",
)
"""Every way of answering rays, through every kind of kernel."""

NEEDED = ("pytest", "hypothesis", "trimesh", "scipy")
"""What these tests use besides."""


def numbas() -> tuple[str, str]:
    """Return the requirements of the oldest and of the newest numba that is admitted."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    (admitted,) = (text for text in project["dependencies"] if text.startswith("numba"))
    oldest = re.search(r">=([\d.]+)", admitted)
    assert oldest is not None, "numba has no lower bound"
    return f"numba=={oldest[1]}.0", admitted


def find_python(version: str) -> str | None:
    """Return a Python of a version that runs, None where there is none."""
    places = [shutil.which(f"python{version}") or ""]
    places += map(str, sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python")))
    question = "import sys; print('%d.%d' % sys.version_info[:2])"
    for place in filter(None, places):
        done = subprocess.run([place, "-c", question], capture_output=True, text=True)
        if done.stdout.strip() == version:
            return place
    return None


def try_pair(python: str, numba: str, folder: Path) -> list[str]:
    """Return what was installed, how long things took, and what failed."""
    begin = time.perf_counter()
    told: list[str] = []
    bin_folder = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    env = {**os.environ, "PCSG_CACHE": str(folder / "cache")}
    inner = str(bin_folder / "python")
    picture = folder / "sierpinski.png"
    versions = "from importlib.metadata import version as v; print(*map(v, {!r}))"
    steps: list[tuple[str, Sequence[str]]] = [
        ("environment", (python, "-m", "venv", str(folder / "env"))),
        ("install", (inner, "-m", "pip", "install", "-q", str(ROOT), numba, *NEEDED)),
        ("installed", (inner, "-c", versions.format(("numba", "llvmlite", "numpy")))),
        ("linked", (inner, "-c", "from pcsg.compilation import is_linkable as f; print(f())")),
        (
            "picture",
            (
                *(inner, "-m", "pcsg", "render", str(ROOT / "grammars" / "sierpinski.pcsg")),
                *("-q", "--size", "80x60", "-o", str(picture)),
            ),
        ),
        # By its own command: `-m pytest` would find the package of this folder.
        ("tests", (str(bin_folder / "pytest"), "-v", "-p", "no:cacheprovider", *TESTS)),
    ]
    for name, line in steps:
        where = ROOT if name == "tests" else folder
        done = subprocess.run(line, cwd=where, env=env, capture_output=True, text=True)
        if name == "install" and (missing := _missing(done.stderr)):
            return [*told, f"NOT TRIED: the package index has no {missing} for this Python"]
        if done.returncode != 0:
            return [*told, f"{name} FAILED", done.stdout[-4000:], done.stderr[-4000:]]
        last = done.stdout.strip().splitlines()[-1:]
        told.append(f"{name} {last[0]}" if last else name)
    return [*told, f"{time.perf_counter() - begin:.0f} s"]


def _missing(told: str) -> str:
    """Return what pip did not find for this Python, empty if it found everything."""
    found = re.search(r"No matching distribution found for (\S+)", told)
    if found is None and "Cannot install on Python version" in told:
        return "numba"  # so it says itself where only its source is there
    return found[1] if found else ""


def main() -> int:
    parser = argparse.ArgumentParser(prog="make compat", description=__doc__)
    parser.add_argument("--python", action="append", help=f"of {', '.join(PYTHONS)}; default all")
    asked = parser.parse_args()
    failed = False
    for version in asked.python or PYTHONS:
        python = find_python(version)
        if python is None:
            print(f"Python {version}: not on this machine, not tried", flush=True)
            continue
        for numba in numbas():
            with tempfile.TemporaryDirectory() as folder:
                told = try_pair(python, numba, Path(folder))
            failed |= any(text.endswith("FAILED") for text in told)
            print(f"Python {version}, {numba}: {'; '.join(told)}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
