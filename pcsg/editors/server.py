"""The language server: `pcsg lsp`.

It answers the editor's first question before anything of the language is loaded, and never compiles
a kernel. Texts are checked a moment after the last change, in a thread, so that typing goes on.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path
from pygls.workspace import TextDocument

import pcsg
from pcsg.errors import Diagnostic, GrammarError, PcsgError, Source

if TYPE_CHECKING:
    from pcsg.editors.symbols import Names, Occurrence

PAUSE = 0.25
"""Seconds without a change before a text is checked."""

_KINDS = {
    "key": lsp.CompletionItemKind.Property,
    "value": lsp.CompletionItemKind.EnumMember,
    "parameter": lsp.CompletionItemKind.Variable,
    "global": lsp.CompletionItemKind.Variable,
    "constant": lsp.CompletionItemKind.Constant,
    "function": lsp.CompletionItemKind.Function,
    "transformation": lsp.CompletionItemKind.Function,
    "blend": lsp.CompletionItemKind.Function,
    "attribute": lsp.CompletionItemKind.Function,
    "primitive": lsp.CompletionItemKind.Class,
    "solid": lsp.CompletionItemKind.Module,
    "macro": lsp.CompletionItemKind.Snippet,
}


class Server(LanguageServer):
    """The state of the server.

    Attributes
    ----------
    problems
        What was found in a document, and the version that was checked, by its address.
    values
        Those of the axiom's parameters, when the text last had no mistake.
    """

    def __init__(self) -> None:
        super().__init__("pcsg", pcsg.__version__)
        self.problems: dict[str, list[Diagnostic]] = {}
        self.values: dict[str, dict[str, float]] = {}
        self.waiting: dict[str, asyncio.Task[None]] = {}

    def document(self, uri: str) -> TextDocument:
        """Return an open document."""
        return self.workspace.get_text_document(uri)

    def source(self, uri: str) -> Source:
        """Return the text of a document as the language takes it."""
        path = _path_of(uri)
        return Source(str(path), self.document(uri).source, str(path.parent))

    def files(self, uri: str) -> list[Names]:
        """Return the names of a document and of what it includes."""
        from pcsg.editors.symbols import files_of

        opened = {
            _path_of(d.uri).resolve(): d.source for d in self.workspace.text_documents.values()
        }
        return files_of(self.source(uri), opened)


def _path_of(uri: str) -> Path:
    return Path(to_fs_path(uri) or "untitled.pcsg")


def find_problems(source: Source) -> tuple[list[Diagnostic], dict[str, float]]:
    """Return all that `pcsg check` tells of a text, and the values of the axiom's parameters."""
    from pcsg.grammar import check_text
    from pcsg.graph.evaluate import axiom_values, check_settings
    from pcsg.graph.graph import GLOBALS

    graph, problems = check_text(source.text, source.name, folder=Path(source.folder))
    values: dict[str, float] = {}
    if graph is not None:
        try:
            values = axiom_values(graph, GLOBALS)
            problems += check_settings(graph, values)
        except GrammarError as error:
            problems += error.diagnostics
        except PcsgError:
            values = {}
    return problems, values


# Places: offsets here, lines and columns of UTF-16 there.


