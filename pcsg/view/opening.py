"""From a file to a scene with its stage, and what a page is told about it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pcsg.errors import Diagnostic, EvaluationFault, GrammarError, PcsgError
from pcsg.grammar import check_file
from pcsg.graph.evaluate import axiom_values
from pcsg.graph.expr import parameters_of
from pcsg.graph.graph import Graph, expressions
from pcsg.graph.settings import FileName
from pcsg.jit import is_cached
from pcsg.render.camera import Camera
from pcsg.render.stage import Overrides, Stage, build_stage
from pcsg.scene import Scene
from pcsg.view.growing import describe_growth
from pcsg.view.wants import Want


@dataclass(frozen=True)
class Opened:
    """A grammar that could be read.

    Attributes
    ----------
    warnings
        What is odd about it.
    files
        Names of all files that were read.
    """

    graph: Graph
    warnings: tuple[Diagnostic, ...]
    files: tuple[str, ...]


@dataclass(frozen=True)
class Limits:
    """What a scene may take: see `pcsg.Scene`."""

    threads: int | None = None
    max_memory: int | None = None
    block_memory: int | None = None
    engine: str = "auto"
    include: tuple[str, ...] = ()


def open_grammar(path: Path, include: Sequence[str]) -> Opened:
    """Return the grammar of a file.

    Raises
    ------
    GrammarError
        With everything that is wrong with it.
    """
    graph, problems = check_file(path, include=include)
    if graph is None:
        raise GrammarError(problems)
    return Opened(graph, tuple(problems), (str(path), *sorted(_files_of(graph))))


def files_in(diagnostics: Iterable[Diagnostic]) -> set[str]:
    """Return the files that diagnostics show."""
    return {d.span.source.name for d in diagnostics if d.span is not None}


def _files_of(graph: Graph) -> set[str]:
    """Return the files that are named by a graph: included ones, and those of its settings."""
    spans = [item.span for item in (*graph.nodes, *graph.settings) if item.span is not None]
    found = {span.source.name for span in spans}
    for setting in graph.settings:
        found |= {str(v.path) for v in setting.values.values() if isinstance(v, FileName)}
    return found


class Prepared:
    """A scene that can be pictured from anywhere.

    Parameters
    ----------
    opened
        Its grammar.
    scene
        The scene.
    stage
        Its stage, as its own camera sees it.
    values
        That were given to its parameters.
    size
        Of the picture for which that camera was placed, if it is an automatic one.
    """

    def __init__(
        self,
        opened: Opened,
        scene: Scene,
        stage: Stage,
        values: Mapping[str, float],
        size: tuple[int, int],
    ) -> None:
        self.opened, self.scene, self.values = opened, scene, dict(values)
        self._stage = stage
        self._homes = {size: stage.camera}

    @classmethod
    def make(
        cls,
        opened: Opened,
        values: Mapping[str, float],
        limits: Limits,
        size: tuple[int, int],
        tell_compiling: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Prepare the scene of a grammar.

        Parameters
        ----------
        tell_compiling
            Called where kernels have to be compiled first.

        Raises
        ------
        PcsgError
            There is no picture for these values.
        """
        scene = Scene(
            opened.graph,
            values,
            engine=limits.engine,  # type: ignore[arg-type]  # Scene checks it
            threads=limits.threads,
            max_memory=limits.max_memory,
            block_memory=limits.block_memory,
        )
        if not is_cached(scene.tracer.kernel):
            tell_compiling()
        return cls(opened, scene, build_stage(scene, size, {}), values, size)

    @classmethod
    def of(cls, opened: Opened, scene: Scene, size: tuple[int, int] = (600, 450)) -> Prepared:
        """Return a scene that is there already."""
        return cls(opened, scene, build_stage(scene, size, {}), {}, size)

    def stage_for(self, want: Want) -> Stage:
        """Return the stage as a page wants to see it."""
        if "eye" in want.camera and "target" in want.camera:
            camera = replace(self._stage.camera, **want.camera)
        else:
            camera = self._home(want.size)
        return replace(self._stage, camera=camera, mode=want.mode or self._stage.mode)

    def _home(self, size: tuple[int, int]) -> Camera:
        """Return the grammar's camera, or the automatic one, for a picture of a size."""
        if size not in self._homes:
            self._homes[size] = build_stage(self.scene, size, {}).camera
        return self._homes[size]

    def describe(self) -> dict[str, Any]:
        """Return what a page shows of the scene besides its picture."""
        bounds = self.scene.bounds
        return {
            "parameters": self.scene.parameters,
            "own": self._own_values(),
            "reads": [name for name in ("SEED", "TIME") if name in _read_by(self.opened.graph)],
            "bounds": bounds.tolist() if np.isfinite(bounds).all() else None,
            "mode": self._stage.mode,
            "ground": self._stage.ground,
            **(describe_growth(Path(self.opened.files[0])) if self.opened.files else {}),
            "warnings": [describe_diagnostic(d) for d in self._all_warnings()],
        }

    def _own_values(self) -> dict[str, float]:
        """Return the values that the grammar gives its parameters by itself."""
        found = axiom_values(self.opened.graph, {})
        return {name: found[name] for name in self.scene.parameters if name in found}

    def _all_warnings(self) -> Iterable[Diagnostic]:
        told = dict.fromkeys(d.render() for d in self.opened.warnings)
        return [*self.opened.warnings, *(d for d in self.scene.warnings if d.render() not in told)]


def _read_by(graph: Graph) -> set[str]:
    """Return the names of parameters that anything in a graph reads."""
    found = parameters_of(*(e for node in graph.nodes for e in expressions(node)))
    written = (v for s in graph.settings for v in s.values.values() if not isinstance(v, str))
    return set(found) | set(parameters_of(*(e for values in written for e in values)))


def overrides_of(camera: Mapping[str, Any], mode: str | None) -> Overrides:
    """Return the settings that take the place of the grammar's."""
    found: dict[str, Mapping[str, Any]] = {}
    if camera:
        found["camera"] = dict(camera)
    if mode is not None:
        found["film"] = {"mode": mode}
    return found


def describe_error(error: BaseException) -> list[dict[str, Any]]:
    """Return what went wrong as a page shows it: one entry for each mistake."""
    if isinstance(error, GrammarError):
        return [describe_diagnostic(d) for d in error.diagnostics]
    if isinstance(error, EvaluationFault):
        return [describe_diagnostic(error.diagnostic)]
    if isinstance(error, PcsgError):
        return [_plain(str(error))]
    if isinstance(error, MemoryError):
        return [_plain("the scene does not fit into memory; a lower order helps")]
    if isinstance(error, RecursionError):
        return [_plain("the text is nested too deeply")]
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return [_plain(f"{place}{error.strerror or error}")]
    return [_plain(f"this is a mistake in pcsg itself ({type(error).__name__}: {error})")]


def describe_diagnostic(diagnostic: Diagnostic) -> dict[str, Any]:
    """Return a diagnostic for a page: its parts, and its text as a terminal shows it."""
    return {**diagnostic.to_json(), "text": str(GrammarError([diagnostic]))}


def _plain(text: str) -> dict[str, Any]:
    return {"severity": "error", "message": text, "line": None, "text": f"error: {text}"}
