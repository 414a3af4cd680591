"""Measure everything, or the subjects that are named; or compare two versions.

``python -m benchmarks [--write] [--tiny] [SUBJECT...]``, ``python -m benchmarks compare OLD NEW``,
``python -m benchmarks validation``
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks import (
    blobs,
    compare,
    detail,
    growth,
    mesh,
    modes,
    operations,
    pictures,
    rays,
    scattered,
    trees,
    view,
    wood,
)
from benchmarks.report import Effort, Subject, describe_machine, lines_of
from benchmarks.results import merge

SUBJECTS: tuple[Subject, ...] = (
    rays.FIRST,
    rays.ANY,
    rays.THREADS,
    trees.TIMES,
    trees.EDITS,
    trees.CONTOURS,
    trees.WEIGHTS,
    trees.ROUND_TRIPS,
    trees.HARD,
    modes.MODES,
    mesh.MESH,
    operations.OPERATIONS,
    scattered.SCATTERED,
    detail.SUSPENDED,
    detail.DETAIL,
    pictures.PICTURES,
    pictures.STARTUP,
    blobs.BLOBS,
    growth.INSTANTS,
    growth.SHAPES,
    growth.AREAS,
    wood.WOOD,
    wood.GRIDS,
    wood.FRAMES,
    view.VIEW,
)
RESULTS = Path(__file__).parent / "RESULTS.md"


def main(arguments: list[str] | None = None) -> None:
    words = sys.argv[1:] if arguments is None else arguments
    if words[:1] == ["compare"]:
        sys.exit(compare.main(words[1:]))
    if words[:1] == ["validation"]:
        from benchmarks import validation

        sys.exit(validation.main(words[1:]))
    parser = argparse.ArgumentParser(
        "python -m benchmarks",
        description="Ours beside peers.",
        epilog="`compare OLD NEW` instead of subjects: one version against another.",
    )
    names = [subject.name for subject in SUBJECTS]
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=", ".join(names))
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md")
    parser.add_argument("--tiny", action="store_true", help="small sizes: whether it runs at all")
    options = parser.parse_args(words)
    unknown = set(options.subjects) - set(names)
    if unknown:
        parser.error(f"no subject {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    effort = Effort(rays=1024, size=32, repeats=1, tiny=True) if options.tiny else Effort()
    machine = describe_machine()
    head = ["# Results", "", "[What they tell](../docs/engines.md).", "", *machine, ""]
    print("\n".join(head))
    sections = dict.fromkeys((subject.title for subject in SUBJECTS), "")
    for subject in SUBJECTS:
        if not options.subjects or subject.name in options.subjects:
            lines = []
            for line in lines_of(subject, effort):
                lines.append(line)
                print(line, flush=True)
            date = time.strftime("%Y-%m-%d", time.gmtime())
            lines.append(f"`python -m benchmarks {subject.name}`, {date}")
            sections[subject.title] = "\n".join(lines)
    if options.write:
        old = RESULTS.read_text(encoding="utf-8") if RESULTS.exists() else ""
        RESULTS.write_text(merge(old, head, machine[0], sections), encoding="utf-8")


if __name__ == "__main__":
    main()