def position(source: Source, offset: int) -> lsp.Position:
    """Return where an offset is."""
    line, column = source.locate(offset)
    before = source.text[offset - column + 1 : offset]
    return lsp.Position(line - 1, len(before.encode("utf-16-le", "surrogatepass")) // 2)


def offset_of(source: Source, place: lsp.Position) -> int:
    """Return the offset of a place; the end of its line where that is shorter."""
    if place.line >= len(source.line_starts):
        return len(source.text)
    start = source.line_starts[place.line]
    units = 0
    for k, sign in enumerate(source.line(place.line + 1)):
        if units >= place.character:
            return start + k
        units += 2 if ord(sign) > 0xFFFF else 1
    return start + len(source.line(place.line + 1))


def range_of(source: Source, start: int, end: int) -> lsp.Range:
    """Return the range of some characters."""
    return lsp.Range(position(source, start), position(source, end))


def _location(found: Occurrence) -> lsp.Location:
    uri = from_fs_path(str(Path(found.source.name).resolve())) or ""
    return lsp.Location(uri, range_of(found.source, found.start, found.end))


def shown_problem(problem: Diagnostic, source: Source) -> lsp.Diagnostic:
    """Return a diagnostic for the editor; what stands in another file is told at the beginning."""
    span = problem.span
    here = span is not None and span.source.name == source.name
    where = range_of(source, span.start, span.end) if span and here else range_of(source, 0, 0)
    lines = [problem.message if here or span is None else f"{span}: {problem.message}"]
    lines += [f"expected: {problem.expected}"] if problem.expected else []
    lines += [f"help: {problem.hint}"] if problem.hint else []
    related = [
        lsp.DiagnosticRelatedInformation(
            lsp.Location(
                from_fs_path(str(Path(place.source.name).resolve())) or "",
                range_of(place.source, place.start, place.end),
            ),
            text,
        )
        for text, place in problem.notes
        if place is not None
    ]
    is_error = problem.severity == "error"
    severity = lsp.DiagnosticSeverity.Error if is_error else lsp.DiagnosticSeverity.Warning
    return lsp.Diagnostic(
        where,
        "\n".join(lines),
        severity=severity,
        code=problem.code,
        source="pcsg",
        related_information=related or None,
    )


def make_server() -> Server:
    """Return a server with all that it answers."""
    server = Server()
    _add_checking(server)
    _add_reading(server)
    _add_changing(server)
    return server


def _add_checking(server: Server) -> None:
    async def check_later(uri: str, pause: float) -> None:
        await asyncio.sleep(pause)
        document = server.document(uri)
        source, version = server.source(uri), document.version
        if not source.name.endswith(".pcsg"):
            return
        problems, values = await asyncio.to_thread(find_problems, source)
        server.problems[uri] = problems
        if values:
            server.values[uri] = values
        told = [shown_problem(p, source) for p in problems]
        server.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, told, version))

    def start(uri: str, pause: float) -> None:
        if uri in server.waiting:
            server.waiting[uri].cancel()
        server.waiting[uri] = asyncio.get_running_loop().create_task(check_later(uri, pause))

    @server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
    async def did_open(params: lsp.DidOpenTextDocumentParams) -> None:
        start(params.text_document.uri, 0.0)

    @server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    async def did_change(params: lsp.DidChangeTextDocumentParams) -> None:
        start(params.text_document.uri, PAUSE)

    @server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
    async def did_save(params: lsp.DidSaveTextDocumentParams) -> None:
        for uri in server.workspace.text_documents:
            start(uri, 0.0)  # it may be included there

    @server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    async def did_close(params: lsp.DidCloseTextDocumentParams) -> None:
        uri = params.text_document.uri
        if uri in server.waiting:
            server.waiting.pop(uri).cancel()
        server.problems.pop(uri, None)
        server.values.pop(uri, None)
        server.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, []))


def _add_reading(server: Server) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    def hover(params: lsp.HoverParams) -> lsp.Hover | None:
        from pcsg.editors.assistance import explain

        uri = params.text_document.uri
        at = offset_of(server.source(uri), params.position)
        text = explain(server.files(uri), at, server.values.get(uri, {}))
        return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text)) if text else None

    @server.feature(
        lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=["(", "{", ";"])
    )
    def completion(params: lsp.CompletionParams) -> list[lsp.CompletionItem]:
        from pcsg.editors.assistance import propose

        uri = params.text_document.uri
        found = propose(server.files(uri), offset_of(server.source(uri), params.position))
        return [
            lsp.CompletionItem(
                p.word,
                kind=_KINDS.get(p.kind, lsp.CompletionItemKind.Keyword),
                detail=p.detail or None,
            )
            for p in found
        ]

    @server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
    def definition(params: lsp.DefinitionParams) -> list[lsp.Location]:
        files, found = _name_at(server, params)
        return [_location(o) for o in _uses(files, found) if o.defines]

    @server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
    def references(params: lsp.ReferenceParams) -> list[lsp.Location]:
        files, found = _name_at(server, params)
        whole = params.context.include_declaration
        return [_location(o) for o in _uses(files, found) if whole or not o.defines]

    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_COLOR)
    def colours(params: lsp.DocumentColorParams) -> list[lsp.ColorInformation]:
        from pcsg.editors.assistance import colours

        names = server.files(params.text_document.uri)[0]
        return [
            lsp.ColorInformation(range_of(names.source, c.start, c.end), _shown_colour(c.rgb))
            for c in colours(names)
        ]

    @server.feature(lsp.TEXT_DOCUMENT_CODE_LENS)
    def lenses(params: lsp.CodeLensParams) -> list[lsp.CodeLens]:
        uri = params.text_document.uri
        first = lsp.Range(lsp.Position(0, 0), lsp.Position(0, 0))
        return [
            lsp.CodeLens(first, lsp.Command(title, f"pcsg.{title}", arguments=[uri]))
            for title in ("render", "view")
        ]


