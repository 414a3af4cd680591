"""The TextMate grammar, which VS Code, shiki and Zed read, made from the words of the language.

``python -m pcsg.editors.textmate > editors/vscode/syntaxes/pcsg.tmLanguage.json`` writes it anew.
"""

from __future__ import annotations

import json
from typing import Any

from pcsg.editors.vocabulary import KINDS, vocabulary

SCOPES = {
    "setting": "keyword.declaration",
    "loop": "keyword.control",
    "function": "support.function",
    "blend": "support.function.blend",
    "transformation": "support.function.transformation",
    "attribute": "entity.other.attribute-name",
    "primitive": "support.class",
    "constant": "constant.language",
    "global": "variable.language",
    "operator": "keyword.operator.word",
    "name": "variable.other",
    "number": "constant.numeric",
    "string": "string.quoted.double",
    "directive": "keyword.control.directive",
    "label": "entity.name.label",
    "sign": "keyword.operator",
}
"""The scope of what `kinds_of` tells, without the language's name behind."""

_NAME = r"[\p{L}_][\p{L}\p{M}\p{N}_]*"
_BEHIND = {
    "setting": rf"(?=\s*(?:{_NAME}\s*)?\{{)",
    "loop": r"(?=\s*\()",
    "function": r"(?=\s*\()",
    "blend": r"(?=\s*[({])",
}


def make_grammar() -> dict[str, Any]:
    """Return the grammar, as an object for JSON."""

    def pattern(kind: str, match: str) -> dict[str, str]:
        return {"name": f"{SCOPES[kind]}.pcsg", "match": match}

    known = vocabulary()
    patterns: list[dict[str, Any]] = [
        {"name": "comment.line.double-slash.pcsg", "match": "//.*$"},
        {"name": "comment.block.pcsg", "begin": r"/\*", "end": r"\*/"},
        pattern("string", r'"[^"]*"'),
        pattern("directive", rf"^\s*#\s*{_NAME}"),
        pattern("label", rf"^\s*(?:[0-9]+|{_NAME})(?=\s*:)"),
        pattern("number", r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"),
    ]
    for kind in KINDS:
        listed = "|".join(known[kind])
        whole = rf"(?<![\p{{L}}\p{{M}}\p{{N}}_])(?:{listed})(?![\p{{L}}\p{{M}}\p{{N}}_])"
        patterns.append(pattern(kind, whole + _BEHIND.get(kind, "")))
    patterns.append(pattern("name", _NAME))
    patterns.append(
        pattern("sign", r"->|\u2192|&&|\|\||[=!<>]=|[-+*/%^<>=!|&\\\u222a\u2229\u2216:]")
    )
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "pcsg",
        "scopeName": "source.pcsg",
        "fileTypes": ["pcsg"],
        "patterns": patterns,
    }


def grammar_text() -> str:
    """Return the file of the grammar."""
    return json.dumps(make_grammar(), indent=2, ensure_ascii=True) + "\n"


if __name__ == "__main__":
    print(grammar_text(), end="")
