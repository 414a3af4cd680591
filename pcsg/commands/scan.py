"""``pcsg scan``: laser scans to files."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from pcsg.commands.guard import say
from pcsg.commands.options import parse_number
from pcsg.commands.progress import show_share
from pcsg.commands.scenes import open_scene
from pcsg.errors import EnvironmentFault, UsageError
from pcsg.outputs import write_whole

if TYPE_CHECKING:
    from pcsg.lidar.cloud import Cloud
    from pcsg.scene import Scene


def run(
    file: Path,
    output: Path,
    scanner: str,
    places: Sequence[str],
    figures: Sequence[str],
    returns: str,
    rays_per_beam: int,
    misses: bool,
    periodic: str | None,
    classes: Sequence[str],
    resume: bool,
    assignments: Sequence[str],
    seed: int | None,
    time: float | None,
    include: Sequence[Path],
    max_memory: str | None,
    block_memory: str | None,
    quiet: bool,
) -> None:
    """Scan a scene and write the cloud."""
    from pcsg.lidar.echoes import check, pieces_of, scan_piece
    from pcsg.lidar.files import check_cloud, write_cloud
    from pcsg.lidar.scanners import as_legs, as_scanner
    from pcsg.trace.periodic import as_cell

    check_cloud(output)
    device = as_scanner(scanner).but(**parse_figures(figures))
    legs = as_legs([parse_leg(place) for place in places])
    codes = parse_classes(classes)
    chance = 0 if seed is None else seed
    check(returns, rays_per_beam, chance)
    cell = None if periodic is None else as_cell(parse_list(periodic, "--periodic"))
    scene = open_scene(
        file, assignments, seed, time, include, max_memory, block_memory, quiet=quiet
    )
    asked = (device, places, returns, rays_per_beam, misses, cell, chance)
    folder = open_folder(output, scene, asked, resume)
    pieces = pieces_of(device, legs)
    with show_share(f"scanning {file.name}", quiet) as move:
        for k, piece in enumerate(pieces):
            place = folder / f"{k:08d}.npz"
            if not place.exists():
                part = scan_piece(
                    scene,
                    device,
                    legs,
                    piece,
                    cast(Any, returns),
                    rays_per_beam,
                    misses,
                    None if cell is None else np.array(cell),
                    chance,
                )
                save_part(place, part)
            if move is not None:
                move(k + 1, len(pieces))
    write_cloud(output, read_parts(folder, len(pieces)), codes)
    shutil.rmtree(folder, ignore_errors=True)
    if not quiet:
        say(f"wrote {output}")


def open_folder(output: Path, scene: Scene, asked: object, resume: bool) -> Path:
    """Return the folder of a scan's parts; those of another scan are removed."""
    folder = output.with_name(output.name + ".parts")
    key = hashlib.sha256(repr((scene.source_hash, asked)).encode()).hexdigest()
    mark = folder / "scan.txt"
    try:
        known = mark.read_text(encoding="utf-8") if mark.is_file() else ""
        if folder.exists() and not (resume and known == key):
            if not known:
                raise UsageError(f"{folder} is in the way: it holds no parts of a scan")
            shutil.rmtree(folder)
        folder.mkdir(exist_ok=True)
        mark.write_text(key, encoding="utf-8")
    except OSError as error:
        raise EnvironmentFault(f"cannot write {folder}: {error.strerror or error}") from error
    return folder


def save_part(path: Path, part: Cloud) -> None:
    """Write a part of a scan."""
    columns = {f.name: getattr(part, f.name) for f in fields(part)}
    write_whole(path, lambda file: np.savez(file, **columns))


def read_parts(folder: Path, count: int) -> Iterator[Cloud]:
    """Yield the parts of a scan, one at a time."""
    from pcsg.lidar.cloud import Cloud

    for k in range(count):
        with np.load(folder / f"{k:08d}.npz", allow_pickle=False) as columns:
            yield Cloud(**columns)


def parse_list(text: str, option: str) -> list[float]:
    """Return the numbers of a list with commas."""
    return [parse_number(word.strip(), option) for word in text.split(",")]


def parse_leg(text: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a place ``x,y,z``, or a path ``x,y,z..x,y,z``."""
    places = [parse_list(part, "--at") for part in text.split("..")]
    if len(places) > 2 or any(len(place) != 3 for place in places):
        raise UsageError(f"--at takes x,y,z, or x,y,z..x,y,z for a path, not {text!r}")
    return np.array(places[0] if len(places) == 1 else places)


def parse_figures(words: Sequence[str]) -> dict[str, Any]:
    """Return figures of a scanner, ``step=0.05`` or ``zenith=40,120``."""
    found: dict[str, Any] = {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign:
            raise UsageError(f"--figure takes name=value, not {word!r}")
        if name == "pattern":
            found[name] = value
            continue
        numbers = parse_list(value, f"--figure {name}")
        several = name in ("zenith", "azimuth", "lines")
        if name in ("zenith", "azimuth") and len(numbers) != 2:
            raise UsageError(f"--figure {name} takes two numbers, not {value!r}")
        if not several and len(numbers) != 1:
            raise UsageError(f"--figure {name} takes one number, not {value!r}")
        found[name] = tuple(numbers) if several else numbers[0]
    return found


def parse_classes(words: Sequence[str]) -> Mapping[int, int]:
    """Return LAS classes by label, ``label=code``."""
    found: dict[int, int] = {}
    for word in words:
        label, sign, code = word.partition("=")
        if not (sign and label.strip().lstrip("-").isdigit() and code.strip().isdigit()):
            raise UsageError(f"--class takes label=code, two whole numbers, not {word!r}")
        if int(code) > 255:
            raise UsageError(f"--class: codes are from 0 to 255, not {code}")
        found[int(label)] = int(code)
    return found
