"""Every kind of mistake that a diagnostic can name, by its stable code.

The reference page ``docs/errors.md`` is made from this table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from pcsg.errors import Diagnostic, SourceSpan


class Stage(Enum):
    """Where a mistake is found, in the order in which a file is read."""

    FILES = "Reading files"
    MACROS = "Macros"
    SYNTAX = "Syntax"
    NAMES = "Names and arguments"
    SETTINGS = "Scene settings"
    GRAPH = "The whole grammar"
    RUN = "While the graph is walked"


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake.

    Attributes
    ----------
    code
        Its stable name.
    explanation
        What it means and what helps, for the reference page.
    severity
        ``error`` or ``warning``.
    """

    code: str
    stage: Stage
    explanation: str
    severity: str = "error"


_F, _M, _S, _N, _T, _G, _R = Stage

CATALOGUE: dict[str, Mistake] = {
    mistake.code: mistake
    for mistake in (
        Mistake(
            "file-missing",
            _F,
            "The file is not there, is a folder or no ordinary file, or cannot be read.",
        ),
        Mistake(
            "file-too-large",
            _F,
            "Grammars are small; a file above 16 MB, or of more than 1,700,000 words, numbers and "
            "signs, is not one. The brackets and commas of `move(1,-2,3)` do not count.",
        ),
        Mistake("not-utf8", _F, "Grammars are UTF-8 text. The caret stands at the first bad byte."),
        Mistake(
            "include-missing",
            _F,
            "The file that `#include` names cannot be read, or its name does not end in `.pcsg`.",
        ),
        Mistake(
            "include-outside",
            _F,
            "`#include` may not leave the folder of the root file unless `--include DIR` allows "
            "another folder.",
        ),
        Mistake(
            "file-mended",
            _F,
            "Something in a file that a primitive names was left out or mended: attributes that "
            "are no numbers, corners that differ by rounding, facets that were inside out. The "
            "rest is used.",
            "warning",
        ),
        Mistake(
            "file-outside",
            _F,
            "What holds for `#include` holds for every file that a grammar names: models, meshes, "
            "species, textures and skies lie in the folder of the root file or below, or where "
            "`--include DIR` allows it; links count for where they lead.",
        ),
        Mistake(
            "bad-file",
            _F,
            "A file that a primitive names is not there, is damaged, or is of a kind that is not "
            "supported.",
        ),
        Mistake(
            "bad-species",
            _F,
            "A file of a growing tree is JSON with the keys and ranges of `docs/growth.md`.",
        ),
        Mistake(
            "bad-lsystem",
            _F,
            "A line of an L-system is not understood: rules, modules and settings are told in "
            "`docs/lsystems.md`.",
        ),
        Mistake(
            "odd-lsystem",
            _F,
            "A line of an L-system can be read in two ways, or says again what was said.",
            "warning",
        ),
        Mistake("include-cyclic", _F, "A file includes itself, directly or through others."),
        Mistake("bad-directive", _F, "There are two directives: `#define` and `#include`."),
        Mistake("macro-redefined", _M, "A macro has one definition in the whole set of files."),
        Mistake("macro-empty", _M, "A macro needs a body, on its line or as a brace block."),
        Mistake("macro-cyclic", _M, "The body of a macro leads back to the macro itself."),
        Mistake("macro-function", _M, "Macros take no arguments; use parameters or a definition."),
        Mistake(
            "macro-too-large", _M, "Macros within macros grow beyond 300,000 tokens or 64 levels."
        ),
        Mistake("stray-character", _S, "A character that means nothing in the language."),
        Mistake(
            "bad-number", _S, "Numbers are decimal, as `2`, `0.5`, `.5` or `1e-3`, and finite."
        ),
        Mistake("unbalanced-bracket", _S, "A bracket without its partner."),
        Mistake("unexpected-end", _S, "An item, a text or a comment ends before it is complete."),
        Mistake("unexpected-token", _S, "Something stands where something else must."),
        Mistake(
            "reserved-name",
            _S,
            "Names of transformations, attributes and primitives, and the words "
            "`else and or not pi e true false` cannot name anything else.",
        ),
        Mistake(
            "foreign-spelling",
            _S,
            "Something is written as in another language: EisenScript, Context Free, POV-Ray, "
            "OpenSCAD, C. The message says how it is written here.",
        ),
        Mistake("chained-comparison", _S, "Comparisons do not chain: write `a < b and b < c`."),
        Mistake("needs-parentheses", _S, "`not` behind a tighter operator needs parentheses."),
        Mistake("unknown-primitive", _N, "No primitive, definition or module has this name."),
        Mistake("unknown-transformation", _N, "No transformation or attribute has this name."),
        Mistake("unknown-function", _N, "No function of the arithmetic has this name."),
        Mistake("unknown-module", _N, "A name written like a module, but nothing has this name."),
        Mistake("undefined-module", _N, "The module has a selection function but no rules."),
        Mistake("wrong-arguments", _N, "A wrong number of arguments."),
        Mistake(
            "not-callable",
            _N,
            "Only primitives and modules in the attributed form take arguments; other modules "
            "read parameters, which a block assigns.",
        ),
        Mistake(
            "outside-blob", _N, "Sums and other operators on fields stand in `blob { ... }` only."
        ),
        Mistake(
            "not-a-field",
            _N,
            "In `blob { ... }` stand fields: `point`, `segment`, `cone`, `disc`, `box`, "
            "`convolution`, and modules and definitions that are made of them.",
        ),
        Mistake(
            "world-in-blob",
            _N,
            "A blob has no place in the world of its own: `worldx`, `wdirx`, `localx` and the like "
            "stand before it, in a block.",
        ),
        Mistake("duplicate-name", _N, "Modules and definitions share one name space."),
        Mistake("duplicate-rule", _N, "A module has one rule of each number; labels are unique."),
        Mistake("missing-rule", _N, "The rules of a module are numbered 1, 2, 3... without a gap."),
        Mistake(
            "no-selection-function",
            _N,
            "A module with several rules needs a function that selects one of them.",
        ),
        Mistake(
            "mixed-forms",
            _N,
            "A module is written with numbered rules and a selection function, or in the "
            "attributed form, not both.",
        ),
        Mistake("formals-differ", _N, "All rules of a module name the same formals, each once."),
        Mistake(
            "missing-condition", _N, "Only the last rule of a module may do without a condition."
        ),
        Mistake(
            "definition-cycle", _N, "A definition leads back to itself without passing a module."
        ),
        Mistake("no-axiom", _N, "The grammar has no expression to begin with."),
        Mistake("two-axioms", _N, "A grammar begins with exactly one axiom."),
        Mistake("unknown-setting", _T, "No scene setting has this name."),
        Mistake("unknown-key", _T, "The setting has no such key."),
        Mistake("duplicate-setting", _T, "The setting, its name or its key is given twice."),
        Mistake("setting-name", _T, "Materials and textures have a name, other settings have not."),
        Mistake("bad-value", _T, "The value is not of the kind that the key takes."),
        Mistake("unknown-material", _T, "No material has this name."),
        Mistake("unknown-texture", _T, "No texture has this name."),
        Mistake("unknown-palette", _T, "No palette has this name."),
        Mistake(
            "parameter-never-assigned",
            _G,
            "No path from the axiom to this place assigns the parameter. What a block assigns is "
            "seen by what stands behind it only.",
        ),
        Mistake(
            "sheet-subtracted",
            _G,
            "A sheet has no volume, so nothing can be subtracted with it, also not through modules "
            "and definitions.",
        ),
        Mistake(
            "no-terminating-rule",
            _G,
            "Whatever rules are chosen, the module leads back to itself.",
        ),
        Mistake(
            "endless-cycle",
            _G,
            "A cycle on which nothing changes that a selection function reads: once entered, it "
            "never ends.",
        ),
        Mistake(
            "colour-range",
            _G,
            "The parts of a surface's colour are shares of the light, from 0 to 1 and linear; 0 to "
            "255 is how pictures keep them. Lights may be brighter.",
            "warning",
        ),
        Mistake(
            "selection-range",
            _R,
            "The rounded value of a selection function must be the number of a rule.",
        ),
        Mistake(
            "unassigned-parameter",
            _R,
            "The parameter is assigned on other paths from the axiom, but not on this one.",
        ),
        Mistake("not-finite", _R, "A result is NaN or infinite."),
        Mistake("singular-matrix", _R, "A transformation flattens space and has no inverse."),
        Mistake("bad-argument", _R, "An argument of a primitive is outside its legal range."),
        Mistake("depth-limit", _R, "More modules on one path than the depth limit allows."),
        Mistake(
            "long-ray",
            _R,
            "Some rays, such as those that begin on a surface, look at all modules along them, one "
            "after the other. For this one they are more than 10 million.",
        ),
        Mistake(
            "too-many-models",
            _R,
            "A primitive with data is another model for every set of values that its parameters "
            "take: at most 64 in a scene, and 2 GB. A parameter that takes endlessly many values "
            "must be rounded.",
        ),
        Mistake("memory-budget", _R, "The states need more memory than `--max-memory` allows."),
        Mistake("too-many-errors", _S, "Only the first hundred mistakes are shown."),
        Mistake(
            "never-used", _N, "The axiom does not lead to this module or definition.", "warning"
        ),
    )
}


def diagnose(
    code: str,
    message: str,
    span: SourceSpan | None = None,
    *,
    expected: str | None = None,
    hint: str | None = None,
    notes: Sequence[tuple[str, SourceSpan | None]] = (),
) -> Diagnostic:
    """Return a diagnostic of a kind in the catalogue; see `Diagnostic` for the parameters."""
    severity = CATALOGUE[code].severity
    return Diagnostic(code, message, span, expected, hint, tuple(notes), severity)
