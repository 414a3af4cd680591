"""Reflectance and transmittance of leaves, wood and soil, by band."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError

if TYPE_CHECKING:
    from pcsg.scene import Scene
    from pcsg.trace.hits import Hits

Floats = NDArray[np.float64]

SOIL = "soil"
"""Key of the soil among a band's surfaces."""

Bands = Mapping[str, Mapping[Any, Any]] | Sequence[str]


@dataclass(frozen=True)
class Optics:
    """What every surface does with light of every band.

    Attributes
    ----------
    names : tuple of str
        Of the bands, B of them.
    by_label, by_material : dict of int to float64 (B, 2)
        Reflectance and transmittance.
    soil : float64 (B,)
        Reflectance of the soil.
    """

    names: tuple[str, ...]
    by_label: Mapping[int, Floats]
    by_material: Mapping[int, Floats]
    soil: Floats

    def of_hits(self, hits: Hits, sheet: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Return reflectance and transmittance at hits, float64 (N, B) each.

        Labels come before materials; what is not declared is black. Of solids nothing passes.

        Parameters
        ----------
        sheet : bool (N,)
            Which hits are of sheets.
        """
        n = len(hits)
        found = np.zeros((n, len(self.names), 2))
        for column, known in ((hits.material, self.by_material), (hits.label, self.by_label)):
            for key, values in known.items():
                found[column == key] = values
        return found[:, :, 0], np.where(sheet[:, None], found[:, :, 1], 0.0)

    def warn_of_black(self, labels: Sequence[int], scene: Scene) -> None:
        """Warn of labels that no band says anything of."""
        if self.by_material:
            return
        missing = [label for label in labels if label not in self.by_label]
        if missing:
            shown = ", ".join("none" if label < 0 else str(label) for label in missing[:8])
            warnings.warn(f"surfaces of label {shown} are black: no band has them", stacklevel=4)


def read_optics(scene: Scene, bands: Bands | str) -> Optics:
    """Return what surfaces do with light.

    Parameters
    ----------
    bands
        Names of the grammar's ``band`` settings; or a dict of bands: for each a dict from labels
        (int), names of materials (str) or ``"soil"`` to the reflectance, or to reflectance and
        transmittance.

    Raises
    ------
    UsageError
        A band is unknown, or reflects and transmits more than it gets.
    """
    if isinstance(bands, str):
        bands = [bands]
    declared = _declared(scene)
    if not isinstance(bands, Mapping):
        unknown = [name for name in bands if name not in declared]
        if unknown:
            known = ", ".join(declared) or "none"
            raise UsageError(f"the grammar has no band `{unknown[0]}`; it has {known}")
        bands = {name: declared[name] for name in bands}
    if not bands:
        raise UsageError("there is no band")
    names = tuple(bands)
    materials = scene.setting_numbers("material")
    by_label: dict[int, Floats] = {}
    by_material: dict[int, Floats] = {}
    soil = np.zeros(len(names))
    for k, name in enumerate(names):
        for key, value in bands[name].items():
            pair = _pair(value, f"{name}, {key}")
            if key == SOIL:
                soil[k] = pair[0]
            elif isinstance(key, str):
                if key not in materials:
                    raise UsageError(f"band `{name}`: there is no material `{key}`")
                by_material.setdefault(materials[key], np.zeros((len(names), 2)))[k] = pair
            else:
                by_label.setdefault(int(key), np.zeros((len(names), 2)))[k] = pair
    return Optics(names, by_label, by_material, soil)


def _pair(value: Any, where: str) -> tuple[float, float]:
    """Return reflectance and transmittance."""
    try:
        numbers = np.atleast_1d(np.asarray(value, float))
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape not in ((1,), (2,)) or not (numbers >= 0.0).all():
        raise UsageError(f"band {where}: a reflectance, or a reflectance and a transmittance")
    pair = float(numbers[0]), float(numbers[1]) if len(numbers) == 2 else 0.0
    if sum(pair) > 1.0 + 1e-12:
        raise UsageError(f"band {where}: reflectance and transmittance add up to {sum(pair):g}")
    return pair


def _declared(scene: Scene) -> dict[str, dict[Any, Any]]:
    """Return the bands that a grammar declares."""
    grounds = scene.setting_values("ground")
    of_soil = grounds[0]["material"] if grounds else None
    found: dict[str, dict[Any, Any]] = {}
    names = [setting.name for setting in scene.graph.settings_of("band")]
    for name, values in zip(names, scene.setting_values("band"), strict=True):
        assert name is not None
        band = found.setdefault(name, {})
        pair = values["reflectance"], values["transmittance"]
        material, label = values["material"], values["label"]
        if (material is None) == (label is None):
            raise UsageError(f"band `{name}`: it names a material or a label")
        band[int(label) if material is None else material] = pair
        if material is not None and material == of_soil:
            band[SOIL] = pair[0]
    return found
