"""Scenes for POV-Ray: every state declared once, nested as in the grammar; and its runs."""

from __future__ import annotations

import re
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.meshes import Triangles
from benchmarks.views import View
from pcsg.graph.operators import DIFFERENCE, INTERSECTION
from pcsg.graph.states import Combine, LeafItem, StateGraph
from pcsg.scene import Scene
from pcsg.vec import Affine

_LEAVES = {
    "sphere": "sphere { 0, 1 }",
    "box": "box { -1, 1 }",
    "cylinder": "cylinder { 0, z, 1 }",
    "tetrahedron": "intersection {"
    " plane { <1,1,-1>, 1/sqrt(3) } plane { <-1,-1,-1>, 1/sqrt(3) }"
    " plane { <-1,1,1>, 1/sqrt(3) } plane { <1,-1,1>, 1/sqrt(3) } bounded_by { box { -1, 1 } } }",
    "halfspace": "plane { z, 0 }",
    "tri1": "triangle { 0, x, y }",
    "tri2": "triangle { 0, -x, -y }",
    "disc": "disc { 0, z, 1 }",
    "infcylinder": "quadric { <1, 1, 0>, 0, 0, -1 }",
    "rectangle": "polygon { 4, <-1,-1,0>, <1,-1,0>, <1,1,0>, <-1,1,0> }",
}


def is_there() -> bool:
    """Return whether POV-Ray is installed."""
    return shutil.which("povray") is not None


def write_states(states: StateGraph) -> str:
    """Return declarations of all states; the axiom is ``S0``."""
    lines = []
    for k in states.children_first:
        stack: list[str] = []
        for item in states.states[k].content or ():
            if isinstance(item, LeafItem):
                stack.append(f"object {{ {_leaf(states, item)} {_matrix(item.state_from_leaf)} }}")
            elif isinstance(item, Combine):
                at = len(stack) - item.arity
                operands = stack[at:]
                del stack[at:]
                stack.append(f"{_operator(item)} {{ {' '.join(operands)} }}")
            else:
                stack.append(f"object {{ S{item.state} {_matrix(item.state_from_child)} }}")
        lines.append(f"#declare S{k} = {stack[-1] if stack else 'union { }'}")
    return "\n".join(lines)


def _leaf(states: StateGraph, item: LeafItem) -> str:
    name = states.graph.nodes[item.node].solid.name  # type: ignore[attr-defined]
    if name == "cone":
        return f"cone {{ 0, 1, z, {item.args[0]!r} }}"
    return _LEAVES[name]


def _operator(item: Combine) -> str:
    if item.operator is DIFFERENCE:
        return "difference"
    return "intersection" if item.operator is INTERSECTION else "union"


def _matrix(m: Affine) -> str:
    columns = (m[i + 4 * j] for i in range(4) for j in range(3))
    return f"matrix <{','.join(f'{x:.17g}' for x in columns)}>"


def write_mesh(triangles: Triangles) -> str:
    """Return the declaration of triangles as the axiom's state."""
    corners = ", ".join(f"<{x!r},{y!r},{z!r}>" for x, y, z in triangles.corners.tolist())
    faces = ", ".join(f"<{a},{b},{c}>" for a, b, c in triangles.faces.tolist())
    vertices = f"vertex_vectors {{ {len(triangles.corners)}, {corners} }}"
    indices = f"face_indices {{ {len(triangles.faces)}, {faces} }}"
    return f"#declare S0 = mesh2 {{ {vertices} {indices} }}"


def write_scene(scene: Scene, view: View, triangles: Triangles | None = None) -> str:
    """Return a scene file with one light that casts shadows; of triangles, if there are any."""
    declared = write_states(scene.states) if triangles is None else write_mesh(triangles)
    eye, target = (",".join(f"{x:.9g}" for x in p) for p in (view.eye, view.target))
    return f"""#version 3.7;
global_settings {{ assumed_gamma 1 max_trace_level 5 }}
camera {{ location <{eye}> up y right -x sky z angle {view.fov} look_at <{target}> }}
light_source {{ <4e3,-6e3,7e3> color rgb 2 parallel point_at 0 }}
{declared}
object {{ S0 pigment {{ color rgb 0.7 }} }}
"""


def write_view(view: View, aspect: float, objects: Iterable[str]) -> str:
    """Return a scene file of objects with one light that casts shadows."""
    eye, target = (",".join(f"{x:.9g}" for x in p) for p in (view.eye, view.target))
    return "\n".join(
        [
            "#version 3.7;",
            "global_settings { assumed_gamma 1 max_trace_level 5 }",
            f"camera {{ location <{eye}> up y right {-aspect:.9g}*x sky z angle {view.fov}"
            f" look_at <{target}> }}",
            "light_source { <4e3,-6e3,7e3> color rgb 2 parallel point_at 0 }",
            *objects,
        ]
    )


def run(
    text: str, size: int, threads: int = 1, height: int | None = None, smooth: bool = False
) -> dict[str, float]:
    """Return processor seconds and rays of a picture, square unless there is a height.

    Parameters
    ----------
    smooth
        Whether edges are antialiased.
    """
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "scene.pov"
        source.write_text(text, encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = ["povray", f"+I{source}", f"+O{folder}/out.png", f"+W{size}"]
        command += [f"+H{height or size}", "-D", "+A" if smooth else "-A", f"+WT{threads}", "+V"]
        told = subprocess.run(command, capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    rays = re.search(r"Rays:\s+(\d+)", told.stderr)
    shadows = re.search(r"Shadow Ray Tests:\s+(\d+)", told.stderr)
    return {
        "seconds": seconds,
        "rays": float(rays[1] if rays else 0) + float(shadows[1] if shadows else 0),
    }
