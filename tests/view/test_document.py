import os
import sys

import pytest

from pcsg.errors import EnvironmentFault, PcsgError, UsageError
from pcsg.view.document import Document, Text, Watch


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.pcsg"
    path.write_bytes(b"sphere\n")
    return path


def test_a_text_is_read_and_written(file):
    document = Document(file)
    assert document.read().text == "sphere\n"
    document.write("box\n", "sphere\n")
    assert file.read_bytes() == b"box\n"
    assert [p.name for p in file.parent.iterdir()] == ["a.pcsg"]


def test_what_an_editor_does_not_show_stays():
    text = Text.of(b"\xef\xbb\xbfa\r\nb\r\n")
    assert text.text == "a\nb\n"
    assert text.encode("a\nc\n") == b"\xef\xbb\xbfa\r\nc\r\n"


def test_what_was_changed_elsewhere_is_not_overwritten(file):
    document = Document(file)
    file.write_text("cylinder\n")
    with pytest.raises(UsageError, match="somebody else"):
        document.write("box\n", "sphere\n")
    assert file.read_text() == "cylinder\n"


def test_a_removed_file_is_written_again(file):
    file.unlink()
    Document(file).write("box\n", "sphere\n")
    assert file.read_text() == "box\n"


def test_files_of_ours_stay(file):
    with pytest.raises(UsageError, match="came with pcsg"):
        Document(file, shipped=True).write("box\n", "sphere\n")
    assert file.read_text() == "sphere\n"


@pytest.mark.skipif(sys.platform == "win32", reason="rights and links differ there")
def test_rights_and_links_stay(file):
    file.chmod(0o600)
    link = file.with_name("link.pcsg")
    link.symlink_to(file.name)
    Document(link).write("box\n", "sphere\n")
    assert link.is_symlink()
    assert file.read_text() == "box\n"
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_full_disk_is_told_and_the_file_stays(file, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EnvironmentFault, match="No space left"):
        Document(file).write("box\n", "sphere\n")
    assert file.read_text() == "sphere\n"
    assert [p.name for p in file.parent.iterdir()] == ["a.pcsg"]


def test_a_folder_is_no_text(tmp_path):
    with pytest.raises(PcsgError):
        Document(tmp_path).read()
    with pytest.raises(PcsgError):
        Document(tmp_path).write("a", "b")


def test_changes_are_seen_once_however_they_are_made(file):
    watch = Watch([file])
    assert not watch.changed()
    for change in (
        lambda: file.write_text("a longer text\n"),
        lambda: file.with_name("b").rename(file) if file.with_name("b").write_text("b") else None,
        file.unlink,
        lambda: file.write_text("back\n"),
    ):
        change()
        assert watch.changed()
        assert not watch.changed()


def test_other_files_can_be_watched_without_missing_a_change(file):
    other = file.with_name("b.pcsg")
    watch = Watch([file])
    file.write_text("changed\n")
    watch.follow([file, other])
    assert watch.changed()
    other.write_text("new\n")
    assert watch.changed()
