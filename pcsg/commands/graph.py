"""``pcsg graph``: the cyclic graph drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pcsg.commands.files import check_there
from pcsg.errors import GrammarError

ENDINGS = (".svg", ".dot", ".png")


def run(file: Path, output: Path, include: Sequence[Path]) -> None:
    """Write the drawing in the format of the output's name."""
    from pcsg.outputs import check_output, write_whole

    check_there(file)
    check_output(output, ENDINGS)
    from pcsg.grammar import check_file
    from pcsg.graph import draw

    graph, diagnostics = check_file(file, include=include)
    if graph is None:
        raise GrammarError(diagnostics)
    ending = output.suffix.lower()
    if ending == ".png":
        picture = draw.draw_png(graph)
        write_whole(output, lambda target: picture.save(target, format="PNG"))
        return
    text = draw.draw_svg(graph) if ending == ".svg" else draw.draw_dot(graph)
    write_whole(output, lambda target: target.write(text.encode()))
