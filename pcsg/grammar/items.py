"""Cutting the tokens of a file into its items.

Items need no separator. A pass over the tokens knows where one begins: at a head that can stand
nowhere else (``2:``, ``name:``, ``name =``, ``camera {``, a name with a selection function), or
where an expression is complete and something follows that cannot continue it. Brackets are
checked on the way, so that a mistake in one item does not reach into the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from pcsg.catalogue import diagnose
from pcsg.errors import Diagnostic
from pcsg.grammar.fields import FIELD_BLENDS, FIELD_UNARY
from pcsg.grammar.tokens import LOOPS, TEXTUAL, WORD_TYPES, Token
from pcsg.graph.functions import FUNCTIONS
from pcsg.graph.settings import SETTINGS


@dataclass
class RawItem:
    """The tokens of an item.

    Attributes
    ----------
    kind
        Start symbol of the grammar: ``axiom``, ``module``, ``rule``, ``labelled``, ``definition``
        or ``setting``.
    broken
        Whether its tokens are known to be wrong.
    problem
        What is wrong, if it was not reported before.
    """

    kind: str
    tokens: list[Token] = field(default_factory=list)
    broken: bool = False
    problem: Diagnostic | None = None


_OPERAND_STARTS = frozenset(
    {"BLOB", "NAME", "PRIMITIVE", "TRANSFORM", "MIRROR", "ATTRIBUTE", "LBRACE", *LOOPS.values()}
)
_NAMES = _OPERAND_STARTS - {"LBRACE"}
_APPLIES_TO = _OPERAND_STARTS | {"LPAREN"}
_CAN_BEGIN = WORD_TYPES | {"BLOB", "NUMBER", "LBRACE", "LPAREN"}
_SELECTION_STARTS = frozenset({"NUMBER", "NAME", "LPAREN", "NOT", "CONSTANT"})
_ARGUMENTS = ("LPAREN", "LITERALS")
# Types after which an expression for a solid, or a number, can be complete.
_ENDS_SOLID = frozenset({"NAME", "PRIMITIVE"})
_ENDS_NUMBER = frozenset({"NAME", "NUMBER", "CONSTANT"})
_APPLIED = frozenset({"TRANSFORM", "ATTRIBUTE", *LOOPS.values()})
_OF_SOLIDS = (_OPERAND_STARTS - {"NAME"}) | {"UNION", "INTERSECTION", "DIFFERENCE"}
_OPENS = {"LPAREN": "(", "LBRACE": "{", "FOPEN": "{ "}
_CLOSES = {"RPAREN": "(", "RBRACE": "{", "FCLOSE": "{ "}


def cut_items(tokens: Sequence[Token]) -> list[RawItem]:
    """Cut the tokens of one file into items; see the module for how."""
    mark_words(tokens)
    return _Cutter(tokens).cut()


def mark_words(tokens: Sequence[Token]) -> None:
    """Give the words of loops, and the words and braces of fields, their types by what is behind.

    A loop is its word before `(`, where the file has no module or definition of that name. A blob
    is `blob` before a brace; an operator on fields is a name before braces, with numbers between
    perhaps; a unary one is a name before numbers and an operand. Elsewhere these are ordinary
    names.
    """
    partner: dict[int, int] = {}
    stack: list[int] = []
    own: set[str] = set()
    for i, token in enumerate(tokens):
        if token.type in _OPENS:
            stack.append(i)
        elif token.type in _CLOSES and stack:
            partner[stack.pop()] = i
        elif token.text in LOOPS and not stack:
            neighbours = tokens[i - 1 if i else 0].type, tokens[min(i + 1, len(tokens) - 1)].type
            if neighbours[0] == "COLON" or neighbours[1] == "ASSIGN":
                own.add(token.text)
    for i, token in enumerate(tokens):
        following = tokens[i + 1].type if i + 1 < len(tokens) else ""
        behind = i + 1
        if following == "LPAREN":
            behind = partner.get(i + 1, len(tokens)) + 1
        elif following == "LITERALS":
            behind += 1
        after = tokens[behind] if behind < len(tokens) else None
        if token.text in LOOPS and following in _ARGUMENTS and token.text not in own:
            token.type = LOOPS[token.text]
        elif token.type == "NAME" and token.text in TEXTUAL and following == "LPAREN":
            # Nobody's module takes a text: the name stays free for all others.
            inner = tokens[i + 2].type if i + 2 < len(tokens) else ""
            token.type = "PRIMITIVE" if inner == "STRING" else token.type
        elif token.type == "PRIMITIVE" and token.text == "blob" and following == "LBRACE":
            token.type = "BLOB"
            _mark_braces(tokens, i + 1, partner)
        elif token.type == "NAME" and token.text in FIELD_BLENDS and after is not None:
            while behind in partner and tokens[behind].type == "LBRACE":
                token.type = "BLEND"
                _mark_braces(tokens, behind, partner)
                behind = partner[behind] + 1
        elif token.type == "NAME" and token.text in FIELD_UNARY and following in _ARGUMENTS:
            applies = after is not None and after.type in _APPLIES_TO
            token.type = "TRANSFORM" if applies else token.type


def _mark_braces(tokens: Sequence[Token], opens: int, partner: dict[int, int]) -> None:
    if opens in partner:
        tokens[opens].type = "FOPEN"
        tokens[partner[opens]].type = "FCLOSE"


class _Cutter:
    """The state of the pass.

    Attributes
    ----------
    open
        Open brackets: the token, its sign, its role, and the token before it. The role is ``call``
        after a name or a primitive, ``unary`` after a transformation or an attribute, ``number``
        inside of these and of braces, ``group`` otherwise.
    complete
        Whether what was read of the item is complete at depth 0.
    arithmetic
        Whether the item is at numbers rather than at solids.
    condition
        Whether the item is in the condition of an attributed rule.
    """

    def __init__(self, tokens: Sequence[Token]) -> None:
        self.tokens = tokens
        self.items: list[RawItem] = []
        self.item: RawItem | None = None
        self.open: list[tuple[Token, str, str, Token | None]] = []
        self.complete = True
        self.arithmetic = False
        self.condition = False
        self.arrow = False
        # The name of a call that has just been closed, for unknown transformations.
        self.closed_call: Token | None = None

    def cut(self) -> list[RawItem]:
        i = 0
        tokens = self.tokens
        while i < len(tokens):
            token = tokens[i]
            if token.type in _CAN_BEGIN:
                head = self._head(i)
                if head:
                    i = self._begin(head, i)
                    continue
            if self.item is None:
                self._start("axiom")
            self._read(token, tokens[i - 1] if i else None)
            i += 1
        self._finish()
        return self.items

    def _type(self, i: int) -> str:
        return self.tokens[i].type if i < len(self.tokens) else ""

    def _head(self, i: int) -> str | None:
        """Return the kind of the item that begins at token i, if one does."""
        token = self.tokens[i]
        kind, following = token.type, self._type(i + 1)
        if kind == "NUMBER":
            return "rule" if following == "COLON" and token.text.isdigit() else None
        if kind in WORD_TYPES:
            if following == "COLON":
                return "labelled"
            if following == "ASSIGN":
                return "definition" if self._defines(token) else None
            if token.text in SETTINGS and (token.first or not self.open) and not self._is_name():
                named = following == "NAME" and self._type(i + 2) == "LBRACE"
                if following == "LBRACE" or named:
                    return "setting"
            if token.first and kind in _NAMES and self._declares(i):
                return "module"
        if self.closed_call is not None and kind in _APPLIES_TO and not token.first:
            # An unknown transformation, which is told when names are checked.
            self.closed_call.type = "TRANSFORM"
            self.complete = False
            return None
        if self.open or not self.complete:
            return None
        if kind == "LPAREN":
            return "axiom" if token.first and self._is_of_solids(i) else None
        if kind == "NAME" and token.first and self._on_line(i + 1) and following == "LBRACE":
            return "setting"
        return "axiom" if kind in _OPERAND_STARTS and self.item is not None else None

    def _is_name(self) -> bool:
        """Whether the next token names the setting that has just begun: ``material fog { }``."""
        item = self.item
        return item is not None and item.kind == "setting" and len(item.tokens) == 1

    def _is_of_solids(self, i: int) -> bool:
        """Whether the bracket that opens at token i holds solids, not a call's numbers."""
        depth = 0
        for token in self.tokens[i:]:
            depth += (token.type in _OPENS) - (token.type in _CLOSES)
            if token.type in _OF_SOLIDS or depth <= 0:
                return depth > 0
        return False

    def _on_line(self, i: int) -> bool:
        """Whether token i is there and stands on the line of the one before it."""
        return i < len(self.tokens) and not self.tokens[i].first

    def _defines(self, token: Token) -> bool:
        """Whether a name before ``=`` begins a definition."""
        if self.condition or not self.open:
            return not self.condition
        return token.first and not any(sign == "{" for _, sign, _, _ in self.open)

    def _declares(self, i: int) -> bool:
        """Whether the name at token i, first on its line, declares a module."""
        if not self._on_line(i + 1):
            return False
        selection = self.tokens[i + 1]
        if selection.text in FUNCTIONS and self._type(i + 2) in _ARGUMENTS:
            return selection.type == "NAME"
        if self.open or self.tokens[i].type != "NAME":
            return False
        if selection.type == "NUMBER":
            return True
        return self.complete and selection.gap and selection.type in _SELECTION_STARTS

    def _begin(self, kind: str, i: int) -> int:
        """Begin an item at token i and return the index behind its head."""
        self._start(kind)
        assert self.item is not None
        token = self.tokens[i]
        self.complete = False
        if kind in ("rule", "labelled"):
            colon = self.tokens[i + 1]
            head = Token(
                "NUMBERED" if kind == "rule" else "LABEL",
                token.text,
                token.source,
                token.start,
                max(token.end, colon.end),
                token.line,
            )
            head.origin, head.places = token.origin, token.places
            self.item.tokens.append(head)
            return i + 2
        if kind == "setting":
            token.type = "SETTING"
        self.arithmetic = kind == "module"
        if kind == "axiom":
            self._read(token, None)
        else:
            self.item.tokens.append(token)
        return i + 1

    def _start(self, kind: str) -> None:
        self._finish()
        self.item = RawItem(kind)
        self.items.append(self.item)
        self.complete = self.arithmetic = self.condition = self.arrow = False
        self.closed_call = None

    def _finish(self) -> None:
        """Close the item that was read last."""
        if self.item is not None and self.open:
            token, sign, _, _ = self.open[-1]
            self._fail(diagnose("unbalanced-bracket", f"`{sign}` is never closed", token.span))
        elif self.item is not None and self.item.kind == "setting":
            _mark_lists(self.item.tokens)
        self.open.clear()

    def _fail(self, problem: Diagnostic) -> None:
        assert self.item is not None
        if not self.item.broken:
            self.item.problem = problem
            self.item.broken = True

    def _read(self, token: Token, before: Token | None) -> None:
        """Add a token to the item."""
        assert self.item is not None
        kind = token.type
        self.item.tokens.append(token)
        self.closed_call = None
        if kind == "LITERALS":
            self._open(token, before, "(")
            self._close(token, "(")
        elif kind in _OPENS:
            self._open(token, before, _OPENS[kind])
        elif kind in _CLOSES:
            self._close(token, _CLOSES[kind])
        elif kind == "STRAY":
            self.item.broken = True
        elif kind == "ASSIGN":
            if self.condition:
                token.type, token.text = "OPERATOR", "=="
            elif len(self.open) == 1 and self.item.kind == "setting" and before is not None:
                if before.type in WORD_TYPES:
                    before.type = "KEY"
            elif not self.open:
                self.complete = False
        elif not self.open:
            self._read_outside(kind)

    def _read_outside(self, kind: str) -> None:
        """Follow a token that is neither a bracket nor inside one."""
        assert self.item is not None
        if kind == "ARROW":
            self.arrow = True
            self.condition = self.arithmetic = self.complete = False
        elif kind == "COLON" and self.item.kind == "labelled" and not self.arrow:
            self.condition, self.arithmetic, self.complete = True, True, False
        else:
            head = self.item.kind == "setting" or (self.item.kind == "rule" and not self.arrow)
            ends = _ENDS_NUMBER if self.arithmetic else _ENDS_SOLID
            self.complete = kind in ends and not head and not self.condition

    def _open(self, token: Token, before: Token | None, sign: str) -> None:
        assert self.item is not None
        role = "group"
        if self.open and (self.open[-1][1] == "{" or self.open[-1][2] != "group"):
            role = "number"
        elif sign == "(" and before is not None and len(self.item.tokens) > 1:
            if before.type in ("NAME", "PRIMITIVE"):
                role = "call"
            elif before.type in _APPLIED:
                role = "unary"
        self.open.append((token, sign, role, before))
        self.complete = False

    def _close(self, token: Token, sign: str) -> None:
        assert self.item is not None
        if not self.open or self.open[-1][1] != sign:
            if self.item.broken:
                del self.open[-1:]
                return
            shown = ")" if sign == "(" else "}"
            notes = []
            if self.open:
                opener, other, _, _ = self.open.pop()
                notes.append((f"`{other}` is open here", opener.span))
            message = f"`{shown}` without its `{sign}`"
            self._fail(diagnose("unbalanced-bracket", message, token.span, notes=notes))
            return
        _, _, role, before = self.open.pop()
        if role == "call" and not self.arithmetic and before is not None:
            self.closed_call = before if before.type == "NAME" else None
        if self.open:
            return
        if sign == "{":
            self.complete = self.item.kind == "setting"
        else:
            self.complete = role != "unary" and not self.condition
            if self.item.kind == "rule" and not self.arrow:
                self.complete = False


def _mark_lists(tokens: list[Token]) -> None:
    """Tell the two commas of ``eye = 1, 2, 3`` from commas that separate the keys of a setting."""
    depth, commas = 0, list[Token]()
    for token, following in pairwise(tokens):
        if token.type in _OPENS:
            depth += 1
        elif token.type in _CLOSES:
            depth -= 1
        if depth != 1:
            continue
        if token.type in ("KEY", "SEMICOLON"):
            commas = []
        elif token.type == "COMMA" and following.type not in ("KEY", "RBRACE", "SEMICOLON"):
            commas.append(token)
        if following.type in ("KEY", "SEMICOLON", "RBRACE") and len(commas) == 2:
            for comma in commas:
                comma.type = "LIST_COMMA"
            commas = []
