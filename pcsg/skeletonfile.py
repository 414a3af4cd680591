"""Files of skeletons: SWC, and JSON with nodes, edges, root and tags; read to plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcsg.errors import UsageError
from pcsg.inputs import parse_json, read_text

SKELETON_ENDINGS = (".json", ".swc")


LARGEST_FILE = 64 * 2**20
"""Bytes of a file at most: a million nodes."""

LARGEST, SMALLEST = 1e30, 1e-30
"""Of numbers, and of radii above 0: others lose their meaning in single precision."""

LARGEST_TYPE = 2**31 - 1
"""Of the types of SWC, which become labels."""


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


def _odd_number(row: Sequence[float]) -> str | None:
    """Return what is wrong with the numbers x, y, z, r of a node; None if nothing is."""
    for value in row:
        if not abs(value) <= LARGEST:
            return f"{value:g} is no place and no radius: numbers go up to {LARGEST:g}"
    return None if not 0.0 < row[3] < SMALLEST else f"the radius {row[3]:g} is too small"


def _shown(number: int) -> str:
    """Return as much of a whole number as a message holds."""
    text = str(number)
    return text if len(text) <= 30 else text[:30] + "..."


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
        root = data.get("root", 0)
        if not isinstance(root, int):
            raise TypeError
        tags = {str(k): np.array(v, dtype=np.int64) for k, v in data.get("tags", {}).items()}
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise UsageError(
            f"{name}: `nodes` are lists [x, y, z, r] and `edges` pairs of whole numbers"
        ) from None
    if nodes.ndim != 2 or nodes.shape[1] != 4:
        raise UsageError(f"{name}: every node is a list [x, y, z, r]")
    if edges.ndim != 2 or edges.shape[1] != 2:
        raise UsageError(f"{name}: every edge is a pair [a, b]")
    for tag, numbers in tags.items():
        if numbers.shape != (len(edges),):
            raise UsageError(f"{name}: the tag `{tag[:40]}` has one number for each edge")
    for k, row in enumerate(nodes.tolist()):
        if wrong := _odd_number(row):
            raise UsageError(f"{name}: node {k}: {wrong}")
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
        if wrong := _odd_number(values):
            raise UsageError(f"{name}, line {n}: {wrong}")
        if abs(kind) > LARGEST_TYPE:
            raise UsageError(f"{name}, line {n}: the type {_shown(kind)} is too large")
        if ident in rows:
            raise UsageError(f"{name}, line {n}: the id {_shown(ident)} is there already")
        rows[ident] = kind, values, above, n
    number = {ident: k for k, ident in enumerate(rows)}
    edges, labels, roots = [], [], []
    for ident, (kind, _, above, n) in rows.items():
        if above < 0:
            roots.append(ident)
        elif above not in number:
            raise UsageError(f"{name}, line {n}: there is no node {_shown(above)}")
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
        data = parse_json(text)
    except ValueError as error:
        raise UsageError(f"{name}: not JSON: {error}") from None
    return rows_from_json(data, name)


def load_rows(path: Path) -> SkeletonRows:
    """Read a skeleton, .json or .swc.

    Raises
    ------
    UsageError
        The file is not there or not a skeleton.
    """
    return parse_rows(read_skeleton_text(path), str(path))


def read_skeleton_text(path: Path) -> str:
    """Return the text of a skeleton's file.

    Raises
    ------
    UsageError
        It cannot be read.
    """
    return read_text(path, "skeleton", LARGEST_FILE)
