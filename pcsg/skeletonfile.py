"""Files of skeletons: SWC, and JSON with nodes, edges, root and tags; read to plain arrays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError

SKELETON_ENDINGS = (".json", ".swc")


class SkeletonRows(NamedTuple):
    """What a file says; whether it makes sense is for its user to check.

    Attributes
    ----------
    pos : float64 (n, 3)
    radius : float64 (n,)
    edges : int64 (m, 2)
        Pairs of nodes.
    root : int
        The node that the tree grows from.
    tags : int64 (m,)
        Numbers of the edges, by name.
    """

    pos: NDArray[np.float64]
    radius: NDArray[np.float64]
    edges: NDArray[np.int64]
    root: int
    tags: dict[str, NDArray[np.int64]]


def rows_from_json(data: Any, name: str = "skeleton") -> SkeletonRows:
    """Return the skeleton of a JSON object.

    Raises
    ------
    UsageError
        Names what is missing or wrong.
    """
    if not isinstance(data, dict):
        raise UsageError(f"{name}: a skeleton is a JSON object with `nodes` and `edges`")
    for key in ("nodes", "edges"):
        if key not in data:
            raise UsageError(f"{name}: the skeleton has no `{key}`")
    try:
        nodes = np.array(data["nodes"], dtype=np.float64)
        edges = np.array(data["edges"], dtype=np.int64)
        root = int(data.get("root", 0))
        tags = {str(k): np.array(v, dtype=np.int64) for k, v in data.get("tags", {}).items()}
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise UsageError(
            f"{name}: `nodes` are lists [x, y, z, r] and `edges` pairs of whole numbers"
        ) from None
    if nodes.ndim != 2 or nodes.shape[1] != 4:
        raise UsageError(f"{name}: every node is a list [x, y, z, r]")
    if edges.ndim != 2 or edges.shape[1] != 2:
        raise UsageError(f"{name}: every edge is a pair [a, b]")
    return SkeletonRows(nodes[:, :3], nodes[:, 3], edges, root, tags)


def rows_from_swc(text: str, name: str = "skeleton") -> SkeletonRows:
    """Return the skeleton of an SWC file.

    Raises
    ------
    UsageError
        With the line that is wrong.
    """
    rows: dict[int, tuple[int, list[float], int, int]] = {}
    for n, line in enumerate(text.splitlines(), 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        try:
            ident, kind, above = int(words[0]), int(words[1]), int(words[6])
            values = [float(word) for word in words[2:6]]
        except (ValueError, IndexError):
            raise UsageError(
                f"{name}, line {n}: expected the 7 numbers id type x y z radius parent"
            ) from None
        if ident in rows:
            raise UsageError(f"{name}, line {n}: the id {ident} is there already")
        rows[ident] = kind, values, above, n
    number = {ident: k for k, ident in enumerate(rows)}
    edges, labels, roots = [], [], []
    for ident, (kind, _, above, n) in rows.items():
        if above < 0:
            roots.append(ident)
        elif above not in number:
            raise UsageError(f"{name}, line {n}: there is no node {above}")
        else:
            edges.append((number[above], number[ident]))
            labels.append(kind)
    if len(roots) != 1:
        raise UsageError(f"{name}: a tree has one root (parent -1), not {len(roots)}")
    nodes = np.array([values for _, values, _, _ in rows.values()])
    return SkeletonRows(
        nodes[:, :3],
        nodes[:, 3],
        np.array(edges, np.int64).reshape(-1, 2),
        number[roots[0]],
        {"label": np.array(labels, np.int64)},
    )


def parse_rows(text: str, name: str) -> SkeletonRows:
    """Return the skeleton of a text; the end of the name says which kind it is.

    Raises
    ------
    UsageError
        It is not a skeleton.
    """
    if name.lower().endswith(".swc"):
        return rows_from_swc(text, name)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{name}: not JSON: {error}") from None
    return rows_from_json(data, name)


def load_rows(path: Path) -> SkeletonRows:
    """Read a skeleton, .json or .swc.

    Raises
    ------
    UsageError
        The file is not there or not a skeleton.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not a text file") from None
    return parse_rows(text, str(path))
