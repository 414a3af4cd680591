"""GLB files, spoilt: their documents by meaning, their bytes by chance."""

from __future__ import annotations

import copy
import json
import random
import struct
from collections.abc import Sequence
from typing import Any

from driver import Data
from mutations import spoil_bytes
from spoiltmeshes import CUBE, LARGE, TRIANGLES, cases_of, subject_of
from writers import glb_bytes, pack_glb

VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    -1,
    0,
    1,
    2,
    3,
    255,
    65535,
    2**31,
    2**53,
    2**64,
    10**400,
    0.5,
    -0.0,
    1e-300,
    1e30,
    1e300,
    float("nan"),
    float("inf"),
    "",
    "0",
    "data:;base64,AAAA",
    "data:,%41",
    "file:///dev/zero",
    "../x.bin",
    [],
    {},
    [0],
    [0, 0, 0],
    [1, 1, -1],
    [1e30, 1, 1],
    [0, 0, 0, 1],
    [0, 0, 0, 0],
    "VEC2",
    "VEC3",
    "SCALAR",
    "MAT4",
    5120,
    5121,
    5122,
    5123,
    5125,
    5126,
)
KEYS: dict[str, Any] = {
    "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1],
    "scale": [2, 2, -2],
    "rotation": [0, 0, 1, 1],
    "translation": [1, 2, 3],
    "children": [0, 1],
    "mesh": 0,
    "skin": 0,
    "mode": 5,
    "weights": [0.5],
    "targets": [{"POSITION": 0}],
    "normalized": True,
    "byteStride": 12,
    "byteOffset": 4,
    "TEXCOORD_0": 0,
    "COLOR_0": 0,
    "NORMAL": 0,
    "JOINTS_0": 0,
    "WEIGHTS_0": 0,
    "material": 0,
    "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}},
    "sparse": {
        "count": 1,
        "indices": {"bufferView": 1, "componentType": 5121},
        "values": {"bufferView": 0},
    },
    "skins": [{"joints": [0], "inverseBindMatrices": 0}],
    "extensionsRequired": ["KHR_mesh_quantization"],
}


def seeds() -> Sequence[bytes]:
    nodes = [
        {"children": [1, 2], "scale": [1, 1, 2]},
        {"mesh": 0},
        {"mesh": 0, "scale": [1, -1, 1]},
    ]
    return [*cases_of("glb"), glb_bytes(CUBE, TRIANGLES), glb_bytes(CUBE, TRIANGLES, nodes)]


def mutate(rng: random.Random, data: Data) -> bytes:
    assert isinstance(data, bytes)
    if rng.random() < LARGE:
        return large(rng)
    if rng.random() < 0.15:
        return spoil_bytes(rng, data)
    size = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    for _ in range(rng.randint(1, 5)):
        spoil_document(rng, document)
    if rng.random() < 0.2:
        binary = spoil_bytes(rng, binary)
    return pack_glb(document, binary)


def spoil_document(rng: random.Random, document: Any) -> None:
    """Change something anywhere in a tree of objects and lists."""
    places: list[Any] = [document]
    for place in places:
        inner = place.values() if isinstance(place, dict) else place
        places += [x for x in inner if isinstance(x, dict | list)]
    place = rng.choice(places)
    what = rng.randrange(4)
    if isinstance(place, dict):
        key = rng.choice([*place, *KEYS]) if place else rng.choice([*KEYS])
        if what == 0:
            place.pop(key, None)
        elif what == 1:
            place[key] = copy.deepcopy(rng.choice(VALUES))
        elif what == 2:
            place[key] = copy.deepcopy(rng.choice(places))
        else:
            key = rng.choice([*KEYS])
            place[key] = copy.deepcopy(KEYS[key])
    elif what == 0 and place:
        del place[rng.randrange(len(place))]
    elif what == 1 and place:
        place[rng.randrange(len(place))] = copy.deepcopy(rng.choice(VALUES))
    else:
        place.insert(rng.randrange(len(place) + 1), copy.deepcopy(rng.choice(place or VALUES)))


def large(rng: random.Random) -> bytes:
    """Return a file that takes long if something goes wrong."""
    n = 10 ** rng.randint(3, 5)
    data = glb_bytes(CUBE, TRIANGLES)
    size = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    what = rng.randrange(8)
    if what == 0:  # a chain of nodes, which may bite its tail
        document["nodes"] = [{"children": [k + 1], "scale": [1, 1, 1]} for k in range(n)]
        document["nodes"].append({"mesh": 0} | ({"children": [0]} if n % 2 else {}))
    elif what == 1:
        document["nodes"] = [{"mesh": 0, "translation": [k, 0, 0]} for k in range(n)]
        document["scenes"] = [{"nodes": list(range(n))}]
    elif what == 2:
        document["meshes"][0]["primitives"] *= n
    elif what == 3:
        text = b"[" * n + b"]" * n
        return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    elif what == 4:
        document["accessors"].append({"componentType": 5126, "count": 10 * n, "type": "VEC3"})
        document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 2
    elif what == 5:
        document["accessors"][0] |= {"count": 10**9, "byteStride": 0}
        document["bufferViews"][0]["byteLength"] = 10**12
    elif what == 6:
        uri = "data:application/octet-stream;base64," + "A" * 10 * n
        document["buffers"] = [{"byteLength": 2 * n, "uri": uri}]
    else:
        document["accessors"].append({"componentType": 5126, "count": 10 * n, "type": "VEC3"})
        attributes = {"TRANSLATION": 2}
        document["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    return pack_glb(document, binary)


SUBJECT = subject_of("glb", seeds, mutate)
