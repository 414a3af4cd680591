"""The order of a graph in which what stands below comes first."""

from __future__ import annotations

from collections.abc import Sequence


def successors_first(successors: Sequence[Sequence[int]]) -> list[int]:
    """Return the numbers of a rooted graph's nodes so that successors precede, cycles apart."""
    order: list[int] = []
    seen = bytearray(len(successors))
    for root in range(len(successors)):
        if seen[root]:
            continue
        seen[root] = 1
        path, below = [root], [iter(successors[root])]
        while path:
            for s in below[-1]:
                if not seen[s]:
                    seen[s] = 1
                    path.append(s)
                    below.append(iter(successors[s]))
                    break
            else:
                below.pop()
                order.append(path.pop())
    return order
