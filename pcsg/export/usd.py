"""USD: prototypes once each, instances of them by references; z up, metres.

```
/World            the scene: instances, ground, camera, sun, sky, and Looks, its materials
/Prototypes       class: a prototype for each state, a part for each shape with its material
/Shapes           class: the meshes
```
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import EnvironmentFault, missing_extra
from pcsg.export.looks import Material
from pcsg.export.maps import is_sheared, split
from pcsg.export.prototypes import Assembly, Prototype
from pcsg.export.shapes import Floats, Shape
from pcsg.export.surroundings import Camera, Surroundings
from pcsg.outputs import write_by_name

_TALL = 24.0
"""Height of a camera's film in tenths of the unit, as USD has it."""


def load_usd() -> Any:
    """Return the library pxr's modules.

    Raises
    ------
    EnvironmentFault
        It is not installed.
    """
    try:
        from pxr import Gf, Sdf, Vt
    except ImportError:
        raise EnvironmentFault(
            missing_extra("writing USD files needs", "the library usd-core", "usd")
        ) from None
    return Gf, Sdf, Vt


def write_usd(path: Path, assembly: Assembly, around: Surroundings, up: str = "z") -> None:
    """Write a scene as USD, text or binary as the ending says."""
    _Writer(assembly, around, up).write(path)


