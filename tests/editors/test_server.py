"""The language server, as an editor talks to it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygls", reason="the extra `lsp` is not installed")
pytest_lsp = pytest.importorskip("pytest_lsp", reason="pytest-lsp is not installed")

from lsprotocol import types as lsp  # noqa: E402 -- of the extra
from pytest_lsp import ClientServerConfig, LanguageClient, client_capabilities  # noqa: E402

ROOT = Path(__file__).parents[2]
GRAMMARS = ROOT / "grammars"
TREE = """\
{ cnt = 3;
  width = 0.1; } S           // \U0001f333 the axiom

S if(cnt > 0, 2, 1)
1: S -> limb
2: S -> limb | {cnt = cnt-1} move(0,0,1) S
#define half uscale(0.5)
limb = half material(bark) color(0.2, 0.1, 0.05) cone(width)
material bark { color = "#804020"; roughness = 0.5 }
"""

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_lsp.fixture(  # type: ignore[untyped-decorator]
    scope="module",
    config=ClientServerConfig(server_command=[sys.executable, "-m", "pcsg", "lsp"]),
)
async def client(lsp_client: LanguageClient) -> AsyncIterator[None]:
    capabilities = client_capabilities("visual-studio-code")
    await lsp_client.initialize_session(lsp.InitializeParams(capabilities=capabilities))
    yield
    await lsp_client.shutdown_session()


class Text:
    """A document that is open in the editor."""

    def __init__(self, client: LanguageClient, text: str, path: Path) -> None:
        self.client, self.text, self.uri = client, text, path.as_uri()
        self.version = 1
        item = lsp.TextDocumentItem(self.uri, "pcsg", 1, text)
        client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))

    @property
    def named(self) -> lsp.TextDocumentIdentifier:
        return lsp.TextDocumentIdentifier(self.uri)

    def place(self, word: str, nth: int = 0, behind: bool = False) -> lsp.Position:
        at = -1
        for _ in range(nth + 1):
            at = self.text.index(word, at + 1)
        at += len(word) if behind else 0
        before = self.text[:at]
        column = len(before.rpartition("\n")[2].encode("utf-16-le")) // 2
        return lsp.Position(before.count("\n"), column)

    def change(self, text: str) -> None:
        self.version += 1
        self.text = text
        self.client.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                lsp.VersionedTextDocumentIdentifier(self.version, self.uri),
                [lsp.TextDocumentContentChangeWholeDocument(text)],
            )
        )

    async def problems(self) -> list[lsp.Diagnostic]:
        """Wait for the next diagnostics of this text."""
        while True:
            await self.client.wait_for_notification(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
            if self.uri in self.client.diagnostics:
                return list(self.client.diagnostics.pop(self.uri))

    def covered(self, where: lsp.Range) -> str:
        lines = self.text.encode("utf-16-le").split("\n".encode("utf-16-le"))
        assert where.start.line == where.end.line
        line = lines[where.start.line]
        return line[2 * where.start.character : 2 * where.end.character].decode("utf-16-le")

    def edited(self, edits: Any) -> str:
        lines = self.text.split("\n")
        for edit in sorted(edits, key=lambda e: (e.range.start.line, e.range.start.character))[
            ::-1
        ]:
            start, end = edit.range.start, edit.range.end
            first = lines[start.line][: start.character]
            last = lines[end.line][end.character :] if end.line < len(lines) else ""
            lines[start.line : end.line + 1] = (first + edit.new_text + last).split("\n")
        return "\n".join(lines)


async def hover(text: Text, word: str, nth: int = 0) -> str:
    found = await text.client.text_document_hover_async(
        lsp.HoverParams(text.named, text.place(word, nth))
    )
    return found.contents.value if found else ""  # type: ignore[union-attr]


async def proposals(text: Text, word: str, nth: int = 0) -> set[str]:
    """Return what may stand behind a word."""
    found = await text.client.text_document_completion_async(
        lsp.CompletionParams(text.named, text.place(word, nth, behind=True))
    )
    return {item.label for item in found}  # type: ignore[union-attr]


async def test_mistakes_come_while_typing(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, "box | cilinder\n", tmp_path / "a.pcsg")
    (found,) = await text.problems()
    assert found.code == "unknown-primitive"
    assert text.covered(found.range) == "cilinder"
    assert "did you mean `cylinder`?" in found.message
    text.change("box | cylinderr\n")
    text.change("box | cylinder\n")
    assert await text.problems() == []  # nothing is told of what stood there for a moment


async def test_characters_of_two_units_move_no_mark(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, "/* \U0001f333 */ cilinder\n", tmp_path / "b.pcsg")
    (found,) = await text.problems()
    assert text.covered(found.range) == "cilinder"


async def test_repairs(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, "box | cilinder \u2212 sphere\n", tmp_path / "c.pcsg")
    found = await text.problems()
    assert len(found) >= 1
    for _ in range(2):
        actions = await client.text_document_code_action_async(
            lsp.CodeActionParams(
                text.named,
                lsp.Range(lsp.Position(0, 0), lsp.Position(0, 99)),
                lsp.CodeActionContext([]),
            )
        )
        if not actions:
            break
        (edits,) = actions[0].edit.changes.values()  # type: ignore[union-attr]
        text.change(text.edited(edits))
        await text.problems()
    assert text.text == "box | cylinder - sphere\n"


async def test_hover(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, TREE, tmp_path / "d.pcsg")
    assert await text.problems() == []
    assert "3 in the axiom" in await hover(text, "cnt", 1)
    assert "cone(" in await hover(text, "cone")
    assert "if(cond, a, b)" in await hover(text, "if(")
    assert "move(x, y, z)" in await hover(text, "move")
    assert "2: S -> limb |" in await hover(text, "S", 3)
    assert "limb = half" in await hover(text, "limb")
    assert "#define" not in await hover(text, "half", 1)
    assert "uscale(0.5)" in await hover(text, "half", 1)
    assert "material bark {" in await hover(text, "bark")
    assert "by default" in await hover(text, "roughness")
    assert await hover(text, "0.05") == ""


async def test_completion(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, TREE + "sky { kind = }\nground { z = 0; }\n", tmp_path / "e.pcsg")
    await text.problems()
    of_solids = await proposals(text, "-> ")
    assert {"S", "limb", "half", "cylinder", "move", "color", "material"} <= of_solids
    assert "cnt" not in of_solids and "sin" not in of_solids
    of_numbers = await proposals(text, "if(")
    assert {"cnt", "width", "sin", "pi", "SEED"} <= of_numbers
    assert "limb" not in of_numbers and "box" not in of_numbers
    assert await proposals(text, "material(") == {"bark"}
    assert "roughness" in await proposals(text, "bark {")
    assert "gradient" in await proposals(text, "kind = ")
    assert "material" in await proposals(text, "z = 0;")


async def test_definition_and_references(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, TREE, tmp_path / "f.pcsg")
    await text.problems()
    places = await client.text_document_definition_async(
        lsp.DefinitionParams(text.named, text.place("limb"))
    )
    assert [p.range.start for p in places] == [text.place("limb = ")]  # type: ignore
    for whole, count in ((True, 3), (False, 2)):
        found = await client.text_document_references_async(
            lsp.ReferenceParams(lsp.ReferenceContext(whole), text.named, text.place("limb"))
        )
        assert found is not None
        assert [text.covered(p.range) for p in found] == ["limb"] * count


async def test_definitions_in_included_files(client: LanguageClient) -> None:
    path = GRAMMARS / "sea.pcsg"
    text = Text(client, path.read_text(encoding="utf-8"), path)
    assert await text.problems() == []
    places = await client.text_document_definition_async(
        lsp.DefinitionParams(text.named, text.place("MNT"))
    )
    assert {p.uri for p in places} == {(GRAMMARS / "parts/land.pcsg").as_uri()}  # type: ignore
    renamed = await client.text_document_rename_async(
        lsp.RenameParams(text.named, text.place("MNT"), "LAND")
    )
    assert renamed is None  # other grammars include that file, too


async def test_rename(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, TREE, tmp_path / "g.pcsg")
    await text.problems()
    for old, new, count in (("cnt", "order", 4), ("S", "STEM", 5), ("bark", "rind", 2)):
        at = text.place(old + " " if old == "S" else old)
        edit = await client.text_document_rename_async(lsp.RenameParams(text.named, at, new))
        assert edit is not None and edit.changes is not None
        assert len(edit.changes[text.uri]) == count
        made = text.edited(edit.changes[text.uri])
        assert made.count(new) == count
    for bad in ("2x", "cone", "width", ""):
        at = text.place("cnt")
        assert (
            await client.text_document_rename_async(lsp.RenameParams(text.named, at, bad)) is None
        )


async def test_colours(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, TREE, tmp_path / "h.pcsg")
    await text.problems()
    found = await client.text_document_document_color_async(lsp.DocumentColorParams(text.named))
    assert [text.covered(c.range) for c in found] == ["(0.2, 0.1, 0.05)", '"#804020"']
    assert found[1].color.red == pytest.approx(128 / 255, abs=1e-3)
    for colour, again in zip(found, ["(0.2, 0.1, 0.05)", '"#804020"'], strict=True):
        (picked,) = await client.text_document_color_presentation_async(
            lsp.ColorPresentationParams(text.named, colour.color, colour.range)
        )
        assert picked.label == again


async def test_formatting_and_lenses(client: LanguageClient, tmp_path: Path) -> None:
    text = Text(client, "1:S->box|cone  \n\n\n\n\nbox", tmp_path / "i.pcsg")
    options = lsp.FormattingOptions(4, True)
    edits = await client.text_document_formatting_async(
        lsp.DocumentFormattingParams(text.named, options)
    )
    assert text.edited(edits) == "1: S -> box | cone\n\n\nbox\n"
    text.change("box $")
    edits = await client.text_document_formatting_async(
        lsp.DocumentFormattingParams(text.named, options)
    )
    assert not edits
    lenses = await client.text_document_code_lens_async(lsp.CodeLensParams(text.named))
    assert [lens.command.command for lens in lenses or ()] == ["pcsg.render", "pcsg.view"]


async def test_texts_that_are_being_typed_break_nothing(
    client: LanguageClient, tmp_path: Path
) -> None:
    text = Text(client, "", tmp_path / "j.pcsg")
    for end in range(0, len(TREE), 17):
        text.change(TREE[:end].replace("\U0001f333", ""))
        last = lsp.Position(99, 99)
        await client.text_document_completion_async(lsp.CompletionParams(text.named, last))
        await client.text_document_hover_async(lsp.HoverParams(text.named, last))
        await client.text_document_document_color_async(lsp.DocumentColorParams(text.named))
        await client.text_document_rename_async(lsp.RenameParams(text.named, last, "x"))
    await asyncio.sleep(0)
    assert client.error is None
