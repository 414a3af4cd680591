"""Files and directives: from a file to the tokens of the whole set of files.

Files are read and cut into tokens first, then the macros of all of them are collected, then
replaced: a macro holds before and after its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic, PcsgError, Source, SourceSpan
from pcsg.grammar.macros import Expander, Macro, line_end, take_define, usable_macros
from pcsg.grammar.reach import Reach
from pcsg.grammar.tokens import Token, join, tokenize, words
from pcsg.graph.graph import GLOBALS
from pcsg.graph.words import is_name
from pcsg.growth.leaf import is_species, species_mistakes
from pcsg.inputs import TooLargeError, read_bytes
from pcsg.skeletonfile import SKELETON_ENDINGS

MAX_BYTES = 16 * 2**20
"""A longer file is refused."""

ENDING = ".pcsg"
"""Of files that are included: a mistake in one quotes its lines, which may be of use to others."""


@dataclass
class Unit:
    """One file: its tokens without directives, and the files that it includes."""

    path: Path | None
    tokens: list[Token] = field(default_factory=list)
    includes: list[tuple[Path, SourceSpan]] = field(default_factory=list)


PLANT = """CONSTANTS material(plant) blob("NAME", SEEDNUMBERS)
"""
"""The grammar that the file of an L-system stands for: the plant that it draws; its constants are
parameters, so that ``-D steps=3`` changes them."""

SKELETON = """{junctions = 1; bend = 0} material(plant) blob("NAME", junctions, bend)
"""
"""The grammar that the file of a skeleton stands for: its tree."""

MEADOW = """material plant { roughness = 0.9; specular = 0.1 }
material meadow { color = (0.16, 0.20, 0.08); roughness = 1; specular = 0 }
ground { z = 0; material = meadow }
"""
"""What such a plant is made of, and stands on."""

GROWING = """{ t = 12.6; seed = 0; day = 0 }
( material(bark) tree_wood("NAME", t, seed, day)
| material(leaf) tree_leaves("NAME", t, seed, day) )
material bark { roughness = 0.95; specular = 0.15; relief = furrows; bump = 0.005 }
texture furrows { kind = bark; scale = 0.35 }
material leaf { roughness = 0.45; specular = 0.35; translucency = 0.5 }
material meadow { color = (0.13, 0.18, 0.06); roughness = 1; specular = 0 }
ground { z = 0; material = meadow }
sun { direction = (0.75, -0.55, 0.8); strength = 3.6; angle = 2; color = (1, 0.95, 0.86) }
sky { zenith = (0.16, 0.33, 0.66); horizon = (0.62, 0.70, 0.78) }
"""
"""The grammar that the file of a growing tree stands for: the tree at the time t, on a meadow."""


@dataclass
class Preprocessed:
    """The root file, and the tokens of every file, the root first, macros replaced.

    Attributes
    ----------
    reach
        Where files that they name may lie.
    """

    root: Source | None
    files: list[list[Token]]
    problems: list[Diagnostic]
    reach: Reach


def model_grammar(suffix: str, text: str) -> str | None:
    """Return the grammar that a file of a model stands for; None for a grammar itself."""
    if suffix == ".lsys":
        return _plant_grammar(text)
    if suffix == ".json" and is_species(text):
        return GROWING
    return SKELETON + MEADOW if suffix in SKELETON_ENDINGS else None


def _plant_grammar(text: str) -> str:
    from pcsg.blobtree.plant import numbers_of

    numbers = numbers_of(text)
    reserved = words().keys() | GLOBALS.keys()
    free = [name for name in numbers if is_name(name) and name not in reserved]
    block = "; ".join(f"{name} = {numbers[name]!r}" for name in free)
    given = "".join(f", {name if name in free else repr(x)}" for name, x in numbers.items())
    plant = PLANT.replace("CONSTANTS", f"{{{block}}}").replace("NUMBERS", given)
    return plant + MEADOW


def preprocess_file(path: Path, include: Iterable[str | Path]) -> Preprocessed:
    """Read a file and what it includes."""
    source, problems = read_source(path)
    named = None
    if source is not None:
        form = model_grammar(path.suffix, source.text)
        if form == GROWING:
            problems += species_mistakes(source.text, source.name)
        elif path.suffix == ".lsys":
            from pcsg.blobtree.plant import lsystem_mistakes

            problems += lsystem_mistakes(source.text, source.name)
        if form is not None and set('"\r\n') & set(path.name):
            message = f"the name of the model `{path}` has quotes or ends of lines"
            problems.append(diagnose("file-missing", message, hint="give it another name"))
        if form is not None:
            named = path
            text = form.replace("NAME", path.name)
            folder = str(path.parent)
            wrong = any(p.severity == "error" for p in problems)
            source = None if wrong else Source(str(path), text, folder, written=False)
    if source is None:
        return Preprocessed(None, [], problems, Reach(()))
    reach = Reach.of(path.parent, include, named)
    return _preprocess(source, path.resolve(), path.parent, reach, problems)


def preprocess_text(
    text: str, name: str, include: Iterable[str | Path], folder: Path | None = None
) -> Preprocessed:
    """Read a text and what it includes.

    Parameters
    ----------
    folder
        What paths are relative to, by default the working directory.
    """
    # A text from a file read elsewhere may begin with a byte order mark.
    source = Source(name, text.removeprefix("\ufeff"), "" if folder is None else str(folder))
    folder = folder or Path()
    return _preprocess(source, None, folder, Reach.of(folder, include), [])


def read_source(path: Path) -> tuple[Source | None, list[Diagnostic]]:
    """Return the text of a file, as far as it is text."""
    try:
        data = read_bytes(path, "grammar", MAX_BYTES)
    except TooLargeError as error:
        return None, [diagnose("file-too-large", str(error))]
    except PcsgError as error:
        return None, [diagnose("file-missing", str(error))]
    return decode_source(data, str(path), str(path.parent))


def decode_source(
    data: bytes, name: str, folder: str = ""
) -> tuple[Source | None, list[Diagnostic]]:
    """Return the text that bytes are, as far as they are text."""
    try:
        return Source(name, data.decode("utf-8-sig"), folder), []
    except UnicodeDecodeError as error:
        # Bytes before the bad one are text; their number of characters is its offset.
        start = data[: error.start].decode("utf-8-sig")
        source = Source(name, data.decode("utf-8-sig", errors="replace"))
        span = SourceSpan(source, len(start), len(start) + 1)
        bad = data[error.start]
        message = f"not UTF-8: byte {bad:#04x} at offset {error.start}"
        return None, [diagnose("not-utf8", message, span, hint="save the file as UTF-8")]


def _preprocess(
    root: Source,
    root_path: Path | None,
    folder: Path,
    reach: Reach,
    problems: list[Diagnostic],
) -> Preprocessed:
    macros: dict[str, Macro] = {}
    units: dict[Path | None, Unit] = {}
    # Files still to cut into tokens, with the folder that their includes are relative to.
    pending = [(root, root_path, folder)]
    while pending:
        source, path, folder = pending.pop(0)
        if path in units:
            continue
        unit = units[path] = Unit(path)
        tokens, found = tokenize(source)
        problems += found
        if any(p.code == "file-too-large" for p in found):
            return Preprocessed(None, [], problems, reach)
        includes: list[tuple[Token, SourceSpan]] = []
        unit.tokens = take_directives(tokens, macros, includes, problems)
        for token, span in includes:
            target = folder / token.text[1:-1]
            resolved = _find(target, span, reach, problems)
            if resolved is None:
                continue
            unit.includes.append((resolved, span))
            if resolved in units:
                continue
            text, trouble = read_source(target)
            for p in trouble:
                code = "include-missing" if p.span is None else p.code
                problems.append(diagnose(code, p.message, p.span or span, hint=p.hint))
            if text is not None:
                pending.append((text, resolved, target.parent))
    problems += _include_cycles(units)
    usable = usable_macros(macros, problems)
    expander = Expander(usable, problems)
    files = [expander.expand(unit.tokens) for unit in units.values()]
    return Preprocessed(root, files, problems, reach)


def _find(target: Path, span: SourceSpan, reach: Reach, problems: list[Diagnostic]) -> Path | None:
    """Return where an included file lies, without links; None if it may not be read."""
    found = reach.find(target)
    if found is None:
        problems.append(reach.refuse(target, span, "include-outside"))
    elif found.suffix.lower() != ENDING:
        message = f"`{target}` is no grammar: the name of one ends in {ENDING}"
        problems.append(diagnose("include-missing", message, span))
        found = None
    return found


def _include_cycles(units: Mapping[Path | None, Unit]) -> list[Diagnostic]:
    """Report every include that leads back to a file that is being included."""
    problems: list[Diagnostic] = []
    done: set[Path | None] = set()
    on_path: dict[Path | None, int] = {}
    start = next(iter(units))
    stack: list[tuple[Path | None, int]] = [(start, 0)]
    while stack:
        path, k = stack.pop()
        on_path[path] = k
        unit = units.get(path)
        includes = unit.includes if unit else []
        if k >= len(includes):
            done.add(path)
            on_path.pop(path)
            continue
        stack.append((path, k + 1))
        target, span = includes[k]
        if target in on_path:
            message = f"`{target.name}` includes itself"
            names = [p.name for p in list(on_path)[list(on_path).index(target) :] if p]
            if len(names) > 1:
                message += " through " + ", ".join(f"`{n}`" for n in names[1:])
            problems.append(diagnose("include-cyclic", message, span))
        elif target not in done:
            stack.append((target, 0))
    return problems


def take_directives(
    tokens: list[Token],
    macros: dict[str, Macro],
    includes: list[tuple[Token, SourceSpan]],
    problems: list[Diagnostic],
) -> list[Token]:
    """Collect the directives and return the tokens between them."""
    if not any(t.type == "HASH" for t in tokens):
        return tokens
    rest: list[Token] = []
    i = 0
    while i < len(tokens):
        token = tokens[i]
        if token.type != "HASH" or not token.first:
            rest.append(token)
            i += 1
            continue
        end = line_end(tokens, i)
        line = tokens[i + 1 : end]
        word = line[0].text if line else ""
        if word == "define":
            i = take_define(tokens, i, macros, problems)
            continue
        if word == "include" and len(line) == 2 and line[1].type == "STRING":
            includes.append((line[1], line[1].span))
        elif word == "include":
            span = join(token.span, tokens[end - 1].span)
            problems.append(
                diagnose("bad-directive", "`#include` needs a file", span, expected='`"file.pcsg"`')
            )
        else:
            span = join(token.span, line[0].span) if line else token.span
            problems.append(
                diagnose(
                    "bad-directive",
                    f"unknown directive `#{word}`",
                    span,
                    expected="`#define` or `#include`",
                )
            )
        i = end
    return rest
