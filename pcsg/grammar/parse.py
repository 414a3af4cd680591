"""From the tokens of an item to its syntax, by the LALR parser that Lark makes of ``pcsg.lark``."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from lark import Lark, Transformer
from lark.exceptions import UnexpectedToken
from lark.lexer import Lexer
from lark.parsers.lalr_interactive_parser import InteractiveParser

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic
from pcsg.grammar import syntax
from pcsg.grammar.automaton import STUCK, Automaton
from pcsg.grammar.colors import is_hsv, read_color, read_hsv
from pcsg.grammar.items import RawItem
from pcsg.grammar.literals import numbers_of
from pcsg.grammar.messages import explain
from pcsg.grammar.precedence import Signed, SyntaxFault, Term, combine_numbers, combine_solids
from pcsg.grammar.syntax import Arguments, Name, Solid, Value
from pcsg.grammar.tokens import CONSTANTS, Token, join, span_of, unfold_all
from pcsg.graph.expr import Apply, Expr, Number, Parameter
from pcsg.graph.transforms import TRANSFORMS

STARTS = ("axiom", "module", "rule", "attributed", "definition", "setting")


def parse_item(raw: RawItem, last: bool) -> tuple[syntax.Item, Diagnostic | None]:
    """Parse one item.

    Parameters
    ----------
    last
        Whether it is the last of its file, so that its end is the file's.

    Returns
    -------
    item, problem
        `syntax.Broken` where it has a mistake; the mistake, unless it was reported before.
    """
    if raw.broken:
        return _broken(raw), raw.problem
    kind = _kind(raw)
    tokens = raw.tokens
    if kind == "attributed" and tokens[1].type == "TRANSFORM" and tokens[1].text not in TRANSFORMS:
        tokens[1].type = "NAME"  # a module's head, taken for an unknown transformation
    try:
        item: syntax.Item = _automaton(kind).parse(tokens)
        if item is not STUCK:
            return item, None
    except SyntaxFault as fault:
        return _broken(raw), fault.problem
    return _parse_slowly(raw, kind, last)


def _parse_slowly(raw: RawItem, kind: str, last: bool) -> tuple[syntax.Item, Diagnostic | None]:
    """Parse an item with Lark's loop, which knows what would have fitted."""
    tokens = raw.tokens = unfold_all(raw.tokens)
    parser = _new_parser(kind)
    feed = parser.parser_state.feed_token
    at = -1
    try:
        for at, token in enumerate(tokens):  # noqa: B007 -- read where the parser stopped
            feed(token)  # type: ignore[arg-type]  # it needs no more than the type
        at = len(tokens)
        item: syntax.Item = parser.feed_eof()  # type: ignore[no-untyped-call]  # Lark's, untyped
    except UnexpectedToken:
        accepts = parser.accepts()  # type: ignore[no-untyped-call]  # Lark's, untyped
        return _broken(raw), explain(kind, tokens, at, accepts, last)
    except SyntaxFault as fault:
        return _broken(raw), fault.problem
    return item, None


def _kind(raw: RawItem) -> str:
    if raw.kind != "labelled":
        return raw.kind
    return "attributed" if any(t.type == "ARROW" for t in raw.tokens) else "axiom"


def _broken(raw: RawItem) -> syntax.Broken:
    """Return what is known of an item that cannot be parsed."""
    tokens = raw.tokens
    head = tokens[0]
    kind = _kind(raw)
    assigned = frozenset(a.text for a, b in pairwise(tokens) if b.type == "ASSIGN")
    number = int(head.text) if kind == "rule" and len(head.text) < 10 else None
    at = 1 if kind in ("rule", "attributed") else 0
    name = None
    if kind in ("rule", "attributed", "module", "definition") and len(tokens) > at:
        token = tokens[at]
        name = Name(token.text, token.span) if token.type == "NAME" else None
    if kind == "attributed" and len(tokens) > 3:
        formals = (t.text for t in tokens[2:] if t.type == "NAME")
        assigned |= frozenset(formals)
    return syntax.Broken(kind, name, number, assigned)


class _NoLexer(Lexer):
    """The parser is fed with tokens; there is nothing to cut."""

    def __init__(self, conf: Any) -> None:
        """Take the configuration that Lark gives to every lexer."""

    def lex(self, *_: Any) -> Any:
        """Return no tokens."""
        return iter(())


@cache
def _lark() -> Lark:
    text = Path(__file__).with_name("pcsg.lark").read_text(encoding="utf-8")
    return Lark(
        text,
        parser="lalr",
        lexer=_NoLexer,
        start=list(STARTS),
        transformer=_Builder(),
        maybe_placeholders=True,
        keep_all_tokens=True,
    )


def _new_parser(start: str) -> InteractiveParser:
    return _lark().parse_interactive(start=start)


