"""The loop of the parser over the tables that Lark makes: as Lark's, but for what errors need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lark.parsers.lalr_analysis import Shift
from lark.parsers.lalr_parser_state import ParseConf

from pcsg.errors import Source
from pcsg.grammar.tokens import Token

STUCK = object()
"""What comes of tokens that do not fit."""

_END = Token("$END", "", Source("", ""), 0, 0)


class Automaton:
    """The tables of one start symbol.

    Parameters
    ----------
    tables
        Lark's, with what builds the syntax.

    Notes
    -----
    A state is a dictionary. For the type of the next token it holds the state to go to, or what
    to reduce; for a symbol of the grammar the state behind it.
    """

    def __init__(self, tables: ParseConf[Any]) -> None:
        states: dict[Any, dict[str, Any]] = {number: {} for number in tables.states}
        for number, actions in tables.states.items():
            for key, (action, target) in actions.items():
                symbol = str(key)  # Lark's strings compare slowly
                if action is Shift:
                    states[number][symbol] = states[target]
                else:
                    build, left = tables.callbacks[target], str(target.origin.name)
                    states[number][symbol] = len(target.expansion), build, left
        self._start = states[tables.start_state]
        states[tables.end_state][_END.type] = {}  # there is nothing behind it

    def parse(self, tokens: Sequence[Token]) -> Any:
        """Return what the tokens stand for; `STUCK` if one does not fit, or the end."""
        state = self._start
        states = [state]
        values: list[Any] = []
        for token in (*tokens, _END):
            kind = token.type
            while (action := state.get(kind)).__class__ is tuple:
                size, build, symbol = action
                parts = values[-size:]
                del values[-size:], states[-size:]
                values.append(build(parts))
                state = states[-1][symbol]
                states.append(state)
            if action is None:
                return STUCK
            state = action
            states.append(state)
            values.append(token)
        return values[0]
