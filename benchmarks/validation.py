"""Canopies, light and laser scans beside closed forms: ``python -m benchmarks validation``.

Writes docs/validation.md. A row passes where the difference is at most its tolerance, or three
standard errors.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pcsg
from benchmarks.report import describe_machine
from benchmarks.stands import LEAF, ball, discs, forest_of_balls, normals_of, slab, trillion
from pcsg import lidar, light
from pcsg.trace.measures import Measured

PAGE = Path(__file__).parents[1] / "docs" / "validation.md"

HEAD = """# Validation

Made by `python -m benchmarks validation --write`. A row passes where the difference to what is
expected is at most the tolerance of the case, or three standard errors. Stands are one draw of
chance each, whose own scatter is part of the tolerance. Expected values are closed forms, but for
the forest of spheres, whose values are those of a benchmark of radiative transfer models.

"""


@dataclass(frozen=True)
class Row:
    """A row of the page."""

    case: str
    given: str
    expected: float
    found: Measured
    tolerance: float

    @property
    def passes(self) -> bool:
        """Whether the difference is small enough."""
        return abs(self.found.value - self.expected) <= max(
            self.tolerance, 3.0 * self.found.se + 1e-9
        )


def share(found: Measured, of: float) -> Measured:
    return Measured(found.value / of, found.se / of)


def rows_of_projections(scale: float) -> Iterator[Row]:
    expected = {
        "planophile": (0.8488, 0.4969),
        "erectophile": (0.4244, 0.5041),
        "plagiophile": (0.6791, 0.4803),
        "spherical": (0.5, 0.5),
    }
    for kind, values in expected.items():
        scene, _ = slab(kind, 1.0, 100_000)
        angles = [0.0, 57.5]
        found = light.projection(scene, angles, n=int(400_000 * scale))
        for angle, value, one in zip(angles, values, found, strict=True):
            yield Row("G: mean projection", f"{kind}, {angle:g} degrees", value, one, 0.002)


def rows_of_gaps(scale: float) -> Iterator[Row]:
    cases = {
        ("spherical", 3.0): (
            (0, 20, 30, 50, 57.5, 60, 70),
            (0.2231, 0.2027, 0.1769, 0.0969, 0.0613, 0.0498, 0.0125),
        ),
        ("planophile", 2.0): ((0, 57.5), (0.1831, 0.1573)),
        ("erectophile", 2.0): ((0, 57.5), (0.4279, 0.1531)),
    }
    for (kind, lai), (angles, values) in cases.items():
        scene, cell = slab(kind, lai, 200_000)
        found = light.gap_fraction(scene, angles, periodic=cell, rays=int(100_000 * scale))
        for k, value in enumerate(values):
            given = f"{kind}, LAI {lai:g}, {angles[k]:g} degrees"
            one = Measured(float(found.P[k]), float(found.se[k]))
            yield Row("gap fraction, discs at random", given, value, one, 0.003)
        if kind == "spherical":
            # At LAI 3 no ray in a hundred thousand comes through at 85 degrees.
            lai = 1.0
            scene, cell = slab(kind, lai, 200_000)
            rings = np.arange(2.5, 86.0, 5.0)
            found = light.gap_fraction(scene, rings, periodic=cell, rays=int(60_000 * scale))
            # The error of the sum, from those of the rings.
            lai_of = light.lai(found.P, rings)
            bent = [
                light.lai(found.P + found.se * (np.arange(len(rings)) == k), rings) - lai_of
                for k in range(len(rings))
            ]
            one = Measured(lai_of, math.sqrt(sum(b * b for b in bent)))
            yield Row("LAI by Miller's integral", "LAI 1, rings to 85 degrees", lai, one, 0.02)


def rows_of_light(scale: float) -> Iterator[Row]:
    scene, cell = slab("spherical", 2.0, 200_000)
    for source, value, name in (
        (light.sun(36), 0.70948, "direct at 36 degrees"),
        (light.sky("uniform"), 0.78062, "uniform sky"),
    ):
        found = light.interception(
            scene, source, {"x": {LEAF: 0.0}}, periodic=cell, rays=int(200_000 * scale)
        )["x"]
        one = share(Measured(found.absorbed[LEAF], found.se[LEAF]), found.incident)
        yield Row("black leaves intercept", f"LAI 2, spherical, {name}", value, one, 0.01 * value)
    for lai in (1.0, 3.0, 5.0):
        # Ways between leaves are long beside their size, so that light does not come back by the
        # gap that it came through.
        scene, cell = slab("horizontal", lai, 400_000, height=2.5 * lai)
        found = light.interception(
            scene, light.sun(0), {"x": {LEAF: (0.5, 0.5)}}, periodic=cell, rays=int(60_000 * scale)
        )["x"]
        for what, value, one in (
            ("reflected", lai / (2 + lai), found.reflected),
            ("transmitted", 2 / (2 + lai), found.soil),
        ):
            given = f"LAI {lai:g}, black soil: {what}"
            one = share(one, found.incident)
            yield Row("horizontal leaves, rho = tau = 1/2", given, value, one, 0.003)
        if lai == 3.0:
            yield from _rows_of_three(scene, cell, scale)


def _rows_of_three(scene: pcsg.Scene, cell: tuple[float, ...], scale: float) -> Iterator[Row]:
    bands = {"x": {LEAF: (0.4957, 0.4409), "soil": 0.159}}
    rays = int(60_000 * scale)
    x = light.interception(scene, light.sun(0), bands, periodic=cell, rays=rays)["x"]
    down = Measured(x.soil.value / (1 - 0.159), x.soil.se / (1 - 0.159))
    leaves = Measured(x.absorbed[LEAF], x.se[LEAF])
    for what, value, one in (
        ("R", 0.53537, x.reflected),
        ("T (downward at the soil)", 0.34410, down),
        ("A", 0.17524, leaves),
    ):
        given = f"rho .4957, tau .4409, LAI 3, soil .159: {what}"
        yield Row("horizontal leaves", given, value, share(one, x.incident), 0.003)
    bands = {"x": {LEAF: (0.5, 0.5), "soil": 1.0}}
    white = light.interception(scene, light.sun(0), bands, periodic=cell, rays=rays // 15)["x"]
    yield Row(
        "conservative leaves and soil", "albedo", 1.0, share(white.reflected, white.incident), 0
    )
    absorbed = Measured(white.absorbed[LEAF], white.se[LEAF])
    yield Row("conservative leaves and soil", "absorption", 0.0, share(absorbed, white.incident), 0)
    yield Row("energy balance", "leaves + soil + reflected", 1.0, x.balance, 0)


def rows_of_crowns(scale: float) -> Iterator[Row]:
    rng = np.random.default_rng(5)
    for tau, value in ((1.0, 0.52848), (2.0, 0.29700), (3.75, 0.12633), (5.0, 0.07677)):
        scene = ball(tau, 200_000)
        n = int(400_000 * scale)
        # Rays in all directions, through places alike over the ball's outline.
        r, a = np.sqrt(rng.random(n)), 2.0 * math.pi * rng.random(n)
        towards = light.direction(np.degrees(np.arccos(2 * rng.random(n) - 1)), 360 * rng.random(n))
        across = np.cross(towards, np.roll(towards, 1, axis=1))
        across /= np.linalg.norm(across, axis=1)[:, None]
        beside = np.cross(towards, across)
        o = (r * np.cos(a))[:, None] * across + (r * np.sin(a))[:, None] * beside - 3.0 * towards
        p = float(1.0 - scene.occluded(o, towards).mean())
        found = Measured(p, math.sqrt(p * (1 - p) / n))
        yield Row("mean transmission of a crown", f"optical diameter {tau:g}", value, found, 0.003)


def plates(a: object, b: object) -> pcsg.Scene:
    return pcsg.Scene(pcsg.label(1) * a | pcsg.label(2) * b)


def rows_of_exchange(scale: float) -> Iterator[Row]:
    rays = int(2_000_000 * scale)
    square = pcsg.uscale(0.5) * pcsg.rectangle()
    corner = plates(
        pcsg.move(0.5, 0.5, 0) * square, pcsg.move(0, 0.5, 0.5) * pcsg.roty(90) * square
    )
    facing = pcsg.move(0, 0, 0.5) * pcsg.rotx(180)
    long = pcsg.scale(0.5, 1, 1) * pcsg.rectangle()
    small, large = pcsg.uscale(0.2) * pcsg.disc(), pcsg.uscale(0.5) * pcsg.disc()
    cases = (
        ("unit squares with a common edge at 90 degrees", corner, 1, 0.20004),
        ("rectangles 1 x 2 at distance .5", plates(long, facing * long), 1, 0.50899),
        ("disc .2 to disc .5 at .5", plates(small, facing * large), 1, 0.48003),
        ("disc .5 to disc .2 at .5", plates(small, facing * large), 2, 0.07681),
    )
    for given, scene, label, value in cases:
        found = light.exchange(scene, label, rays=rays)[3 - label]
        yield Row("view factor", given, value, found, 0.005 * value)


def rows_of_triangles(scale: float) -> Iterator[Row]:
    triangle = pcsg.uscale(math.sqrt(2.0)) * pcsg.tri1()
    scene = plates(pcsg.move(0, 0, 1e-5) * triangle, triangle)
    optics = {1: (0.06, 0.04), 2: (0.06, 0.04)}
    found = light.interception(
        scene, light.sun(0, 180, 100), {"x": optics}, rays=int(4_000_000 * scale)
    )["x"]
    for label, value, name in ((1, 90.217, "upper"), (2, 3.6130, "lower")):
        one = Measured(found.absorbed[label], found.se[label])
        given = f"1e-5 apart, 100 W/m2, rho .06, tau .04: {name}, W"
        yield Row("two triangles of area 1", given, value, one, 1e-3 * value)


def rows_of_forests(scale: float) -> Iterator[Row]:
    scene, cell = forest_of_balls()
    bands = {"vis": {LEAF: (0.0735, 0.0566), "soil": 0.1217}}
    for zenith, values in ((27, (0.31404, 0.06195, 0.71048)), (60, (0.49003, 0.05152, 0.52197))):
        found = light.interception(
            scene, light.sun(zenith), bands, periodic=cell, rays=int(200_000 * scale)
        )["vis"]
        down = Measured(found.soil.value / (1 - 0.1217), found.soil.se / (1 - 0.1217))
        leaves = Measured(found.absorbed[LEAF], found.se[LEAF])
        names = ("absorbed by leaves", "reflected", "downward at the soil")
        for name, value, one in zip(names, values, (leaves, found.reflected, down), strict=True):
            given = f"sun {zenith} degrees: {name}"
            yield Row("forest of spheres, VIS", given, value, share(one, found.incident), 0.01)


def rows_of_scans(scale: float) -> Iterator[Row]:
    rng = np.random.default_rng(1)
    # Leaves around the cube, too, so that it has no border.
    n = int(2.0 * 1.2**3 / (math.pi * 0.01**2))
    points = rng.random((n, 3)) * 1.2 - 0.1
    scene = pcsg.Scene(discs(points, normals_of("spherical", n, rng), 0.01))
    step = 0.05 / math.sqrt(scale)
    device = lidar.SCANNERS["vz400"].but(zenith=(82, 98), azimuth=(-8, 8), step=step)
    cloud = lidar.scan(scene, device, [(0.5, -5, 0.5)])
    found = lidar.density(cloud, [[0, 0, 0], [1, 1, 1]], LEAF)
    given = "discs of radius .01 m, LAI 2, VZ-400 at 5 m"
    yield Row("laser: leaf area density, m2/m3", given, 2.0, found.area, 0.04)
    yield Row("laser: mean G", given, 0.5, found.G, 0.025)
    narrow = lidar.SCANNERS["vz400"].but(zenith=(90, 90), azimuth=(0, 0.001), range_sd=0.0)
    wall = pcsg.rotx(90) * pcsg.uscale(5) * pcsg.rectangle()
    footprint = 1e3 * 1e-3 * narrow.divergence * 50.0
    yield Row("laser: footprint at 50 m, mm", "VZ-400", 15.0, Measured(footprint, 0.0), 1e-9)
    for behind, echoes in ((0.5, 1), (1.0, 2)):
        edge = plates(pcsg.move(-5, 50, 0) * wall, pcsg.move(0, 50 + behind, 0) * wall)
        count = float(lidar.scan(edge, narrow, [(0, 0, 0)]).returns.max())
        yield Row("laser: echoes", f"two walls {behind:g} m apart", echoes, Measured(count, 0.0), 0)


SECTIONS: dict[str, Callable[[float], Iterator[Row]]] = {
    "projections": rows_of_projections,
    "gaps": rows_of_gaps,
    "light": rows_of_light,
    "crowns": rows_of_crowns,
    "exchange": rows_of_exchange,
    "triangles": rows_of_triangles,
    "forests": rows_of_forests,
    "scans": rows_of_scans,
}


def measure_memory(leaves: int) -> dict[str, float]:
    """Return gap fraction, its error, memory and seconds of a stand, in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.validation", "--stand", str(leaves)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def highest_memory() -> float:
    """Return the most memory that this process has had, MB: what it began from does not count."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1024  # type: ignore[index]


def report_stand(leaves: int) -> None:
    """Print what `measure_memory` reads."""
    begin = time.perf_counter()
    scene, plot, lai = trillion(leaves)
    count = scene.measure("count").value
    found = light.gap_fraction(scene, [30.0], plot=plot, rays=100_000)
    seconds = time.perf_counter() - begin
    print(
        json.dumps(
            {
                "leaves": count,
                "P": float(found.P[0]),
                "se": float(found.se[0]),
                "expected": math.exp(-0.5 * lai / math.cos(math.radians(30))),
                "MB": highest_memory(),
                "seconds": seconds,
            }
        )
    )


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks validation", description=__doc__)
    parser.add_argument("sections", nargs="*", help=", ".join(SECTIONS))
    parser.add_argument("--scale", type=float, default=1.0, help="more or fewer rays")
    parser.add_argument("--write", action="store_true", help="write docs/validation.md")
    parser.add_argument("--stand", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.stand:
        report_stand(options.stand)
        return 0
    lines = ["| case | input | expected | ours | standard error | passes |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    print("\n".join(lines), flush=True)
    failed = 0
    for name in options.sections or SECTIONS:
        for row in SECTIONS[name](options.scale):
            verdict = "yes" if row.passes else "**no**"
            failed += not row.passes
            line = (
                f"| {row.case} | {row.given} | {row.expected:.5g} | {row.found.value:.5g} |"
                f" {row.found.se:.2g} | {verdict} |"
            )
            lines.append(line)
            print(line, flush=True)
    lines += ["", "## Leaves and memory", ""]
    lines.append(
        "The gap fraction at 30 degrees of stands of one cell of discs, doubled again and again,\n"
        "in a process of its own each. The count is exact, memory that of the whole process at\n"
        "its highest."
    )
    lines += ["", "| leaves | gap fraction | standard error | formula | MB | seconds |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for leaves in (10**6, 10**9, 10**12):
        found = measure_memory(leaves)
        lines.append(
            f"| {found['leaves']:,.0f} | {found['P']:.4f} | {found['se']:.4f} |"
            f" {found['expected']:.4f} | {found['MB']:.0f} | {found['seconds']:.1f} |"
        )
        print(lines[-1], flush=True)
    if options.write:
        machine = "\n".join(describe_machine())
        PAGE.write_text(HEAD + "\n".join(lines) + f"\n\n{machine}\n", encoding="utf-8")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