class _Writer:
    """Fills a layer."""

    def __init__(self, assembly: Assembly, around: Surroundings, up: str) -> None:
        self.gf, self.sdf, self.vt = load_usd()
        self.assembly = assembly
        self.around = around
        self.up = up
        self.layer = self.sdf.Layer.CreateAnonymous(".usda")

    def write(self, path: Path) -> None:
        """Write the file."""
        sdf, layer = self.sdf, self.layer
        with sdf.ChangeBlock():
            layer.defaultPrim = "World"
            pseudo = layer.pseudoRoot
            pseudo.SetInfo("upAxis", self.up.upper())
            pseudo.SetInfo("metersPerUnit", 1.0)
            world = self._prim(layer, "World", "Xform")
            if self.up == "y":
                self._place(world, _TURNED)
            looks = self._prim(world, "Looks", "Scope")
            for material in self.assembly.materials:
                self._material(looks, material)
            shapes = self._prim(layer, "Shapes", "", sdf.SpecifierClass)
            for k, shape in enumerate(self.assembly.shapes):
                self._mesh(self._prim(shapes, f"{shape.name}_{k}", "Mesh"), shape)
            below = self._prim(layer, "Prototypes", "", sdf.SpecifierClass)
            self.parts = [self._part(below, *part) for part in self.assembly.parts]
            self.prototypes: list[Any] = []
            for prototype in self.assembly.prototypes[:-1]:
                prim = self._prim(below, prototype.name, "Xform")
                self._fill(prim, prototype)
                self.prototypes.append(prim.path)
            self._fill(self._prim(world, "scene", "Xform"), self.assembly.prototypes[-1])
            self._surround(world)
        write_by_name(path, self._export)

    def _export(self, place: Path) -> None:
        if not self.layer.Export(str(place)):
            raise EnvironmentFault(f"cannot write {place.name}: the library usd-core refuses")

    def _fill(self, prim: Any, prototype: Prototype) -> None:
        """Write what stands in a prototype."""
        parts = [self.parts[k] for k in prototype.parts]
        targets = [*parts, *(self.prototypes[k] for k in prototype.references)]
        if not targets:
            return
        places = np.array([*prototype.part_maps, *prototype.reference_maps])
        outer, scale, inner = split(places[:, :, :3])
        sheared = is_sheared(inner)
        for k, target in enumerate(targets):
            name = f"i{k}" if k >= len(parts) else f"p{k}"
            if not sheared[k]:
                made = self._prim(prim, name, "Xform")
                self._place(made, places[k])
            else:
                # Importers keep a place, a rotation and scales of each: two of them make a shear.
                around = self._prim(prim, name, "Xform")
                straight = np.column_stack([outer[k] * scale[k], places[k, :, 3]])
                self._place(around, straight)
                made = self._prim(around, "turned", "Xform")
                self._place(made, np.column_stack([inner[k], np.zeros(3)]))
            made.referenceList.prependedItems.append(self.sdf.Reference("", target))
            made.instanceable = True

    def _part(self, below: Any, shape: int, material: int, label: int) -> Any:
        """Write a shape with its material and label; return its path."""
        sdf = self.sdf
        about = self.assembly.shapes[shape]
        look = self.assembly.materials[material]
        prim = self._prim(below, f"{about.name}_{look.name}_{len(below.nameChildren)}", "Xform")
        mesh = self._prim(prim, "mesh", "Mesh")
        mesh.referenceList.prependedItems.append(sdf.Reference("", f"/Shapes/{about.name}_{shape}"))
        self._bind(mesh, look)
        self._set(mesh, "primvars:displayColor", "color3f[]", self._array("Vec3f", [look.color]))
        if label >= 0:
            self._set(mesh, "primvars:pcsg:label", "int", label)
            mesh.attributes["primvars:pcsg:label"].SetInfo("interpolation", "constant")
        return prim.path

    def _bind(self, prim: Any, material: Material) -> None:
        prim.SetInfo("apiSchemas", self.sdf.TokenListOp.Create(["MaterialBindingAPI"]))
        bound = self.sdf.RelationshipSpec(prim, "material:binding", False)
        bound.targetPathList.explicitItems.append(f"/World/Looks/{material.name}")

    def _mesh(self, prim: Any, shape: Shape) -> None:
        """Write the mesh of a shape."""
        low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        self._set(prim, "extent", "float3[]", self._array("Vec3f", [low, high]))
        self._set(prim, "points", "point3f[]", self._array("Vec3f", shape.vertices))
        counts = np.full(len(shape.triangles), 3, np.int32)
        self._set(prim, "faceVertexCounts", "int[]", self.vt.IntArray.FromNumpy(counts))
        corners = shape.triangles.ravel().astype(np.int32)
        self._set(prim, "faceVertexIndices", "int[]", self.vt.IntArray.FromNumpy(corners))
        self._set(prim, "normals", "normal3f[]", self._array("Vec3f", shape.normals))
        prim.attributes["normals"].SetInfo("interpolation", "vertex")
        self._set(prim, "primvars:st", "texCoord2f[]", self._array("Vec2f", shape.uv))
        prim.attributes["primvars:st"].SetInfo("interpolation", "vertex")
        self._set(prim, "subdivisionScheme", "token", "none", uniform=True)
        self._set(prim, "doubleSided", "bool", shape.sheet, uniform=True)

    def _material(self, below: Any, material: Material) -> None:
        """Write a material as UsdPreviewSurface."""
        sdf = self.sdf
        prim = self._prim(below, material.name, "Material")
        shader = self._prim(prim, "surface", "Shader")
        self._set(shader, "info:id", "token", "UsdPreviewSurface", uniform=True)
        clear = max(material.transmission, 0.0)
        for key, value in (
            ("roughness", material.roughness),
            ("metallic", material.metallic),
            ("ior", material.ior),
            ("opacity", 1.0 - clear),
        ):
            self._set(shader, f"inputs:{key}", "float", value)
        color = self.gf.Vec3f(*material.color)
        self._set(shader, "inputs:diffuseColor", "color3f", color)
        if max(material.emission) > 0.0:
            light = self.gf.Vec3f(*material.emission)
            self._set(shader, "inputs:emissiveColor", "color3f", light)
        # The rest of our materials, for whoever reads it.
        self._set(shader, "inputs:pcsg:specular", "float", material.specular)
        self._set(shader, "inputs:pcsg:translucency", "float", material.translucency)
        sdf.AttributeSpec(shader, "outputs:surface", sdf.ValueTypeNames.Token)
        out = sdf.AttributeSpec(prim, "outputs:surface", sdf.ValueTypeNames.Token)
        out.connectionPathList.explicitItems.append(f"{shader.path}.outputs:surface")

    def _surround(self, world: Any) -> None:
        """Write camera and lights."""
        around, gf = self.around, self.gf
        if around.camera is not None:
            self._camera(self._prim(world, "camera", "Camera"), around.camera)
        if around.sun is not None:
            at, light, angle = around.sun
            prim = self._prim(world, "sun", "DistantLight")
            self._place(prim, at)
            self._shine(prim, light)
            self._set(prim, "inputs:angle", "float", angle)
            # With it the strength is the light on a surface that faces the sun.
            self._set(prim, "inputs:normalize", "bool", True)
        for k, (position, light, radius) in enumerate(around.balls):
            prim = self._prim(world, f"light_{k}", "SphereLight")
            self._place(prim, np.column_stack([np.eye(3), position]))
            self._shine(prim, (light[0] * math.pi, light[1] * math.pi, light[2] * math.pi))
            self._set(prim, "inputs:radius", "float", radius)
            self._set(prim, "inputs:normalize", "bool", True)
        if around.sky is not None:
            prim = self._prim(world, "sky", "DomeLight")
            self._set(prim, "inputs:color", "color3f", gf.Vec3f(*around.sky))
            self._set(prim, "inputs:intensity", "float", 1.0)

    def _shine(self, prim: Any, light: Sequence[float]) -> None:
        strength = max(light)
        color = self.gf.Vec3f(*(x / strength for x in light))
        self._set(prim, "inputs:color", "color3f", color)
        self._set(prim, "inputs:intensity", "float", strength)

    def _camera(self, prim: Any, camera: Camera) -> None:
        self._place(prim, camera.place)
        self._set(prim, "verticalAperture", "float", _TALL)
        self._set(prim, "horizontalAperture", "float", _TALL * 4.0 / 3.0)
        self._set(prim, "focalLength", "float", 0.5 * _TALL / math.tan(0.5 * camera.angle))
        near_far = self.gf.Vec2f(camera.near, camera.far)
        self._set(prim, "clippingRange", "float2", near_far)

    def _place(self, prim: Any, place: Floats) -> None:
        """Write where a prim stands; points are rows there."""
        rows = np.vstack([place, [0.0, 0.0, 0.0, 1.0]]).T
        matrix = self.gf.Matrix4d(*rows.ravel().tolist())
        self._set(prim, "xformOp:transform", "matrix4d", matrix)
        order = self.vt.TokenArray(["xformOp:transform"])
        self._set(prim, "xformOpOrder", "token[]", order, uniform=True)

    def _prim(self, above: Any, name: str, kind: str, specifier: Any = None) -> Any:
        specifier = self.sdf.SpecifierDef if specifier is None else specifier
        return self.sdf.PrimSpec(above, name, specifier, kind)

    def _set(self, prim: Any, name: str, kind: str, value: Any, uniform: bool = False) -> None:
        sdf = self.sdf
        varying = sdf.VariabilityUniform if uniform else sdf.VariabilityVarying
        kinds = sdf.ValueTypeNames
        sdf.AttributeSpec(prim, name, kinds.Find(kind), varying).default = value

    def _array(self, kind: str, rows: Any) -> Any:
        array = np.ascontiguousarray(rows, np.float32)
        return getattr(self.vt, f"{kind}Array").FromNumpy(array)


_TURNED = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0]])
"""z up to y up."""