def _add_changing(server: Server) -> None:
    def refuse(why: str) -> lsp.WorkspaceEdit | None:
        server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Warning, why))
        return None

    @server.feature(lsp.TEXT_DOCUMENT_COLOR_PRESENTATION)
    def presentation(params: lsp.ColorPresentationParams) -> list[lsp.ColorPresentation]:
        from pcsg.editors.assistance import colour_text

        source = server.source(params.text_document.uri)
        quoted = source.text[offset_of(source, params.range.start)] == '"'
        colour = params.color
        text = colour_text((colour.red, colour.green, colour.blue), quoted)
        return [lsp.ColorPresentation(text, lsp.TextEdit(params.range, text))]

    @server.feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare_rename(params: lsp.PrepareRenameParams) -> lsp.Range | None:
        _, found = _name_at(server, params)
        if found is None:
            return None
        return range_of(found.source, found.start, found.end)

    @server.feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
    def rename(params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
        from pcsg.editors.vocabulary import vocabulary
        from pcsg.graph.words import is_name

        files, found = _name_at(server, params)
        if found is None:
            return None
        wanted = params.new_name
        taken = {o.name for names in files for o in names.occurrences if o.space == found.space}
        if not is_name(wanted) or any(wanted in known for known in vocabulary().values()):
            return refuse(f"`{wanted}` is no name, or a word of the language")
        if wanted in taken and wanted != found.name:
            return refuse(f"there is a `{wanted}` already")
        places = _uses(files, found)
        others = {o.source.name for o in places} - {files[0].source.name}
        if others:
            # Other grammars may include that file, too.
            return refuse(f"`{found.name}` stands in {min(others)}, too: rename it by hand")
        edits = [lsp.TextEdit(range_of(o.source, o.start, o.end), wanted) for o in places]
        return lsp.WorkspaceEdit(changes={params.text_document.uri: edits})

    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION,
        lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]),
    )
    def actions(params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
        from pcsg.editors.assistance import repair

        uri = params.text_document.uri
        source = server.source(uri)
        first, last = (offset_of(source, p) for p in (params.range.start, params.range.end))
        found: list[lsp.CodeAction] = []
        for problem in server.problems.get(uri, []):
            fix = repair(problem)
            same = problem.span is not None and problem.span.source.text == source.text
            if fix is None or not same or fix.end < first or fix.start > last:
                continue
            edit = lsp.TextEdit(range_of(source, fix.start, fix.end), fix.text)
            found.append(
                lsp.CodeAction(
                    fix.title,
                    lsp.CodeActionKind.QuickFix,
                    diagnostics=[shown_problem(problem, source)],
                    is_preferred=True,
                    edit=lsp.WorkspaceEdit(changes={uri: [edit]}),
                )
            )
        return found

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
        from pcsg.grammar.formatting import format_text

        source = server.source(params.text_document.uri)
        try:
            made = format_text(source)
        except GrammarError:
            return []  # the diagnostics tell why
        if made == source.text:
            return []
        return [lsp.TextEdit(range_of(source, 0, len(source.text)), made)]


def _name_at(server: Server, params: Any) -> tuple[list[Names], Occurrence | None]:
    """Return the files of a document, and the name at a place that is the grammar's own."""
    from pcsg.graph.graph import GLOBALS

    uri = params.text_document.uri
    files = server.files(uri)
    found = files[0].at(offset_of(server.source(uri), params.position))
    return files, None if found is None or found.name in GLOBALS else found


def _uses(files: Sequence[Names], found: Occurrence | None) -> list[Occurrence]:
    from pcsg.editors.assistance import uses

    return [] if found is None else uses(files, found)


def _shown_colour(rgb: tuple[float, float, float]) -> lsp.Color:
    from pcsg.editors.assistance import to_shown

    red, green, blue = map(to_shown, rgb)
    return lsp.Color(red, green, blue, 1.0)
