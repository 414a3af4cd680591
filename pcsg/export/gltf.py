"""glTF 2.0 binary: one node for each shape, y up; instances by EXT_mesh_gpu_instancing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import UsageError
from pcsg.export.looks import Material
from pcsg.export.maps import is_sheared, quaternions, split
from pcsg.export.prototypes import Assembly
from pcsg.export.shapes import Floats, Shape
from pcsg.export.surroundings import Surroundings
from pcsg.meshfile.container import Buffers, write_container
from pcsg.outputs import write_whole

MOST_NODES = 200_000
"""Nodes of a file without instances: half a kilobyte of text each, and as many objects."""

LUMENS = 683.0
"""For each watt, by which importers turn a sun's lux into its strength."""

_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
"""The turn from z up to y up."""


def write_gltf(
    path: Path, assembly: Assembly, around: Surroundings, instances: bool = False
) -> None:
    """Write a scene as .glb.

    Parameters
    ----------
    instances
        Whether shapes that stand in many places are one node, which not every program reads.

    Raises
    ------
    UsageError
        It would have too many nodes.
    """
    if not instances and assembly.instances > MOST_NODES:
        raise UsageError(
            f"{assembly.instances:,} nodes are too many for a .glb (at most {MOST_NODES:,}); write"
            " them with --instances, or write .usdc"
        )
    document = _Document(assembly, around, instances)
    write_whole(path, lambda file: write_container(file, document.content, document.buffers))


