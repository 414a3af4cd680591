"""Clouds in files, written piece by piece."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from pcsg.errors import UsageError, missing_extra
from pcsg.lidar.cloud import BEAM_FIELDS, Cloud, join
from pcsg.outputs import check_output, write_by_name, write_whole

CLOUD_ENDINGS = (".laz", ".las", ".csv", ".xyz", ".ply", ".npz")

_SCALE = 1e-4
"""Metres of a LAS unit."""

_EXTRA = {
    "label": "int32",
    "range": "float64",
    "incidence": "float32",
    "nx": "float32",
    "ny": "float32",
    "nz": "float32",
}

_COLUMNS = ("x", "y", "z", "intensity", "return_number", "returns", "label", "leg", "time", "range")


def check_cloud(path: Path) -> None:
    """Raise an error now if a cloud could not be written later.

    Raises
    ------
    UsageError
        The ending is unknown, or laspy is missing.
    EnvironmentFault
        The folder takes no files.
    """
    check_output(path, CLOUD_ENDINGS)
    if path.suffix.lower() in (".laz", ".las"):
        load_laspy()


def load_laspy() -> Any:
    """Return the library laspy.

    Raises
    ------
    UsageError
        It is missing, or lazrs is.
    """
    try:
        import laspy
        import lazrs  # noqa: F401 -- laspy finds it
    except ImportError:
        raise UsageError(
            missing_extra("writing LAS files needs", "laspy and lazrs", "science")
        ) from None
    return laspy


def write_cloud(path: Path, parts: Iterable[Cloud], classes: Mapping[int, int]) -> None:
    """Write the parts of a cloud to a file; only one of them is held at a time, but for .npz.

    Parameters
    ----------
    path
        Its ending says how.
    parts
        In order.
    classes
        LAS classes by label.
    """
    check_cloud(path)
    ending = path.suffix.lower()
    if ending == ".npz":
        whole = join(list(parts))
        columns = {f.name: getattr(whole, f.name) for f in fields(Cloud)}
        write_whole(path, lambda file: np.savez_compressed(file, **columns))
    elif ending in (".laz", ".las"):
        _write_las(path, parts, classes)
    elif ending == ".ply":
        _write_ply(path, list(parts))
    else:
        write_whole(path, lambda file: _write_text(file, parts, ending == ".csv"))


def _write_text(file: IO[bytes], parts: Iterable[Cloud], named: bool) -> None:
    """Write .csv with names, or .xyz without."""
    if named:
        file.write((",".join(_COLUMNS) + "\n").encode())
    for part in parts:
        if named:
            table = np.column_stack([part.points, *(getattr(part, name) for name in _COLUMNS[3:])])
            form = ["%.5f"] * 3 + ["%.5f", "%d", "%d", "%d", "%d", "%.7f", "%.5f"]
            np.savetxt(file, table, fmt=form, delimiter=",")
        else:
            np.savetxt(file, part.points, fmt="%.5f")


def _write_ply(path: Path, parts: list[Cloud]) -> None:
    kind = np.dtype([*((name, "<f8") for name in "xyz"), ("intensity", "<f4"), ("label", "<i4")])
    count = sum(map(len, parts))
    names = {"<f8": "double", "<f4": "float", "<i4": "int"}
    described = [(name, names[kind[name].str]) for name in kind.names or ()]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    head += [f"property {of} {name}" for name, of in described]

    def write(file: IO[bytes]) -> None:
        file.write(("\n".join([*head, "end_header"]) + "\n").encode())
        for part in parts:
            rows = np.zeros(len(part), kind)
            rows["x"], rows["y"], rows["z"] = part.points.T
            rows["intensity"], rows["label"] = part.intensity, part.label
            file.write(rows.tobytes())

    write_whole(path, write)


def _write_las(path: Path, parts: Iterable[Cloud], classes: Mapping[int, int]) -> None:
    laspy = load_laspy()
    beams: list[dict[str, Any]] = []

    def write(place: Path) -> None:
        writer = None
        for part in parts:
            if writer is None:
                header = laspy.LasHeader(version="1.4", point_format=6)
                header.scales = np.full(3, _SCALE)
                header.offsets = np.floor(part.points.min(axis=0)) if len(part) else np.zeros(3)
                header.add_extra_dims(
                    [laspy.ExtraBytesParams(name, of) for name, of in _EXTRA.items()]
                )
                writer = laspy.open(
                    place, mode="w", header=header, do_compress=path.suffix.lower() == ".laz"
                )
            if len(part):
                writer.write_points(_records(laspy, part, writer.header, classes))
            missed = part.missed
            beams.append({name: getattr(part, name)[missed] for name in BEAM_FIELDS})
        if writer is not None:
            writer.close()

    write_by_name(path, write)
    columns: dict[str, Any] = {
        name: np.concatenate([b[name] for b in beams]) for name in BEAM_FIELDS if beams
    }
    if columns and len(columns["beam_legs"]):
        misses = path.with_name(f"{path.stem}.misses.npz")
        write_whole(misses, lambda file: np.savez_compressed(file, **columns))


def _records(laspy: Any, part: Cloud, header: Any, classes: Mapping[int, int]) -> Any:
    """Return the points of a part as LAS has them."""
    points = laspy.ScaleAwarePointRecord.zeros(len(part), header=header)
    points.x, points.y, points.z = part.points.T
    points.intensity = np.clip(65535.0 * part.intensity, 0, 65535).astype(np.uint16)
    # The format counts to 15.
    points.return_number = np.minimum(part.return_number, 15)
    points.number_of_returns = np.minimum(part.returns, 15)
    code = np.ones(len(part), np.uint8)
    for label, number in classes.items():
        code[part.label == label] = number
    points.classification = code
    points.gps_time = part.time
    points.point_source_id = part.leg + 1
    values = {"label": part.label, "range": part.range, "incidence": part.incidence}
    values |= dict(zip(("nx", "ny", "nz"), part.normals.T, strict=True))
    for name, column in values.items():
        points[name] = column.astype(_EXTRA[name])
    return points
