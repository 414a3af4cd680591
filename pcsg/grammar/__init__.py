"""From text to graph: preprocessor, syntax, checks, lowering."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.collector import collector_at_rest
from pcsg.errors import Diagnostic, GrammarError, SourceSpan
from pcsg.grammar.check import check_names, never_used
from pcsg.grammar.foreign import explain_foreign
from pcsg.grammar.items import cut_items
from pcsg.grammar.lower import lower
from pcsg.grammar.names import Names, collect_names
from pcsg.grammar.parse import parse_item
from pcsg.grammar.preprocess import Preprocessed, preprocess_file, preprocess_text
from pcsg.grammar.scene import build_settings
from pcsg.grammar.syntax import Item
from pcsg.graph.graph import Graph
from pcsg.graph.validate import (
    check_constant_selections,
    check_graph,
    check_parameters,
    check_setting_parameters,
    check_sheets,
)

__all__ = ["check_file", "check_text", "load_file", "load_text"]

MAX_ERRORS = 100
"""More mistakes are not told."""


def load_file(path: str | Path, *, include: Iterable[str | Path] = ()) -> Graph:
    """Read a grammar.

    Parameters
    ----------
    path
        The file.
    include
        Further folders whose files the grammar may name.

    Raises
    ------
    GrammarError
        With everything that is wrong with the file and the files that it includes.
    """
    return _graph_of(check_file(path, include=include))


def load_text(text: str, name: str = "<text>", *, include: Iterable[str | Path] = ()) -> Graph:
    """Read a grammar from a text; ``#include`` is relative to the working directory.

    Raises
    ------
    GrammarError
        With everything that is wrong with the text.
    """
    return _graph_of(check_text(text, name, include=include))


def check_file(
    path: str | Path, *, include: Iterable[str | Path] = ()
) -> tuple[Graph | None, list[Diagnostic]]:
    """Read a grammar and return all errors and warnings; the graph if there are no errors.

    The file of an L-system stands for a grammar of one blob, the plant that it draws.
    """
    with collector_at_rest():
        return _check(preprocess_file(Path(path), include))


def check_text(
    text: str,
    name: str = "<text>",
    *,
    include: Iterable[str | Path] = (),
    folder: Path | None = None,
) -> tuple[Graph | None, list[Diagnostic]]:
    """Read a text and return all errors and warnings; the graph if there are no errors.

    Parameters
    ----------
    folder
        What names of files are relative to, by default the working directory.
    """
    with collector_at_rest():
        return _check(preprocess_text(text, name, include, folder))


def _graph_of(checked: tuple[Graph | None, list[Diagnostic]]) -> Graph:
    graph, diagnostics = checked
    if graph is None:
        raise GrammarError([d for d in diagnostics if d.severity == "error"])
    return graph


def _check(text: Preprocessed) -> tuple[Graph | None, list[Diagnostic]]:
    problems = text.problems
    if text.root is None:
        return None, problems
    items: list[Item] = []
    for tokens in text.files:
        raws = cut_items(tokens)
        for raw in raws:
            item, problem = parse_item(raw, raw is raws[-1])
            items.append(item)
            if problem:
                problems.append(problem)
    names, found = collect_names(items, SourceSpan(text.root, 0, 0), text.reach)
    problems += found
    problems += check_names(names)
    settings, found = build_settings(names)
    problems += found
    root = lower(names, not any(p.severity == "error" for p in problems))
    graph = Graph(root, settings) if root else None
    if graph:
        problems += _check_graph(graph, names)
    problems += never_used(names)
    if any(p.severity == "error" for p in problems):
        graph = None
        problems = explain_foreign(text.files, problems)
    return graph, _in_order(problems)


def _check_graph(graph: Graph, names: Names) -> list[Diagnostic]:
    """Check the graph, as far as broken items leave something that can be relied on."""
    if not names.broken:
        return check_graph(graph)
    # A broken item may be the way on which a parameter comes.
    unreliable = names.assigned_in_broken | set(graph.parameters)
    return [
        *check_parameters(graph, unreliable),
        *([] if graph.axiom_block is None else check_setting_parameters(graph)),
        *check_sheets(graph),
        *check_constant_selections(graph),
    ]


def _in_order(problems: list[Diagnostic]) -> list[Diagnostic]:
    """Sort by file and place, drop repetitions, and keep the number within reason."""
    files: dict[str, int] = {}
    unique: dict[tuple[object, ...], Diagnostic] = {}
    for p in problems:
        place = (p.span.source.name, p.span.start) if p.span else ("", 0)
        files.setdefault(place[0], len(files))
        unique.setdefault((p.code, p.message, *place), p)
    ordered = sorted(
        unique.values(),
        key=lambda p: (files[p.span.source.name], p.span.start) if p.span else (len(files), 0),
    )
    if len(ordered) <= MAX_ERRORS:
        return ordered
    more = len(ordered) - MAX_ERRORS
    return [*ordered[:MAX_ERRORS], diagnose("too-many-errors", f"{more} more mistakes")]
