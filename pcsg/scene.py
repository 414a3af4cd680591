"""A scene: a grammar with values, ready for rays and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcsg import arguments
from pcsg.collector import collector_at_rest
from pcsg.errors import GrammarError, UsageError
from pcsg.graph.bounds import HyperBoxes
from pcsg.graph.derivation import Derivation, find_derivation
from pcsg.graph.digest import digest_of
from pcsg.graph.evaluate import axiom_values, setting_defaults, setting_values, unit
from pcsg.graph.graph import GLOBALS, Graph
from pcsg.graph.nodes import Combinable, Leaf, as_node
from pcsg.graph.states import StateGraph
from pcsg.graph.stats import Census, graph_stats, take_census
from pcsg.graph.text import to_pcsg
from pcsg.graph.validate import check_graph
from pcsg.trace.choice import EngineChoice, Limits
from pcsg.trace.hits import Crossings, Hits, Spans
from pcsg.trace.measures import Key, Measured, Quantity, Samples
from pcsg.trace.periodic import PeriodicScene, as_cell
from pcsg.trace.rays import check_rays
from pcsg.trace.tracer import Engine, StatesTracer
from pcsg.trace.walker import Walker
from pcsg.vec import Vec3

if TYPE_CHECKING:
    from pcsg.graph.leaves import Leaves
    from pcsg.trace.expand.expansion import Expansion
    from pcsg.treemesh.segments import Assembled


def load(
    path: str | Path,
    *,
    include: Sequence[str | Path] = (),
    parameters: Mapping[str, float] | None = None,
    engine: Engine = "auto",
    threads: int | None = None,
    max_memory: int | None = None,
    block_memory: int | None = None,
    **more: float,
) -> Scene:
    """Return the scene of a grammar file.

    Parameters
    ----------
    include
        Folders beside the file's own whose files the grammar may name.
    parameters, **more
        Values in place of those that the axiom assigns; SEED and TIME.
    engine, threads, max_memory, block_memory
        As for `Scene`.

    Raises
    ------
    GrammarError
        With everything that is wrong with the file.
    UsageError
        A parameter is not the axiom's.
    EnvironmentFault
        The file cannot be read.
    """
    from pcsg.grammar import load_file

    graph = load_file(arguments.path(path, "path"), include=_folders(include))
    values = {**arguments.numbers(parameters, "parameters"), **more}
    return Scene(
        graph,
        values,
        engine=engine,
        threads=threads,
        max_memory=max_memory,
        block_memory=block_memory,
    )


def loads(
    text: str,
    *,
    name: str = "<text>",
    include: Sequence[str | Path] = (),
    parameters: Mapping[str, float] | None = None,
    engine: Engine = "auto",
    threads: int | None = None,
    max_memory: int | None = None,
    block_memory: int | None = None,
    **more: float,
) -> Scene:
    """Return the scene of a grammar in a string; arguments as for `load`.

    Names of files are relative to the working directory, and lie in it or in ``include``.
    """
    from pcsg.grammar import load_text

    graph = load_text(
        arguments.text(text, "text"), name=arguments.text(name, "name"), include=_folders(include)
    )
    values = {**arguments.numbers(parameters, "parameters"), **more}
    return Scene(
        graph,
        values,
        engine=engine,
        threads=threads,
        max_memory=max_memory,
        block_memory=block_memory,
    )


class Scene:
    """A grammar with values.

    Parameters
    ----------
    solid
        A graph, or a solid built in Python.
    parameters
        Values in place of those that the axiom assigns; SEED and TIME.
    engine
        Who answers rays: ``cyclic`` walks the graph itself, ``states`` its unrolled states; where
        they are too many, those that memory has no room for are made on demand. ``auto`` takes the
        states where it can. The answers are the same.
    threads
        Most threads of one call; by default one for each processor. Results do not depend on it.
    max_memory
        Bytes that rays may use for their work; by default half of the machine's.
    block_memory
        Bytes for states where they are many. By default all of them are prepared where 512 MB
        suffice, else as many as fit into 16 MB, and the others while rays are traced. More is
        faster; the answers are the same.

    Raises
    ------
    GrammarError
        The graph cannot terminate, or a fault was found among its states.
    UsageError
        A parameter is not the axiom's.
    """

    def __init__(
        self,
        solid: Graph | Combinable,
        parameters: Mapping[str, float] | None = None,
        *,
        engine: Engine = "auto",
        threads: int | None = None,
        max_memory: int | None = None,
        block_memory: int | None = None,
    ) -> None:
        graph = solid if isinstance(solid, Graph) else Graph(as_node(solid))
        given = arguments.numbers(parameters, "parameters")
        values: dict[str, float] = {n: given.pop(n) for n in ("SEED", "TIME") if n in given}
        if not isinstance(engine, str) or engine not in get_args(Engine):
            known = ", ".join(get_args(Engine))
            raise UsageError(f"unknown engine {arguments.shown(engine)}; one of {known}")
        self._limits = Limits(
            None if threads is None else arguments.whole(threads, "threads", 1),
            _bytes(max_memory, "max_memory"),
            _bytes(block_memory, "block_memory"),
        )
        self.graph = graph.override(given)
        with collector_at_rest():
            self._prepare(engine, values)

    def _prepare(self, engine: Engine, values: Mapping[str, float]) -> None:
        """Check the graph and find its states, as far as they are wanted beforehand."""
        problems = check_graph(self.graph)
        errors = [d for d in problems if d.severity == "error"]
        if errors:
            raise GrammarError(errors)
        self.warnings = tuple(problems)
        """What was left out of files or mended in them, as diagnostics."""
        sun = self._sun({**GLOBALS, **values})
        self.values: dict[str, float] = {**GLOBALS, **values, **sun}
        """Values of the global parameters."""
        self._asked = engine
        self._choice = EngineChoice(self.graph, self.values, engine, self._limits)
        self.engine = self._choice.name
        """The engine in use."""

    def _sun(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the direction towards the sun as the parameters SUNX, SUNY, SUNZ."""
        written = setting_values(self.graph, "sun", axiom_values(self.graph, values))
        values_of_sun = written[0] if written else setting_defaults("sun")
        x, y, z = unit(values_of_sun["direction"])
        return {"SUNX": x, "SUNY": y, "SUNZ": z}

    @property
    def states(self) -> StateGraph:
        """The graph unrolled over its states, as far as the budget goes."""
        return self._choice.states

    @property
    def boxes(self) -> HyperBoxes:
        """Hyper-bounding boxes of the nodes."""
        return self._choice.boxes

    @property
    def tracer(self) -> Walker | StatesTracer:
        """Who answers the rays."""
        return self._choice.tracer

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Values of the axiom's parameters, with SEED and TIME."""
        values = axiom_values(self.graph, self.values)
        return {name: x for name, x in values.items() if not name.startswith("SUN")}

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Corners of the box about the bounded parts, float64 (2, 3); +inf, -inf if empty."""
        if self._choice.packed is not None:
            return self._choice.packed.bounded
        box = self.boxes.scene_box
        return np.array([box.lower, box.upper])

    @cached_property
    def source_hash(self) -> str:
        """Digest of the grammar with its overrides, in hexadecimal."""
        return digest_of(self.graph)

    @cached_property
    def sheets(self) -> NDArray[np.bool_]:
        """Which nodes of the graph are sheets, bool (nodes,): leaves without an inside."""
        return np.array([isinstance(n, Leaf) and n.is_sheet for n in self.graph.nodes])

    def limbs(self, limit: int = 1_000_000) -> Assembled:
        """Return the skeleton that the scene's cylinders and cones make, and notes.

        What a difference or an intersection carves is no limb.

        Parameters
        ----------
        limit
            Most primitives that are expanded.

        Raises
        ------
        UsageError
            The scene has more primitives, or no cylinder or cone.
        """
        from pcsg.treemesh.segments import join_segments, segments_of, skeleton_of_segments

        arguments.whole(limit, "limit", 1)
        parts, others, count = [], 0, 0
        for leaves in self.leaves():
            count += len(leaves)
            if count > limit:
                raise UsageError(
                    f"the grammar has more than {limit:,} primitives; lower its order with -D"
                )
            some, rest = segments_of(leaves)
            parts.append(some)
            others += rest
        found = skeleton_of_segments(join_segments(parts))
        if not others:
            return found
        note = f"{others} primitives that are no plain cylinders or cones were left out"
        return found._replace(notes=(*found.notes, note))

    def leaves(self, batch: int = 10_000) -> Iterator[Leaves]:
        """Yield the primitives of the scene with their places, some at a time.

        Nothing is kept: of a scene of billions those that are asked for take no memory.

        Parameters
        ----------
        batch
            Primitives at a time.

        Raises
        ------
        UsageError
            The scene has too many states for their table: some millions.
        """
        return self._choice.reader.leaves(arguments.whole(batch, "batch", 1))

    def expand(self) -> Expansion:
        """Return the table of all states: what the scene consists of, once each.

        Raises
        ------
        UsageError
            The scene has too many states for their table: some millions.
        GrammarError
            A state contains itself.
        """
        return self._choice.reader.expand_whole()

    @overload
    def measure(self, quantity: Quantity, by: None = None) -> Measured: ...
    @overload
    def measure(self, quantity: Quantity, by: Key) -> dict[int, Measured]: ...
    def measure(self, quantity: Quantity, by: Key | None = None) -> Measured | dict[int, Measured]:
        """Integrate over all primitives without rays, however many they are.

        Counts and volumes are exact, overlaps counted as often as there are primitives. Areas are
        exact where all maps above a primitive's own state are similarities, else estimated from
        200,000 points. Of sheets one side counts; what lies inside of another solid counts, too.

        Parameters
        ----------
        quantity
            ``area``, ``volume`` (in the scene's unit of length, squared or cubed) or ``count``.
        by
            ``label``: one result for each label (-1 for none); ``leaf``: for each leaf node of the
            graph; None: one in all.

        Returns
        -------
        Measured
            ``value`` and ``se``, its standard error, 0 where it is exact; a dict of them with
            ``by``.

        Raises
        ------
        UsageError
            The scene has too many states, unbounded primitives or blobs, or (but for counts)
            differences or intersections.
        """
        if quantity not in get_args(Quantity):
            known = ", ".join(get_args(Quantity))
            raise UsageError(f"unknown quantity {arguments.shown(quantity)}; one of {known}")
        if by is not None and by not in get_args(Key):
            raise UsageError(f"`by` is {' or '.join(get_args(Key))}, not {arguments.shown(by)}")
        return self._choice.reader.measuring.measure(quantity, by)

    def sample(self, n: int, *, seed: int = 0) -> Samples:
        """Draw points on the surfaces of all primitives, uniformly by area.

        Nothing is expanded: of 10^12 leaves each is as likely as another of its size.

        Parameters
        ----------
        n
            Number of points.
        seed
            Equal seeds give equal points.

        Returns
        -------
        Samples
            ``points`` and ``normals`` (N, 3) in world coordinates, ``label`` and ``leaf`` (N,),
            and ``area`` with its standard error.

        Raises
        ------
        UsageError
            As for `measure`.
        """
        arguments.whole(n, "n", 1)
        return self._choice.reader.measuring.sample(n, arguments.whole(seed, "seed", 0))

    def setting_values(self, kind: str) -> list[dict[str, Any]]:
        """Return the settings of a kind, defaults filled in, None where automatic."""
        return setting_values(self.graph, kind, axiom_values(self.graph, self.values))

    def setting_numbers(self, kind: str) -> Mapping[str, int]:
        """Return the number of every named setting of a kind."""
        return self.graph.numbers_of(kind)

    def reach(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far what is certainly there reaches in directions (N, 3): see `find_reach`."""
        from pcsg.graph.silhouette import find_reach

        if self._choice.packed is not None:
            return np.full(len(directions), -math.inf)
        return find_reach(self._choice.states, directions)

    def shining_covers(self, strengths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return covers of all that shines, float64 (K, `COLUMNS`): see `pcsg.graph.shining`.

        There are none where the states are too many to be looked through.

        Parameters
        ----------
        strengths
            (M,) how much a surface of every material shines.
        """
        if not (strengths > 0.0).any():
            return np.empty((0, 0))
        return self._choice.reader.covers(strengths.tolist())

    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
        *,
        periodic: ArrayLike | None = None,
    ) -> Hits:
        """Find the first crossing of every ray in the closed [t_min, t_max]; exits count.

        Parameters
        ----------
        origins, directions : array_like (N, 3)
            World coordinates. Directions need not be unit; t is in their lengths.
        t_min, t_max : array_like, scalar or (N,)
        periodic : array_like (4,)
            A cell (xmin, ymin, xmax, ymax): the scene stands at all its multiples, as if it were
            copied. What overhangs is seen from the cells beside it; positions are those of the
            copy that is met. Unbounded solids must be the same in every cell. A ray ends after
            10,000 cells. Solids of neighbouring copies that overlap stay apart for rays that
            begin inside of them.

        Raises
        ------
        UsageError
            Shapes do not fit, or a ray is zero or not finite.
        EvaluationFault
            A ray met a fault of the grammar.
        """
        if periodic is not None:
            rays = check_rays(origins, directions, t_min, t_max)
            return self._repeated(periodic).intersect(rays, self.tracer.intersect)
        return self.tracer.intersect(origins, directions, t_min, t_max)

    def derivation(self, hits: Hits, i: int) -> Derivation | None:
        """Return how the grammar derives what a ray met.

        Parameters
        ----------
        hits
            What `intersect` returned.
        i
            Number of the ray.

        Returns
        -------
        Derivation or None
            Modules and rules from the axiom down, the parameters' values in the last rule, and the
            primitive's arguments. None for a miss, and where the search was given up: too much
            stands in one place, or the parts of a module all lie within its box.
        """
        arguments.whole(i, "i", 0, len(hits) - 1)
        if not hits.mask[i]:
            return None
        position = hits.position[i].copy()
        position[:2] -= getattr(hits, "shift", np.zeros((len(hits), 2)))[i]
        size = float(np.abs(position).max()) + float(hits.t[i])
        return find_derivation(
            self.graph,
            self.values,
            self.boxes.boxes,
            int(hits.leaf[i]),
            Vec3(*position.tolist()),
            Vec3(*(1e-6 * size * hits.normal[i]).tolist()),
        )

    def _repeated(self, periodic: ArrayLike) -> PeriodicScene:
        """Return who answers periodic rays."""
        cell = as_cell(periodic)
        packed = self._choice.packed
        if packed is not None:
            heights = packed.box[:, 2].tolist()
        else:
            lower, upper = self.boxes.boxes[self.graph.number[self.graph.root]].reshape(2, 3)
            heights = [lower[2], upper[2]]
        return PeriodicScene(cell, self.bounds, (heights[0], heights[1]))

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
        *,
        periodic: ArrayLike | None = None,
    ) -> NDArray[np.bool_]:
        """Find whether every ray crosses anything, bool (N,); arguments as for `intersect`."""
        if periodic is not None:
            rays = check_rays(origins, directions, t_min, t_max)
            return self._repeated(periodic).occluded(rays, self.tracer.occluded)
        return self.tracer.occluded(origins, directions, t_min, t_max)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Find whether the solid contains points (N, 3), bool (N,)."""
        return self.tracer.contains(points)

    def intersect_all(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
    ) -> Crossings:
        """Find all crossings of every ray in the closed [t_min, t_max], in their order.

        They are the ends of the stretches inside, and the sheets that the ray passes; what lies
        within another solid is no crossing. Arguments and errors as for `intersect`.

        Returns
        -------
        Crossings
            All rays' rows, one after the other, parted by ``offsets``: ``t``, ``entering``,
            ``label``, ``normal`` and the other columns of `Hits`.
        """
        return self.tracer.find_crossings(check_rays(origins, directions, t_min, t_max))

    def spans(self, origins: ArrayLike, directions: ArrayLike) -> Spans:
        """Find all inside intervals of every ray, on the whole line."""
        return self.tracer.spans(origins, directions)

    def stats(self) -> dict[str, Any]:
        """Return statistics of the scene: see `graph_stats`."""
        # The table of states is read before it is packed and goes.
        counted = self._choice.reader.count()
        packed = self._choice.packed
        if counted is None or packed is None:
            known = take_census(self.graph, self.values, self.states, self.boxes, counted)
        else:
            # Of what cuts something off without bounds only the rest's box is known.
            boxes = [n.solid.bounds for n in self.graph.nodes if isinstance(n, Leaf)]
            unbounded = any(-math.inf in b.lower or math.inf in b.upper for b in boxes)
            kind = "interval" if unbounded else "exact"
            known = Census(counted, kind, packed.box, packed.bounded, {})
        found = graph_stats(self.graph, self.values, known, self.tracer.nbytes)
        counts = {} if isinstance(self.tracer, Walker) else self.tracer.counts
        return {**found, "engine": self.engine, "blocks": None, **counts}

    def to_pcsg(self) -> str:
        """Return the scene as text of the language."""
        return to_pcsg(self.graph)

    def _repr_png_(self) -> bytes:
        """Return a small picture as PNG, which notebooks show, made in some seconds at most."""
        from pcsg.render.progressive import picture_within

        return picture_within(self)._repr_png_()

    def __reduce__(self) -> tuple[Any, ...]:
        values = {name: self.values[name] for name in ("SEED", "TIME")}
        limits = {
            "engine": self._asked,
            **self._limits._asdict(),
        }
        return _make_scene, (self.graph, values, limits)

    def __repr__(self) -> str:
        return f"<pcsg.Scene of {len(self.graph.nodes)} nodes>"


def _make_scene(graph: Graph, values: dict[str, float], limits: dict[str, Any]) -> Scene:
    return Scene(graph, values, **limits)


def _bytes(value: int | None, name: str) -> int | None:
    return None if value is None else arguments.whole(value, name, 0)


def _folders(include: Sequence[str | Path]) -> list[Path]:
    folders = arguments.listed(include, "include", "folders")
    return [arguments.path(folder, "a folder of include") for folder in folders]
