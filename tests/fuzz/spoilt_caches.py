"""``python tests/fuzz/spoilt_caches.py -n 30``: commands whose machine code was spoilt on disk.

Each is a process of its own, which would die of code that is not what was compiled.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

GRAMMAR = "{} (sphere | move(1,0,0) box)\n"


def render(folder: Path, cache: Path) -> tuple[int, str, bytes]:
    """Return a command's exit status, what it said, and the pixels of its picture."""
    (folder / "scene.pcsg").write_text(GRAMMAR, encoding="utf-8")
    picture = folder / "scene.png"
    picture.unlink(missing_ok=True)
    line = [sys.executable, "-m", "pcsg", "render", str(folder / "scene.pcsg"), "-q"]
    line += ["-o", str(picture), "--size", "16x12"]
    env = {**os.environ, "PCSG_CACHE": str(cache)}
    done = subprocess.run(line, env=env, capture_output=True, text=True, timeout=3600)
    pixels = np.asarray(Image.open(picture)).tobytes() if picture.exists() else b""
    return done.returncode, done.stderr, pixels


def try_flips(folder: Path, count: int, seed: int) -> list[str]:
    """Flip a bit of a cache, run a command, and again; return what went wrong."""
    chance = random.Random(seed)
    good = folder / "good"
    right = render(folder, good)
    files = sorted((good / "kernels").glob("*.code"), key=lambda p: p.stat().st_size)
    wrong = [] if right[0] == 0 and right[2] and files else [f"before: {right[:2]}"]
    for k in range(count):
        spoilt = folder / f"spoilt{k}"
        shutil.copytree(good, spoilt)
        path = spoilt / "kernels" / files[k % len(files)].name
        data = bytearray(path.read_bytes())
        at = chance.randrange(chance.choice([400, len(data)]))
        data[at] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
        told = render(folder, spoilt)
        if told != right:
            wrong.append(f"byte {at} of {path.name}: {told[:2]}")
        elif path.read_bytes() == data:
            wrong.append(f"byte {at} of {path.name}: not replaced")
        shutil.rmtree(spoilt)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=30, help="commands")
    parser.add_argument("--seed", type=int, default=1, help="of the chance that flips")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wrong = try_flips(Path(folder), asked.n, asked.seed)
    print(*wrong, f"{asked.n} commands, {len(wrong)} wrong", sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
