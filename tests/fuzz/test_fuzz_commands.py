"""No command ends with a mistake in pcsg itself, however it is spoilt; ``make fuzz`` tries more."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from driver import run_input, withstand
from fuzz_commands import FILES, SEEDS, SMALL, SUBJECT, call

from pcsg.commands import check


def test_spoilt_commands(tmp_path: Path) -> None:
    withstand(SUBJECT, 60, tmp_path)


@pytest.mark.parametrize("words", SEEDS[::5], ids=" ".join)
def test_good_commands_are_good(
    words: Sequence[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        Path(name).write_bytes(content.encode("latin-1"))
    status, told = call([*words, "--once"] if "view" in words else words)
    assert status == 0, told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("compose", "tree.swc", "-n", "2147483648"), "from 1 to 100,000"),
        (("mesh", "tree.swc", "--levels", "11111"), "between 1 and 6"),
        (("grow", "plot", "young.json", "--t", "1e-300"), "nothing of the tree yet"),
        (("grow", "frame", "young.json", "--t", "2", "--seed", str(2**64)), "seed"),
        (("grow", "animate", "young.json", "--frames-per-year", "inf"), "frames-per-year"),
        (("animate", "a.pcsg", "--fps", "1e-300"), "--fps"),
        (("animate", "a.pcsg", "--orbit", "inf"), "--orbit"),
        (("animate", "a.pcsg", "--frames", "0..9999999"), "at most 100,000 frames"),
        (("stats", "a.pcsg", "--seed", "1" + "0" * 400), "--seed"),
        (("compose", "tree.swc", "--seed", "-1"), "seed"),
        (("mesh", "tree.swc", "--max-aspect", "1e-320"), "max_aspect"),
        (("render", "a.pcsg", *SMALL, "-D", "c=-1e300"), "a.png"),
        (("render", "a.pcsg", *SMALL, "--time", "1e300"), "a.png"),
        (("render", "a.pcsg", *SMALL, "-D", "c=-1e300", "--exposure", "64"), "a.png"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else "",
)
def test_what_was_a_mistake_in_pcsg_itself(
    words: Sequence[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        Path(name).write_bytes(content.encode("latin-1"))
    assert told in call(words)[1]


def test_a_mistake_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_args: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(check, "run", fail)
    text = json.dumps({"words": ["check", "a.pcsg"], "files": {}})
    failure = run_input(SUBJECT, text, 0, tmp_path)
    assert failure is not None and failure.kind.startswith("ZeroDivisionError")
