"""Texts of L-systems: their lines, comments, rules and settings.

The text is like that of cpfg (Prusinkiewicz and Lindenmayer 1990)::

    #define steps 8
    axiom: !(0.1) A(1, 0.1)
    A(l, w) : l > 0.05 -> F(l) [ &(35) A(l*0.8, w*0.7) ] /(137.5) !(w*0.9) A(l*0.9, w*0.9)
    X < B(x) > Y : x > 1 : 0.6 -> B(x-1)
    interpretation:
    B(x) -> [+(x) L(x/4)]

A rule has a left context, a predecessor, a right context, a condition (``*`` for none) and a
probability, of which only the predecessor must be; the probability may stand behind the successor.
Modules are single characters with numbers, or words that a line ``module`` names. A line that is
indented and nothing by itself goes on with the one before.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

from pcsg.blobtree.constants import constant_called
from pcsg.blobtree.formulas import NAME, Draws, Formula, read_formula
from pcsg.blobtree.heads import (
    LABEL,
    bound_names,
    check_brackets,
    said,
    split_context,
    split_probability,
    symbols_of,
)
from pcsg.blobtree.lsystem import LRule, LSystem, Pattern, Successor
from pcsg.blobtree.lsystemtext import MOST_REMARKS, LSystemText, plain_lines, told
from pcsg.blobtree.signs import (
    blank_block_comments,
    number_signs,
    plain_digits,
    plain_signs,
    string_signs,
)
from pcsg.blobtree.strings import before_comment, cut_comment, split_at_top, split_modules
from pcsg.blobtree.turtle import COMMANDS
from pcsg.errors import UsageError, suggest

LARGEST_TEXT = 1_000_000
"""Characters of a text at most."""

MOST_CONSTANTS = 1_000
"""Definitions at most."""

MOST_PATTERNS = 60
"""Modules of a context at most."""

_ARROW = re.compile(r"-{1,2}>|={1,2}>")
_SETTING = re.compile(r"^([A-Za-z\u03c9][A-Za-z_ -]*?)\s*:(.*)$")

_SAME_AS = {
    "\u03c9": "axiom",
    "w": "axiom",
    "homomorphism": "interpretation",
    "endhomomorphism": "production",
    "endinterpretation": "production",
    "enddecomposition": "production",
}
"""What books and other programs call the axiom and sets of rules."""

_SETS = ("production", "decomposition", "interpretation")
"""Sets of rules; lines of these names begin one."""

MOST_WORDS = 1_000
"""Modules with names of several letters, at most."""

MOST_DEPTH = 100
"""How often decomposition and interpretation may be asked to go on."""

_FRAME = ("lsystem", "endlsystem")
"""Lines that other programs put about the rules."""


def read_lsystem(text: str, name: str = "<text>", seed: int = 0) -> LSystem:
    """Return the L-system of a text.

    Raises
    ------
    UsageError
        Every line that is not understood, with its number.
    """
    found = read_lines(text, seed)
    if mistakes := found.mistakes():
        raise UsageError(told(mistakes, text, name))
    return found.system


def read_lines(
    text: str, seed: int = 0, constants: Mapping[str, float] | None = None
) -> LSystemText:
    """Return what a text says, with all that is wrong.

    Parameters
    ----------
    constants
        Values in place of those of ``#define``.
    """
    return _Reader(text, Draws(seed), constants or {}).read()


class _Line(NamedTuple):
    """A rule of one of the sets, or an axiom, before its string is read; an axiom has no head."""

    number: int
    head: str | None
    body: str
    rules: str


class _Reader:
    """Reads a text twice: first its lines and heads, then the strings, by what heads know."""

    def __init__(self, text: str, draws: Draws, constants: Mapping[str, float]) -> None:
        self.text = plain_signs(plain_lines(text))
        self.draws = draws
        self.given = constants
        self.out = LSystemText(LSystem(draws=draws))
        self.lines: list[_Line] = []
        self.defined: dict[str, int] = {}
        self.known: set[str] = set(COMMANDS)
        self.uses: list[tuple[int, Formula, frozenset[str]]] = []
        self.axiom_line = 0
        self.rules = "production"
        self.words: set[str] = set()

    def read(self) -> LSystemText:
        if len(self.text) > LARGEST_TEXT:
            self.out.complain(0, f"the text is longer than {LARGEST_TEXT:,} characters")
            return self.out
        lines, open_line = blank_block_comments(self.text)
        if open_line is not None:
            self.out.complain(open_line, "the comment `/*` never ends")
        for number, line in _whole_lines(lines):
            self._attempt(number, self._sort, number, line)
        self.known |= self.words
        for _, head, _, _ in self.lines:
            if head is not None:
                self.known |= symbols_of(head, self.words)
        for line_ in self.lines:
            self._attempt(line_.number, self._read_string, line_)
        if not self.axiom_line:
            self.out.complain(0, "there is no line `axiom: ...`")
        self._check_names()
        return self.out

    def _attempt(self, number: int, read: Callable[..., None], *args: object) -> None:
        try:
            read(*args)
        except UsageError as error:
            self.out.complain(number, str(error))

    # -- lines -----------------------------------------------------------------------------------

    def _sort(self, number: int, line: str) -> None:
        """Find out what kind of line it is."""
        plain = before_comment(line)
        if line.startswith("#"):
            self._define(number, plain)
            return
        word = line.split(None, 1)[0].lower().rstrip(":")
        if word in _FRAME and not _ARROW.search(plain):
            return
        if plain.strip().lower().rstrip(": ") == word and _SAME_AS.get(word, word) in _SETS:
            self.rules = _SAME_AS.get(word, word)
            return
        if word == "module" and not _ARROW.search(plain):
            self._name(plain.partition(" ")[2])
            return
        setting = _SETTING.match(line)
        if setting and not _ARROW.search(plain):
            self._set(number, setting[1].strip(), setting[2])
            return
        arrow = re.search(r"-{1,2}>", line) or _ARROW.search(line)
        if not arrow:
            raise UsageError("expected a rule, `#define`, or a line `name: value`")
        self.lines.append(_Line(number, line[: arrow.start()], line[arrow.end() :], self.rules))

    def _name(self, text: str) -> None:
        """Take down names of modules; numbers behind them only tell how many there are."""
        for part in split_at_top(text.replace(":", " ").strip(" ;"), ","):
            for word in re.sub(r"\(.*?\)", " ", part).split():
                if not NAME.fullmatch(word):
                    raise UsageError(f"`{word[:40]}` is no name of a module")
                self.words |= {word} if len(word) > 1 else set()
        if len(self.words) > MOST_WORDS:
            raise UsageError(f"there are more than {MOST_WORDS:,} names of modules")

    def _deepen(self, value: str) -> None:
        """Say how often the rules of the present set apply to what they have made."""
        depth = int(value) if value.isdecimal() and len(value) < 9 else -1
        if not 1 <= depth <= MOST_DEPTH or self.rules == "production":
            raise UsageError(
                f"`maximum depth:` takes a whole number from 1 to {MOST_DEPTH}, and stands behind "
                "`interpretation:` or `decomposition:`"
            )
        self.out.system.depths[self.rules] = depth

    def _define(self, number: int, line: str) -> None:
        parts = line.split(None, 2)
        if parts[0] != "#define":
            raise UsageError(f"`{parts[0][:40]}`: the only directive is `#define name value`")
        if len(parts) != 3:
            raise UsageError("write `#define name value`")
        name = parts[1]
        if not NAME.fullmatch(name):
            raise UsageError(f"`{name[:40]}` is no name: names are made of letters, digits and _")
        system = self.out.system
        if name in system.definitions:
            self.out.complain(number, f"`{name}` is defined again", "warning")
        elif len(system.definitions) >= MOST_CONSTANTS:
            raise UsageError(f"there are more than {MOST_CONSTANTS:,} definitions")
        formula = self._formula(parts[2])
        for used in _missing(formula, system.constants):
            raise UsageError(f"`{used}` has no value in `{formula.shown}`{_hint(used, system)}")
        system.definitions[name] = formula
        self.defined[name] = number
        if name in self.given:
            system.constants[name] = self.given[name]
            return
        try:
            system.constants[name] = formula.compute(system.constants)
        except (ArithmeticError, ValueError) as error:
            raise UsageError(f"`{name}` cannot be computed: {error}") from None
        if not abs(system.constants[name]) < 1e308:
            raise UsageError(f"`{name}` cannot be computed: it is too large")

    def _set(self, number: int, written: str, value: str) -> None:
        name = written.lower()
        name = _SAME_AS.get(name, name)
        if name == "axiom":
            if self.axiom_line:
                raise UsageError(f"a second axiom; the first is in line {self.axiom_line}")
            self.axiom_line = number
            self.lines.append(_Line(number, None, value, ""))
            return
        value = before_comment(value).strip()
        if name == "maximum depth":
            self._deepen(value)
            return
        system = self.out.system
        if name == "ignore":
            system.ignored = frozenset(string_signs(value)) - set(" []")
        elif name == "derivation length":
            self._define(number, f"#define steps {value}")
        else:
            if name in self.out.settings:
                self.out.complain(number, f"`{name}:` is set again", "warning")
            self.out.settings[name] = value, number

    # -- strings of modules ----------------------------------------------------------------------

    def _read_string(self, line: _Line) -> None:
        if line.head is None:
            successor, _ = self._successor(line.number, self._cut(line), frozenset())
            self.out.system.axiom = successor
        else:
            rule = self._rule(line.number, LABEL.sub("", plain_digits(line.head)), self._cut(line))
            self._keep(rule, line.rules)

    def _keep(self, rule: LRule, rules: str) -> None:
        system = self.out.system
        if rules == "production":
            system.rules.append(rule)
        elif rule.left or rule.right:
            raise UsageError(f"rules behind `{rules}:` have no contexts")
        elif rules == "decomposition":
            system.decomposition.append(rule)
        else:
            system.interpretation.append(rule)

    def _cut(self, line: _Line) -> str:
        """Return the string of a line without its comment."""
        text, doubt = cut_comment(line.body, self.known)
        if doubt:
            self.out.complain(line.number, doubt, "warning")
        return string_signs(text).strip()

    def _successor(
        self, number: int, text: str, names: frozenset[str]
    ) -> tuple[Successor, list[Formula]]:
        """Return a string of modules, and all formulas in it."""
        found: list[tuple[str, tuple[Formula, ...]]] = []
        for symbol, args in split_modules(text, self.words):
            if symbol not in self.known and not symbol.isalpha():
                hint = "; a comment stands on a line of its own" if symbol in "#;" else ""
                raise UsageError(
                    f"`{symbol}` is no letter, no command of the turtle, and no rule names it{hint}"
                )
            found.append((symbol, tuple(self._formula(arg) for arg in args)))
        formulas = [formula for _, args in found for formula in args]
        self.uses += [(number, formula, names) for formula in formulas]
        return tuple((s, tuple(f.compute for f in args)) for s, args in found), formulas

    def _formula(self, text: str) -> Formula:
        return read_formula(number_signs(text), self.draws)

    def _rule(self, number: int, head: str, body: str) -> LRule:
        fields = head.split(":")
        if len(fields) > 3:
            raise UsageError("a rule has a predecessor, a condition and a probability at most")
        left_text, middle, right_text = split_context(string_signs(fields[0]))
        left, right = self._patterns(left_text), self._patterns(right_text)
        predecessors = self._patterns(middle)
        if len(predecessors) != 1:
            raise UsageError("a rule rewrites exactly one module")
        if predecessors[0].symbol in "[]" or any(p.symbol in "[]" for p in left):
            raise UsageError("brackets stand in right contexts and in what a rule makes only")
        check_brackets(right)
        names = bound_names([*left, *predecessors, *right])
        condition, chance = (said(fields, k) for k in (1, 2))
        body, trailing = split_probability(body)
        texts = (condition, chance, trailing)
        condition_of, chance_of, trailing_of = (self._formula(t) if t else None for t in texts)
        if condition_of and condition_of.number is not None and not chance_of and not trailing_of:
            # A number alone decides nothing as a condition: other programs write chances there.
            condition_of, chance_of = None, condition_of
        if chance_of and trailing_of:
            raise UsageError("the rule has two probabilities, before and behind the arrow")
        chance_of = chance_of or trailing_of
        asked = [formula for formula in (condition_of, chance_of) if formula]
        if chance_of and chance_of.number is not None and chance_of.number < 0.0:
            raise UsageError(f"a probability is 0 or more, not {chance_of.number:g}")
        self.uses += [(number, formula, names) for formula in asked]
        successor, formulas = self._successor(number, "" if body == "*" else body, names)
        return LRule(
            left,
            predecessors[0],
            right,
            condition_of.compute if condition_of else None,
            chance_of.compute if chance_of else None,
            successor,
            number,
            any(formula.random for formula in [*formulas, *asked]),
            1 + sum(formula.size for formula in [*formulas, *asked]) // 4,
        )

    def _patterns(self, text: str) -> tuple[Pattern, ...]:
        modules = split_modules(text, self.words)
        found = tuple(self._pattern(symbol, args) for symbol, args in modules)
        if len(found) > MOST_PATTERNS:
            raise UsageError(f"a context has {MOST_PATTERNS} modules at most")
        return found

    def _pattern(self, symbol: str, args: list[str]) -> Pattern:
        """Return a pattern; what is no name is a value that the number must have."""
        if args == [""]:
            args = []
        names, tests = [], []
        for k, text in enumerate(arg.strip() for arg in args):
            if NAME.fullmatch(text):
                names.append(text)
                continue
            formula = self._formula(text)
            if _missing(formula, self.out.system.constants) or formula.random:
                raise UsageError(
                    f"`{text}` in the head of a rule is neither a name nor a number; a condition "
                    "stands behind `:`"
                )
            names.append(f" {k}")  # a name that no formula can read
            tests.append((k, formula.compute))
        return Pattern(symbol, tuple(names), tuple(tests))

    def _check_names(self) -> None:
        """Complain of names without a value, once all constants are known, and of odd ones."""
        self._check_constants()
        seen: set[tuple[int, str]] = set()
        system = self.out.system
        for number, formula, names in self.uses:
            for used in _missing(formula, system.constants, names):
                if (number, used) not in seen and len(seen) < MOST_REMARKS:
                    seen.add((number, used))
                    hint = _hint(used, system, names)
                    self.out.complain(number, f"`{used}` has no value in `{formula.shown}`{hint}")

    def _check_constants(self) -> None:
        """Warn of constants that nothing reads, named as other programs call one that we read."""
        system = self.out.system
        read = {n for formula in system.definitions.values() for n in formula.names}
        read |= {n for _, formula, _ in self.uses for n in formula.names}
        for name in system.definitions.keys() - read:
            ours = constant_called(name)
            if ours and ours not in system.definitions:
                line = self.defined[name]
                self.out.complain(line, f"nothing reads `{name}`; is it `{ours}`?", "warning")


def _whole_lines(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Return lines with their numbers; those that go on with the one before are joined to it."""
    number, whole = 0, ""
    for at, line in enumerate(lines, 1):
        text = line.strip()
        if not text:
            continue
        alone = text[0] == "#" or _SETTING.match(text) or _ARROW.search(text)
        # Behind two slashes there may be a comment, and nothing goes on with one.
        goes_on = (line[0].isspace() or whole.endswith(chr(92))) and "//" not in whole
        if whole and goes_on and not alone and not text.startswith("module"):
            whole = f"{whole.removesuffix(chr(92)).rstrip()} {text}"
            continue
        if whole:
            yield number, whole
        number, whole = at, text
    if whole:
        yield number, whole


def _missing(
    formula: Formula, constants: Mapping[str, float], names: frozenset[str] = frozenset()
) -> list[str]:
    """Return the names in a formula that have no value."""
    return sorted(n for n in formula.names if n not in names and n not in constants)


def _hint(used: str, system: LSystem, names: Iterable[str] = ()) -> str:
    near = suggest(used, [n for n in (*names, *system.constants) if n.isidentifier()])
    return f"; {near}" if near else f"; `#define {used} ...` gives it one"
