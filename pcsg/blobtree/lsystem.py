"""L-systems: parametric, stochastic, context-sensitive rewriting of strings of modules.

Rules are those of Prusinkiewicz and Lindenmayer, *The Algorithmic Beauty of Plants* (1990). Modules
are characters, or words, with numbers; `pcsg.blobtree.lsystemfile` reads them from texts.

Besides the rules of growth there may be two sets more: rules of *decomposition* apply after every
step, and rules of *interpretation* to the string that is drawn, which does not grow by them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pcsg.blobtree.formulas import Compute, Draws, Formula
from pcsg.errors import UsageError

MOST_MODULES = 1_000_000
"""Modules of a string at most, where a file does not ask for more."""

WORK = 6
"""What a derivation may cost, over the most modules: to look at a module or at a rule costs 1."""

STEP = 8
"""The cost of a step without modules."""

KEPT = 100_000
"""Modules whose successors are remembered, where no chance and no context decides."""


class Letter(NamedTuple):
    """A module of the string: a character or a word, and its numbers."""

    symbol: str
    args: tuple[float, ...]


@dataclass(frozen=True)
class Pattern:
    """A module in the head of a rule.

    Attributes
    ----------
    names
        Of its numbers; empty for one that must have a value.
    tests
        Places of numbers that must have a value, and these.
    """

    symbol: str
    names: tuple[str, ...] = ()
    tests: tuple[tuple[int, Compute], ...] = ()

    def binds(self, letter: Letter, into: dict[str, float]) -> bool:
        """Return whether a letter fits, and give names to its numbers."""
        if letter.symbol != self.symbol or len(letter.args) != len(self.names):
            return False
        for k, test in self.tests:
            if letter.args[k] != test(into):
                return False
        into.update(zip(self.names, letter.args, strict=True))
        return True


Successor = tuple[tuple[str, tuple[Compute, ...]], ...]


@dataclass(frozen=True)
class LRule:
    """A rule of an L-system.

    Attributes
    ----------
    right
        With patterns ``[`` and ``]`` about what must stand in a branch.
    line
        Where it stands, from 1.
    random
        Whether its numbers or its condition draw by chance.
    cost
        Of its formulas, as `WORK` counts.
    """

    left: tuple[Pattern, ...]
    predecessor: Pattern
    right: tuple[Pattern, ...]
    condition: Compute | None
    probability: Compute | None
    successor: Successor
    line: int = 0
    random: bool = False
    cost: int = 1

    @property
    def is_plain(self) -> bool:
        """Whether nothing but the module itself decides what the rule makes of it."""
        return not (self.left or self.right or self.probability or self.random)


@dataclass
class LSystem:
    """A set of rules and where they begin.

    Attributes
    ----------
    constants
        Of ``#define``; ``steps``, ``angle``, ``width`` and ``thinning`` have a meaning.
    definitions
        What the constants are, as formulas.
    rules, decomposition, interpretation
        How modules grow, what they fall into after every step, and what is drawn for them.
    depths
        How often decomposition and interpretation are applied to what they have made, at most.
    ignored
        What contexts do not see.
    most
        Modules that a string has at most.
    """

    constants: dict[str, float] = field(default_factory=dict)
    definitions: dict[str, Formula] = field(default_factory=dict)
    axiom: Successor = ()
    rules: list[LRule] = field(default_factory=list)
    decomposition: list[LRule] = field(default_factory=list)
    interpretation: list[LRule] = field(default_factory=list)
    depths: dict[str, int] = field(default_factory=dict)
    ignored: frozenset[str] = frozenset()
    draws: Draws = field(default_factory=lambda: Draws(0))
    most: int = MOST_MODULES

    @property
    def steps(self) -> int:
        """The number of steps that the constant of this name says.

        Raises
        ------
        UsageError
            It is no number of steps.
        """
        said = self.constants.get("steps", 0.0)
        if said < 0.0 or said != int(said):
            raise UsageError(f"`steps` is a whole number from 0, not {said:g}")
        return int(said)

    def derive(self, steps: int | None = None) -> list[Letter]:
        """Return the string after so many steps, by default the constant ``steps``.

        Raises
        ------
        UsageError
            The string grows too long, or a number cannot be computed.
        """
        return _Derivation(self).run(self.steps if steps is None else steps)

    def interpret(self, string: list[Letter]) -> list[Letter]:
        """Return what is drawn for a string.

        Raises
        ------
        UsageError
            What is drawn grows too long, or a number cannot be computed.
        """
        if not self.interpretation:
            return string
        return _Derivation(self).interpret(string)


class _Rules:
    """A set of rules, and what is known of modules that they have been applied to."""

    def __init__(self, rules: Sequence[LRule]) -> None:
        self.by_symbol: dict[str, list[LRule]] = {}
        for rule in rules:
            self.by_symbol.setdefault(rule.predecessor.symbol, []).append(rule)
        self.contexts = any(rule.left or rule.right for rule in rules)
        self.plain = {s for s, found in self.by_symbol.items() if all(r.is_plain for r in found)}
        self.is_random = any(rule.random or rule.probability for rule in rules)
        self.known: dict[Letter, list[Letter]] = {}


class _TooLarge(Exception):
    """The budget of a derivation is used up."""


class _Derivation:
    """The rewriting of one string, with a count of the work that is done."""

    def __init__(self, system: LSystem) -> None:
        self.system = system
        self.constants = system.constants
        self.ignored = system.ignored
        self.growth = _Rules(system.rules)
        self.decomposition = _Rules(system.decomposition)
        # Every rule that is tried gets a copy of the constants.
        self.glance = 1 + len(system.constants) // 16
        self.left = WORK * system.most
        self.string: list[Letter] = []
        self.bearers: list[int] = []
        self.matches: list[int] = []

    def run(self, steps: int) -> list[Letter]:
        names = dict(self.constants)
        self.string = [self._letter(s, fs, names, 0) for s, fs in self.system.axiom]
        is_random = self.growth.is_random or self.decomposition.is_random
        step = 0
        try:
            self._repeat(self.decomposition, "decomposition")
            while step < steps:
                step += 1
                changed = self._apply(self.growth)
                changed = self._repeat(self.decomposition, "decomposition") or changed
                if not changed and not is_random:
                    break
        except _TooLarge as reason:
            raise UsageError(
                f"{reason} in step {step:,} of {steps:,}; take fewer `steps`, at most "
                f"{max(0, step - 1):,}, or allow a longer string by a line "
                f"`most: {2 * self.system.most}`"
            ) from None
        return self.string

    def interpret(self, string: list[Letter]) -> list[Letter]:
        self.string = string
        try:
            self._repeat(_Rules(self.system.interpretation), "interpretation")
        except _TooLarge as reason:
            raise UsageError(
                f"{reason} when it is drawn; take fewer `steps`, or allow a longer string by a "
                f"line `most: {2 * self.system.most}`"
            ) from None
        return self.string

    def _repeat(self, rules: _Rules, name: str) -> bool:
        """Apply rules to what they have made, too; return whether one was applied."""
        applied = False
        for _ in range(self.system.depths.get(name, 1) if rules.by_symbol else 0):
            if not self._apply(rules):
                break
            applied = True
        return applied

    def _spend(self, work: int) -> None:
        self.left -= work
        if self.left < 0:
            most = WORK * self.system.most
            raise _TooLarge(f"more than {most:,} modules, rules and contexts are looked at")

    def _apply(self, rules: _Rules) -> bool:
        """Rewrite the string once; return whether a rule was applied."""
        string, most = self.string, self.system.most
        self._spend(STEP + len(string))
        if rules.contexts:
            self.bearers, self.matches = _structure(string)
        out: list[Letter] = []
        changed = False
        for k, letter in enumerate(string):
            own = rules.by_symbol.get(letter.symbol)
            made = _SAME if own is None else rules.known.get(letter)
            if made is None and own is not None:
                made = self._rewritten(rules, own, k)
            if made is _SAME or made is None:
                out.append(letter)
                continue
            changed = True
            out += made
            if len(out) > most:
                break
        if len(out) > most:
            raise _TooLarge(f"the string grows beyond {most:,} modules")
        self.string = out
        return changed

    def _rewritten(self, rules: _Rules, own: Sequence[LRule], k: int) -> list[Letter]:
        """Return what its own rules make of a module, `_SAME` where none applies."""
        letter = self.string[k]
        chosen = self._choose(own, k)
        made = _SAME
        if chosen is not None:
            rule, names = chosen
            self._spend(len(rule.successor) + rule.cost)
            made = [self._letter(s, fs, names, rule.line) for s, fs in rule.successor]
        if letter.symbol in rules.plain and len(rules.known) < KEPT:
            rules.known[letter] = made
        return made

    def _letter(
        self, symbol: str, formulas: tuple[Compute, ...], names: Mapping[str, float], line: int
    ) -> Letter:
        if not formulas:
            return Letter(symbol, ())
        args = tuple([self._value(f, names, line) for f in formulas])
        return Letter(symbol, args)

    def _value(self, formula: Compute, names: Mapping[str, float], line: int) -> float:
        """Return a number; raises with the line of the rule where there is none."""
        try:
            value = float(formula(names))
        except (ArithmeticError, ValueError) as error:
            raise self._no_value(str(error), names, line) from None
        if not math.isfinite(value):
            raise self._no_value("it is too large", names, line)
        return value

    def _no_value(self, why: str, names: Mapping[str, float], line: int) -> UsageError:
        bound = (name for name in names if name.isidentifier())
        own = [f"{n} = {names[n]:g}" for n in bound if self.constants.get(n) != names[n]]
        where = f" of the rule in line {line}" if line else " of the axiom"
        given = f" ({', '.join(own)})" if own else ""
        return UsageError(f"a number{where} cannot be computed: {why}{given}")

    def _choose(self, rules: Sequence[LRule], k: int) -> tuple[LRule, dict[str, float]] | None:
        possible: list[tuple[LRule, dict[str, float], float]] = []
        for rule in rules:
            self._spend(self.glance)
            names = dict(self.constants)
            if not rule.predecessor.binds(self.string[k], names):
                continue
            if rule.left and not self._fits_left(rule.left, k, names):
                continue
            if rule.right and not self._fits_right(rule.right, 0, k + 1, (), names):
                continue
            if rule.condition is not None:
                self._spend(rule.cost)
            if rule.condition is not None and not self._value(rule.condition, names, rule.line):
                continue
            if rule.probability is None:
                # A certain rule: the first that fits, unless a chance came before.
                if not possible:
                    return rule, names
                break
            chance = self._value(rule.probability, names, rule.line)
            if chance < 0.0:
                raise UsageError(f"line {rule.line}: the probability {chance:g} is below 0")
            possible.append((rule, names, chance))
        if not possible:
            return None
        # Probabilities that do not add up to 1 leave the rest to the module as it is.
        total = max(1.0, sum(p for _, _, p in possible))
        draw = self.system.draws.uniform() * total
        for rule, names, p in possible:
            draw -= p
            if draw < 0.0:
                return rule, names
        return None

    def _fits_left(self, patterns: tuple[Pattern, ...], k: int, names: dict[str, float]) -> bool:
        at = self.bearers[k]
        for pattern in reversed(patterns):
            while at >= 0 and self.string[at].symbol in self.ignored:
                at = self.bearers[at]
                self._spend(1)
            if at < 0 or not pattern.binds(self.string[at], names):
                return False
            at = self.bearers[at]
        return True

    def _fits_right(
        self,
        patterns: tuple[Pattern, ...],
        p: int,
        at: int,
        ends: tuple[int, ...],
        names: dict[str, float],
    ) -> bool:
        """Return whether patterns from the p-th on fit what stands from a place on.

        Branches that the pattern does not ask for stand aside, and so does the rest of one that it
        does (Prusinkiewicz and Lindenmayer 1990, p. 31).

        Parameters
        ----------
        ends
            Where the branches end that the pattern is in.
        """
        string = self.string
        for number in range(p, len(patterns)):
            pattern = patterns[number]
            if pattern.symbol == "]":
                at, ends = ends[-1] + 1, ends[:-1]
                continue
            if pattern.symbol == "[":
                return self._fits_branch(patterns, number + 1, at, ends, names)
            while at < len(string) and (
                string[at].symbol == "[" or string[at].symbol in self.ignored
            ):
                at = self.matches[at] + 1 if string[at].symbol == "[" else at + 1
                self._spend(1)
            if at >= len(string) or not pattern.binds(string[at], names):
                return False
            at += 1
        return True

    def _fits_branch(
        self,
        patterns: tuple[Pattern, ...],
        p: int,
        at: int,
        ends: tuple[int, ...],
        names: dict[str, float],
    ) -> bool:
        """Return whether patterns fit that begin in one of the branches at a place."""
        string = self.string
        while True:
            while at < len(string) and string[at].symbol in self.ignored:
                at += 1
                self._spend(1)
            if at >= len(string) or string[at].symbol != "[":
                return False
            self._spend(1)
            # A branch that does not fit stands aside, and what it bound is forgotten.
            bound, end = dict(names), self.matches[at]
            if self._fits_right(patterns, p, at + 1, (*ends, end), bound):
                names.update(bound)
                return True
            at = end + 1


_SAME: list[Letter] = []
"""Stands for the module as it is, by its identity."""


def _structure(string: Sequence[Letter]) -> tuple[list[int], list[int]]:
    """Return what stands before every module on its path to the root, and where brackets end."""
    bearers, matches = [-1] * len(string), [len(string)] * len(string)
    stack: list[tuple[int, int]] = []
    last = -1
    for k, letter in enumerate(string):
        if letter.symbol == "[":
            stack.append((last, k))
        elif letter.symbol == "]":
            if stack:
                last, opened = stack.pop()
                matches[opened] = k
        else:
            bearers[k] = last
            last = k
    return bearers, matches