@cache
def _automaton(start: str) -> Automaton:
    return Automaton(_new_parser(start).parser_state.parse_conf)


Items = list[Any]


class _Builder(Transformer[Any, Any]):
    """Builds the syntax bottom up; one method for each alternative of the grammar."""

    # Items.

    def axiom(self, c: Items) -> syntax.Axiom:
        label, solid = c
        start = label.span if label else solid.span
        return syntax.Axiom(solid, join(start, solid.span))

    def module(self, c: Items) -> syntax.Module:
        return syntax.Module(_name(c[0]), c[1])

    def rule(self, c: Items) -> syntax.Rule:
        number, name, _, solid = c
        # The number of digits is limited, because a rule's number is listed when it is missing.
        value = int(number.text) if len(number.text) < 10 else 10**9
        return syntax.Rule(value, _name(name), solid, join(number.span, solid.span))

    def attributed(self, c: Items) -> syntax.AttributedRule:
        label, name, _, names, _, _, condition, _, solid = c
        formals = tuple(_name(t) for t in names or ())
        span = join(label.span, solid.span)
        return syntax.AttributedRule(_name(label), _name(name), formals, condition, solid, span)

    def condition(self, c: Items) -> Expr:
        return c[0]  # type: ignore[no-any-return]

    def condition_else(self, c: Items) -> None:
        return None

    def definition(self, c: Items) -> syntax.Definition:
        return syntax.Definition(_name(c[0]), c[2])

    def setting(self, c: Items) -> syntax.SettingItem:
        kind, name = c[0], c[1]
        pairs = next((x for x in c[2:] if isinstance(x, list)), [])
        span = span_of(kind, c[-1])
        return syntax.SettingItem(_name(kind), name and _name(name), tuple(pairs), span)

    def pair(self, c: Items) -> tuple[Name, Value]:
        return _name(c[0]), c[2]

    def value_number(self, c: Items) -> Value:
        return Value((c[0],), None, c[0].span)

    def value_vector(self, c: Items) -> Value:
        return Value((c[1], c[3], c[5]), None, span_of(c[0], c[6]))

    def value_list(self, c: Items) -> Value:
        return Value((c[0], c[2], c[4]), None, join(c[0].span, c[4].span))

    def value_text(self, c: Items) -> Value:
        return Value((), c[0].text[1:-1], c[0].span)

    def value_stops(self, c: Items) -> Value:
        numbers = tuple(x for stop in c[1] for x in stop)
        return Value(numbers, None, span_of(c[0], c[2]), stops=True)

    def stop_of_text(self, c: Items) -> tuple[Expr, ...]:
        return (c[1], *read_color(c[3].text[1:-1], c[3].span))

    def stop(self, c: Items) -> tuple[Expr, ...]:
        return c[1], c[4], c[6], c[8]

    # Lists grow in place, so that long ones cost no more than their length.

    def list_begin(self, c: Items) -> Items:
        return c

    def list_append(self, c: Items) -> Items:
        c[0].append(c[2])
        return c[0]  # type: ignore[no-any-return]

    def list_extend(self, c: Items) -> Items:
        c[0].append(c[-1])
        return c[0]  # type: ignore[no-any-return]

    def chain_append(self, c: Items) -> Items:
        c[0] += c[1:]
        return c[0]  # type: ignore[no-any-return]

    # Solids.

    def combine(self, c: Items) -> Solid:
        return combine_solids(c[0])

    def group(self, c: Items) -> Solid:
        return combine_solids(c[1])

    def prefixed(self, c: Items) -> Solid:
        prefixes, operand = c
        return syntax.Prefixed(tuple(prefixes), operand, join(prefixes[0].span, operand.span))

    def transformation(self, c: Items) -> syntax.Unary:
        word, (arguments, end) = c
        return syntax.Unary(word.text, arguments, False, span_of(word, end))

    def mirror(self, c: Items) -> syntax.Unary:
        return syntax.Unary(c[0].text, Arguments(), False, c[0].span)

    def attribute(self, c: Items) -> syntax.Unary:
        word, (arguments, end) = c
        if word.text == "color" and is_hsv(arguments.values):
            arguments = Arguments(read_hsv(arguments.values, word.span))
        return syntax.Unary(word.text, arguments, True, span_of(word, end))

    def attribute_of_text(self, c: Items) -> syntax.Unary:
        word, _, text, end = c
        if word.text != "color":
            message = f"`{word.text}` takes no text"
            raise SyntaxFault(diagnose("wrong-arguments", message, text.span))
        arguments = Arguments(read_color(text.text[1:-1], text.span))
        return syntax.Unary(word.text, arguments, True, span_of(word, end))

    def for_loop(self, c: Items) -> syntax.For:
        word, opening, name, _, numbers, end = c
        arguments = self.arguments([opening, numbers, end])[0]
        return syntax.For(_name(name), arguments, span_of(word, end))

    def repeat(self, c: Items) -> syntax.Repeat:
        word, _, count, _, prefixes, end = c
        return syntax.Repeat(count, tuple(prefixes), span_of(word, end))

    def scatter(self, c: Items) -> syntax.Scatter:
        words = tuple(c[4]) if len(c) > 4 else ()
        return syntax.Scatter(_text(c[2]), words, span_of(c[0], c[-1]))

    def words_begin(self, c: Items) -> list[tuple[Name, syntax.Text]]:
        return [(_name(c[0]), _text(c[2]))]

    def words_append(self, c: Items) -> list[tuple[Name, syntax.Text]]:
        return [*c[0], (_name(c[2]), _text(c[4]))]

    def empty_block(self, c: Items) -> syntax.Block:
        return syntax.Block((), span_of(c[0], c[1]))

    def block(self, c: Items) -> syntax.Block:
        return syntax.Block(tuple(c[1]), span_of(c[0], c[-1]))

    def assignment(self, c: Items) -> tuple[Name, Expr]:
        return _name(c[0]), c[2]

    def use(self, c: Items) -> syntax.Use:
        return syntax.Use(c[0].text, None, c[0].span)

    def call(self, c: Items) -> syntax.Use:
        word, (arguments, end) = c
        return syntax.Use(word.text, arguments, span_of(word, end))

    def primitive(self, c: Items) -> syntax.Primitive:
        word = c[0]
        if len(c) == 1:
            return syntax.Primitive(word.text, Arguments(), word.span)
        arguments, end = c[1]
        return syntax.Primitive(word.text, arguments, span_of(word, end))

    def primitive_of_texts(self, c: Items) -> syntax.Primitive:
        word, opening, texts = c[:3]
        numbers = self.arguments([opening, c[4], c[-1]])[0] if len(c) > 4 else Arguments()
        span = span_of(word, c[-1])
        quoted = tuple(map(_text, texts))
        return syntax.Primitive(word.text, numbers, span, quoted)

    # Fields.

    def blob(self, c: Items) -> syntax.Blob:
        return syntax.Blob((combine_solids(c[2]),), span_of(c[0], c[3]))

    def braces(self, c: Items) -> tuple[Items, Token]:
        return c[1], c[2]

    def more_braces(self, c: Items) -> tuple[Items, Token]:
        (fields, _), _, more, end = c
        return [*fields, *more], end

    def blend(self, c: Items) -> syntax.BlendUse:
        word, (fields, end) = c
        solids = tuple(combine_solids(f) for f in fields)
        return syntax.BlendUse(word.text, Arguments(), solids, span_of(word, end))

    def blend_with_numbers(self, c: Items) -> syntax.BlendUse:
        word, (arguments, _), (fields, end) = c
        solids = tuple(combine_solids(f) for f in fields)
        return syntax.BlendUse(word.text, arguments, solids, span_of(word, end))

    # Numbers.

    def calculate(self, c: Items) -> Expr:
        return combine_numbers(c[0])

    def number_group(self, c: Items) -> Expr:
        expr = combine_numbers(c[1])
        if isinstance(expr, Apply):
            # The span takes the parentheses in.
            return Apply(expr.function, expr.args, expr.seeds, span_of(c[0], c[2]))
        return expr

    def signed(self, c: Items) -> Term:
        sign, term = c
        if isinstance(term, Signed):
            term.signs.append(sign)
            return term
        return Signed(term, [sign])

    def literal(self, c: Items) -> Expr:
        return Number(float(c[0].text), c[0].span)

    def constant(self, c: Items) -> Expr:
        return Number(CONSTANTS[c[0].text], c[0].span)

    def parameter(self, c: Items) -> Expr:
        return Parameter(c[0].text, c[0].span)

    def function(self, c: Items) -> Expr:
        word, (arguments, end) = c
        span = span_of(word, end)
        return Apply(word.text, arguments.values, arguments.seeds, span)

    def literal_arguments(self, c: Items) -> tuple[Arguments, Token]:
        return Arguments(numbers_of(c[0])), c[0]

    def no_arguments(self, c: Items) -> tuple[Arguments, Token]:
        return Arguments(), c[-1]

    def arguments(self, c: Items) -> tuple[Arguments, Token]:
        _, items, end = c
        cuts = [k for k, item in enumerate(items) if isinstance(item, Token)]
        if not cuts:
            return Arguments(tuple(items), 0), end
        if len(cuts) > 1:
            sign = items[cuts[1]]
            message = "a second `;` among arguments"
            raise SyntaxFault(diagnose("unexpected-token", message, sign.span))
        values = tuple(item for item in items if not isinstance(item, Token))
        return Arguments(values, cuts[0]), end


def _name(token: Token) -> Name:
    return Name(token.text, token.span)


def _text(token: Token) -> syntax.Text:
    return syntax.Text(token.text[1:-1], token.span)
