"""Makes the contact sheet of docs/lsystems.md: ``python docs/pictures/lsystems.py``."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
GRAMMARS = HERE.parents[1] / "grammars"
MODELS = ("algae", "koch", "ternary", "monopodial", "oak", "bush", "herb", "fern")
WIDTH, HEIGHT, COLUMNS = 270, 330, 4
# Its tip is too thin for the automatic camera of so narrow a picture.
CAMERAS = {"monopodial": ("--camera", "eye=9,-27,6 target=0.4,0,5.1 fov=25")}


def make_sheet() -> None:
    """Write the sheet."""
    sheet = Image.new("RGB", (COLUMNS * WIDTH, len(MODELS) // COLUMNS * HEIGHT))
    with tempfile.TemporaryDirectory() as folder:
        for k, name in enumerate(MODELS):
            model, picture = GRAMMARS / "lsystems" / f"{name}.lsys", Path(folder) / f"{name}.png"
            command = [sys.executable, "-m", "pcsg", "render", str(model), "-o", str(picture), "-q"]
            command += ["--size", f"{2 * WIDTH}x{2 * HEIGHT}", *CAMERAS.get(name, ())]
            subprocess.run(command, check=True)
            with Image.open(picture) as made:
                tile = made.convert("RGB").resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
            sheet.paste(tile, (k % COLUMNS * WIDTH, k // COLUMNS * HEIGHT))
    colours = sheet.quantize(256, dither=Image.Dither.FLOYDSTEINBERG)
    colours.save(HERE / "lsystems-sheet.png", optimize=True)


if __name__ == "__main__":
    make_sheet()