class _Document:
    """Fills a document and its buffers."""

    def __init__(self, assembly: Assembly, around: Surroundings, instances: bool) -> None:
        self.assembly = assembly
        self.buffers = Buffers()
        self.used: set[str] = set()
        self.nodes: list[dict[str, Any]] = [{"name": "scene", "rotation": _UP, "children": []}]
        geometry = [self._geometry(shape) for shape in assembly.shapes]
        meshes = [
            self._mesh(geometry[shape], assembly.shapes[shape], material, label)
            for shape, material, label in assembly.parts
        ]
        for part, places in assembly.flattened().items():
            self._place(part, places, instances)
        self.content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "pcsg"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": self.nodes,
            "meshes": meshes,
            "materials": [self._material(m, k) for k, m in enumerate(assembly.materials)],
        }
        self._surround(around)
        if self.used:
            self.content["extensionsUsed"] = sorted(self.used)
        if "EXT_mesh_gpu_instancing" in self.used:
            self.content["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]

    def _add(self, node: dict[str, Any], above: int = 0) -> int:
        self.nodes.append(node)
        self.nodes[above].setdefault("children", []).append(len(self.nodes) - 1)
        return len(self.nodes) - 1

    def _geometry(self, shape: Shape) -> dict[str, Any]:
        # Row v = 0 of a picture is its highest one there.
        uv = np.column_stack([shape.uv[:, 0], 1.0 - shape.uv[:, 1]])
        add = self.buffers.add
        return {
            "attributes": {
                "POSITION": add(shape.vertices.astype("<f4"), "VEC3", bounds=True),
                "NORMAL": add(shape.normals.astype("<f4"), "VEC3"),
                "TEXCOORD_0": add(uv.astype("<f4"), "VEC2"),
            },
            "indices": add(shape.triangles.astype("<u4").reshape(-1), "SCALAR", indices=True),
        }

    def _mesh(
        self, geometry: dict[str, Any], shape: Shape, material: int, label: int
    ) -> dict[str, Any]:
        mesh: dict[str, Any] = {
            "name": shape.name,
            "primitives": [{**geometry, "material": material}],
        }
        if label >= 0:
            mesh["extras"] = {"pcsg:label": label}
        return mesh

    def _place(self, part: int, places: Floats, instances: bool) -> None:
        """Write the nodes of a part."""
        outer, scale, inner = split(places[:, :, :3])
        shift, turn = places[:, :, 3], quaternions(outer)
        name = self.assembly.shapes[self.assembly.parts[part][0]].name
        sheared = is_sheared(inner)
        straight = ~sheared
        if instances and np.count_nonzero(straight) > 1:
            self.used.add("EXT_mesh_gpu_instancing")
            add = self.buffers.add
            attributes = {
                "TRANSLATION": add(shift[straight].astype("<f4"), "VEC3"),
                "ROTATION": add(turn[straight].astype("<f4"), "VEC4"),
                "SCALE": add(scale[straight].astype("<f4"), "VEC3"),
            }
            extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
            self._add({"name": name, "mesh": part, "extensions": extension})
            rest = np.flatnonzero(sheared)
        else:
            rest = np.arange(len(places))
        twist = quaternions(inner[rest])
        for k, (at, by, size) in enumerate(
            zip(shift[rest].tolist(), turn[rest].tolist(), scale[rest].tolist(), strict=True)
        ):
            node: dict[str, Any] = {"translation": at, "rotation": by, "scale": size}
            if sheared[rest[k]]:
                # A node has a place, a rotation and scales: two of them make a shear.
                above = self._add({"name": name, **node})
                self._add({"mesh": part, "rotation": twist[k].tolist()}, above)
            else:
                self._add({"name": name, "mesh": part, **node})

    def _material(self, material: Material, number: int) -> dict[str, Any]:
        shapes = self.assembly.shapes
        sheet = any(shapes[s].sheet for s, m, _ in self.assembly.parts if m == number)
        extensions: dict[str, Any] = {}
        if material.transmission > 0.0:
            extensions["KHR_materials_transmission"] = {"transmissionFactor": material.transmission}
            extensions["KHR_materials_ior"] = {"ior": material.ior}
        if material.specular != 0.5:
            extensions["KHR_materials_specular"] = {"specularFactor": min(1.0, material.specular)}
        if material.translucency > 0.0:
            extensions["KHR_materials_diffuse_transmission"] = {
                "diffuseTransmissionFactor": material.translucency,
                "diffuseTransmissionColorFactor": _capped(material.color),
            }
        found: dict[str, Any] = {
            "name": material.name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*_capped(material.color), 1.0],
                "metallicFactor": material.metallic,
                "roughnessFactor": material.roughness,
            },
            "doubleSided": sheet,
        }
        light = max(material.emission)
        if light > 0.0:
            found["emissiveFactor"] = [x / max(light, 1.0) for x in material.emission]
            if light > 1.0:
                extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": light}
        if extensions:
            self.used.update(extensions)
            found["extensions"] = extensions
        return found

    def _surround(self, around: Surroundings) -> None:
        """Write camera and lights."""
        if around.camera is not None:
            lens = {
                "yfov": around.camera.angle,
                "znear": around.camera.near,
                "zfar": around.camera.far,
                "aspectRatio": 4.0 / 3.0,
            }
            self.content["cameras"] = [{"type": "perspective", "perspective": lens}]
            self._add({"name": "camera", "camera": 0, **_standing(around.camera.place)})
        lights: list[dict[str, Any]] = []
        if around.sun is not None:
            at, light, _ = around.sun
            lights.append({"name": "sun", "type": "directional", **_shining(light, LUMENS)})
            self._light(0, _standing(at))
        for position, light, _ in around.balls:
            lights.append({"name": "light", "type": "point", **_shining(light, LUMENS)})
            self._light(len(lights) - 1, {"translation": list(position)})
        if lights:
            self.used.add("KHR_lights_punctual")
            self.content["extensions"] = {"KHR_lights_punctual": {"lights": lights}}

    def _light(self, number: int, place: dict[str, Any]) -> None:
        self._add({"extensions": {"KHR_lights_punctual": {"light": number}}, **place})


def _standing(place: Floats) -> dict[str, Any]:
    turn = quaternions(place[None, :, :3])[0]
    return {"translation": place[:, 3].tolist(), "rotation": turn.tolist()}


def _shining(light: tuple[float, float, float], unit: float) -> dict[str, Any]:
    strength = max(light)
    return {"color": [x / strength for x in light], "intensity": strength * unit}


def _capped(color: tuple[float, float, float]) -> list[float]:
    return [min(1.0, x) for x in color]
