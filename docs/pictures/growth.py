"""Makes the pictures of docs/growth.md: ``python docs/pictures/growth.py [NAME...]``."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from pcsg.growth.model import GrowthModel
from pcsg.growth.pictures import frame_junction

HERE = Path(__file__).parent
GRAMMARS = HERE.parents[1] / "grammars"
SEASONS = (0.2, 0.4, 0.5, 0.6, 0.74, 0.78, 0.83, 0.95)
AGES = (1, 4, 7, 10)


def pcsg(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "pcsg", *arguments], check=True)


def curves() -> None:
    pcsg("grow", "plot", "populus", "--t", "15", "-o", str(HERE / "growth-curves.png"))


def ages() -> None:
    out = str(HERE / "ages.png")
    pcsg("render", str(GRAMMARS / "ages.pcsg"), "-o", out, "--size", "640x480")


def seasons() -> None:
    """The top of the crown at eight times of the year 12, two rows of four."""
    camera = "eye=2.2,-3.8,10.9 target=0,0,11.3 fov=30"
    shots = [(11.0 + tau, camera) for tau in SEASONS]
    stills("growth-seasons.png", shots, (240, 280), across=4, samples=16)


def junction() -> None:
    """One lateral of the trunk after 1, 4, 7 and 10 years."""
    camera, birth = frame_junction(GrowthModel.load("populus"), born=3)
    # In winter, when no leaf hides it.
    times = [round(birth + age) + 0.02 for age in AGES]
    stills("growth-junction.png", [(t, camera.keys) for t in times], (300, 300), 4, 16)


def stills(
    name: str, shots: list[tuple[float, str]], size: tuple[int, int], across: int, samples: int
) -> None:
    sheet = Image.new("RGB", (across * size[0], -(-len(shots) // across) * size[1]))
    with tempfile.TemporaryDirectory() as folder:
        for k, (t, camera) in enumerate(shots):
            place = Path(folder) / f"{k}.png"
            pcsg("grow", "frame", "populus", "--t", f"{t:g}", "-o", str(place), "--camera", camera,
                 "--size", f"{size[0]}x{size[1]}", "--samples", str(samples), "-q")  # fmt: skip
            with Image.open(place) as still:
                sheet.paste(still, (k % across * size[0], k // across * size[1]))
    # 256 colours keep the file small, and are enough for stills of this size.
    sheet.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(HERE / name, optimize=True)


PICTURES = {f.__name__: f for f in (curves, ages, seasons, junction)}

if __name__ == "__main__":
    for wanted in sys.argv[1:] or PICTURES:
        PICTURES[wanted]()
