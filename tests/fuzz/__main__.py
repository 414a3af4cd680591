"""``python -m tests.fuzz SUBJECT -n INPUTS --seed S``: many made-up inputs, as long as asked."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

# As pytest does it: the tests' modules are found by their bare names.
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from driver import explore, subjects  # noqa: E402 -- found by the path above


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description="try many made-up inputs"
    )
    parser.add_argument("subject", nargs="*", help=f"of {', '.join(subjects())}; default all")
    parser.add_argument("-n", type=int, default=10_000, help="inputs of each subject")
    parser.add_argument("--seed", type=int, default=1, help="of the chance that makes them")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--folder", type=Path, default=Path("fuzz-failures"), help="for what fails")
    asked = parser.parse_args()
    unknown = set(asked.subject) - set(subjects())
    if unknown:
        parser.error(f"no subject {', '.join(sorted(unknown))}; there are {', '.join(subjects())}")
    failed = False
    for name in asked.subject or subjects():
        start = time.monotonic()
        numbers = range(asked.first, asked.first + asked.n)
        counts = explore(name, asked.seed, numbers, asked.folder)
        seconds = time.monotonic() - start
        print(f"{name}: {asked.n} inputs, {sum(counts.values())} failures, {seconds:.0f} s")
        for kind, count in sorted(counts.items(), key=lambda item: -item[1]):
            print(f"  {count:7d} {kind}", flush=True)
        failed |= bool(counts)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
