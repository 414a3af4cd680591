"""Makes the contact sheet of docs/blobtree.md: ``python docs/pictures/blobtree.py``.

Above the pictures of the gallery: junctions, wounds, the bulge. Below two close views of the
poplar, smooth and in contact.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
POPLAR = HERE.parents[1] / "grammars" / "poplar.lsys"
FIGURES = ("junctions", "wounds", "bulge")
CAMERA = "eye=1.5,-2.6,2.0 target=0.05,0,1.75 fov=32"
SUN = "direction=0.6,-0.5,0.7 strength=3"


def poplar(mode: str, size: tuple[int, int]) -> Image.Image:
    """Return a close view of the poplar with junctions of a mode."""
    text = POPLAR.read_text(encoding="utf-8").replace("junctions: contact", f"junctions: {mode}")
    with tempfile.TemporaryDirectory() as folder:
        file, picture = Path(folder) / "poplar.lsys", Path(folder) / "poplar.png"
        file.write_text(text, encoding="utf-8")
        options = ("--size", f"{size[0]}x{size[1]}", "--camera", CAMERA, "--sun", SUN, "-q")
        command = [sys.executable, "-m", "pcsg", "render", str(file), "-o", str(picture), *options]
        subprocess.run(command, check=True)
        with Image.open(picture) as made:
            return made.convert("RGB")


def make_sheet() -> None:
    """Write the sheet."""
    sheet = Image.new("RGB", (960, 600))
    for k, name in enumerate(FIGURES):
        with Image.open(HERE / f"{name}.png") as figure:
            small = figure.convert("RGB").resize((320, 240), Image.Resampling.LANCZOS)
            sheet.paste(small, (320 * k, 0))
    for k, mode in enumerate(("smooth", "contact")):
        sheet.paste(poplar(mode, (480, 360)), (480 * k, 240))
    sheet.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(
        HERE / "blobtree-sheet.png", optimize=True
    )


if __name__ == "__main__":
    make_sheet()
