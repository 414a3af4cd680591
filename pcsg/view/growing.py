"""What a page shows of a growing tree besides its picture: a timeline, and its curves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import PcsgError
from pcsg.growth.curves import Curve
from pcsg.growth.leaf import is_species
from pcsg.growth.pictures import AZIMUTH, FOV
from pcsg.growth.plot import MEANINGS
from pcsg.growth.species import LARGEST_FILE, Species, curve_range, read_species
from pcsg.inputs import read_text

STEPS = 96
"""Parts that a curve is drawn with."""

MONTH = 1.0 / 12.0


def describe_growth(path: Path) -> dict[str, Any]:
    """Return the controls and the curves of a species' file; nothing for other files."""
    if path.suffix.lower() != ".json":
        return {}
    try:
        text = read_text(path, "species", LARGEST_FILE)
        if not is_species(text):
            return {}
        species = read_species(text, path.name)
    except PcsgError:
        return {}  # whoever makes the scene tells it
    controls = {
        "t": {
            "low": MONTH,
            "high": species.ymax,
            "step": MONTH,
            "label": "age in years",
            "play": 1.5,
        },
        "seed": {"low": 0, "high": 100, "step": 1, "label": "seed, 0 for the species' own"},
        "day": {
            "low": 0,
            "high": 365,
            "step": 1,
            "label": "day of the year, 0 for that of the age",
        },
    }
    curves = {name: _describe(name, curve) for name, curve in species.curves.items()}
    return {"controls": controls, "curves": curves, "grown": _camera(species)}


def _camera(species: Species) -> dict[str, Any]:
    """Return a camera that sees the tree at all ages, so that its growth is seen."""
    tall = species.trunk_scale * max(y for _, y in species.curves["G_h"].points)
    middle = 0.5 * tall
    distance = 1.25 * middle / math.tan(math.radians(0.5 * FOV))
    angle = math.radians(AZIMUTH)
    eye = (distance * math.cos(angle), distance * math.sin(angle), 0.3 * middle)
    return {"eye": eye, "target": (0.0, 0.0, middle), "up": (0.0, 0.0, 1.0), "fov": FOV}


def _describe(name: str, curve: Curve) -> dict[str, Any]:
    x = np.linspace(0.0, 1.0, STEPS + 1)
    low, high = curve_range(name)
    return {
        "type": curve.kind,
        "title": MEANINGS.get(name, "growth within the year"),
        "points": [list(point) for point in curve.points],
        "line": np.stack([x, curve(x)], axis=1).round(6).tolist(),
        "low": low,
        "high": high,
    }
